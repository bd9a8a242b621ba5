"""Who imports whom, and which names are public."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import gpusim

PACKAGE = Path(gpusim.__file__).parent

# Who may import whom. Foundation: anybody. Numerics see frozen dataclasses, never the scene.
# `measure` sees images and numbers only: no inverse crime.
FOUNDATION = {
    "_version",
    "apart",
    "child_process",
    "blas",
    "copies",
    "distinct",
    "errors",
    "hdf5_file",
    "includes",
    "input_file",
    "inputs",
    "interrupts",
    "main_memory",
    "output_folder",
    "printable",
    "picture_file",
    "picture_tags",
    "processors",
    "series",
}
ALLOWED: dict[str, set[str]] = {
    "_version": set(),
    "apart": set(),
    "child_process": set(),
    "blas": set(),
    "copies": set(),
    "distinct": set(),
    "errors": set(),
    "hdf5_file": set(),
    "includes": set(),
    "input_file": set(),
    "inputs": set(),
    "interrupts": set(),
    "main_memory": set(),
    "output_folder": set(),
    "printable": set(),
    "picture_file": set(),
    "picture_tags": set(),
    "processors": set(),
    "series": set(),
    "gpu": set(),
    "scene": {"gpu"},
    "mesh": {"gpu"},
    "fem": {"gpu", "mesh"},
    "field": {"gpu", "mesh"},
    "deck": {"gpu", "mesh", "fem"},
    "surface": {"gpu", "mesh", "fem"},
    "optics": {"gpu", "mesh", "fem", "surface"},
    "measure": {"gpu"},
    "export": {"gpu", "mesh", "fem", "surface", "optics", "measure", "scene"},
    "report": {"gpu", "mesh", "fem", "surface", "optics", "measure", "scene", "export"},
}
NUMERICS = set(ALLOWED)
# Modules that put stages together, each with what it may see beside all of the above.
ALLOWED |= {
    "state": {"export"},
    "speed": {"export"},
    "planned": {"speed"},
    "plan": {"gpu", "planned", "scene", "speed", "state", "export"},
    "bench": {"gpu", "mesh", "fem", "surface", "optics"},
    "pipeline": NUMERICS | {"plan", "planned", "speed", "state"},
    "__init__": NUMERICS | {"plan", "state", "pipeline"},
    "cli": NUMERICS | {"bench", "plan", "planned", "speed", "state", "pipeline", "__init__"},
    "__main__": {"cli"},
}


def python_files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def part_of(path: Path) -> str:
    """The top-level part of the package that a file belongs to: ``fem``, ``cli``, ..."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imported_modules(path: Path) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of every gpusim import, at any depth of the code."""
    package = ("gpusim", *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parent = package[: len(package) - node.level + 1]
                base = ".".join([*parent, base] if base else parent)
            # `from gpusim import fem` names a module; `from gpusim.fem import solve` doesn't.
            names = [f"{base}.{a.name}" for a in node.names] if base == "gpusim" else [base]
        else:
            continue
        for name in names:
            if name.split(".")[0] == "gpusim":
                yield node.lineno, name


def target_part(name: str) -> str:
    head = next(iter(name.split(".")[1:]), "")
    is_part = (PACKAGE / head).is_dir() or (PACKAGE / f"{head}.py").is_file()
    return head if head and is_part else "__init__"


def import_faults(path: Path) -> list[str]:
    part = part_of(path)
    allowed = ALLOWED[part] | FOUNDATION | {part}
    return [
        f"{path.relative_to(PACKAGE)}:{line} imports {name}"
        for line, name in imported_modules(path)
        if target_part(name) not in allowed
    ]


def test_every_part_has_its_place_in_the_table() -> None:
    assert {part_of(path) for path in python_files()} <= set(ALLOWED)


def test_imports_flow_one_way() -> None:
    assert [fault for path in python_files() for fault in import_faults(path)] == []


@pytest.mark.parametrize(
    "line",
    [
        "from gpusim.fem import statics",
        "from ..fem.statics import solve",
        "import gpusim.fem",
        "def f():\n    from gpusim import fem",
        "from gpusim import solve",
    ],
)
def test_a_wrong_import_is_seen(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("fem", "measure"):
        (tmp_path / name).mkdir()
    path = tmp_path / "measure" / "wrong.py"
    path.write_text(line, encoding="utf-8")
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    assert len(import_faults(path)) == 1


def test_public_names_are_importable_and_sorted() -> None:
    assert list(gpusim.__all__) == sorted(gpusim.__all__)
    assert len(set(gpusim.__all__)) == len(gpusim.__all__)
    missing = [name for name in gpusim.__all__ if not hasattr(gpusim, name)]
    assert missing == []
    public = {name for name in vars(gpusim) if not name.startswith("_")}
    modules = {part_of(path) for path in python_files()}
    assert public - modules - {"annotations"} <= set(gpusim.__all__)
