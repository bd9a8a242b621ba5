"""Who imports whom, and which names are public."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import gpusim
from tests.support.source_outline import outline

PACKAGE = Path(gpusim.__file__).parent

# Who may import whom. Foundation: anybody. Numerics see frozen dataclasses, never the scene.
# `measure` sees images and numbers only: no inverse crime.
FOUNDATION = {
    "_version",
    "arrays",
    "choices",
    "display",
    "errors",
    "field_summary",
    "files",
    "interrupts",
    "parallel",
    "printable",
    "public_names",
    "validation",
}
ALLOWED: dict[str, set[str]] = {
    **{part: set() for part in FOUNDATION},
    "gpu": set(),
    "scene": {"gpu"},
    "mesh": {"gpu"},
    "fem": {"gpu", "mesh"},
    "field": {"gpu", "mesh"},
    "deck": {"gpu", "mesh", "fem"},
    "surface": {"gpu", "mesh", "fem"},
    "optics": {"gpu", "mesh", "fem", "surface"},
    "measure": {"gpu"},
    "motion": set(),
    "export": {"gpu", "mesh", "fem", "surface", "optics", "measure", "scene"},
    "report": {"gpu", "mesh", "fem", "surface", "optics", "measure", "scene", "export"},
    "visualization": {"gpu", "mesh", "fem", "surface", "optics", "measure", "scene", "export"},
}
NUMERICS = set(ALLOWED)
# Packages that put stages together, each with what it may see beside all of the above.
ALLOWED |= {
    "applications": NUMERICS - {"surface"},
    "graph": {"gpu"},
    "plan": {"gpu", "scene", "graph"},
    "twin_checks": {"gpu", "mesh", "fem", "surface", "optics", "measure", "visualization", "view"},
    "bench": {"gpu", "mesh", "fem", "surface", "optics"},
    "pipeline": NUMERICS | {"graph", "plan"},
    "studies": NUMERICS | {"graph", "plan", "pipeline"},
    "notebook": NUMERICS | {"pipeline", "view"},
    "view": NUMERICS | {"plan", "pipeline"},
    "__init__": NUMERICS | {"applications", "plan", "pipeline", "studies"},
    "cli": NUMERICS | {"applications", "bench", "plan", "pipeline", "studies", "view", "__init__"},
    "__main__": {"cli"},
}

# Folders and modules of `optics`: each may import those before it.
OPTICS = (
    "camera",
    "calibration",
    "geometry",
    "light",
    "paint",
    "visibility_buffer",
    "shadow",
    "ambient",
    "truth",
    "frame",
    "change_detection",
    "shading",
    "edge_pixels",
    "rendering",
    "lens",
    "sensor",
)
MOST_MODULES = 20
"""In one folder."""


def python_files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def part_of(path: Path) -> str:
    """The top-level part of the package that a file belongs to: ``fem``, ``cli``, ..."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imported_modules(path: Path) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of every gpusim import, at any depth of the code."""
    package = ("gpusim", *path.relative_to(PACKAGE).parent.parts)
    for node in outline(path.read_text(encoding="utf-8")).imports:
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            base = node.module or ""
            if node.level:
                parent = package[: len(package) - node.level + 1]
                base = ".".join([*parent, base] if base else parent)
            # `from gpusim import fem` names a module; `from gpusim.fem import solve` doesn't.
            names = [f"{base}.{a.name}" for a in node.names] if base == "gpusim" else [base]
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
        "from ..fem.procedures.linear_static import solve",
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


def optics_part(name: str) -> int:
    """Where a module of `optics` stands in the order."""
    return OPTICS.index(name.split(".")[2])


@cache
def import_graph(with_types: bool = True) -> dict[str, set[str]]:
    """Every module with those that it imports, at any depth of the code and for types, too."""
    paths = {
        ".".join(("gpusim", *path.relative_to(PACKAGE).with_suffix("").parts)): path
        for path in python_files()
    }
    modules = {name.removesuffix(".__init__"): path for name, path in paths.items()}
    graph: dict[str, set[str]] = {}
    for module, path in modules.items():
        own = graph.setdefault(module, set())
        code = outline(path.read_text(encoding="utf-8"))
        for node in code.imports if with_types else code.imports_when_run:
            if isinstance(node, ast.Import):
                own |= {alias.name for alias in node.names} & set(modules)
            else:
                package = module if path.name == "__init__.py" else module.rpartition(".")[0]
                parent = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = node.module or ""
                if node.level:
                    base = ".".join([*parent, base] if base else parent)
                names = {f"{base}.{alias.name}" for alias in node.names}
                own |= names & set(modules)
                own |= {base} & set(modules) if names - set(modules) else set()
    return {module: own - {module} for module, own in graph.items()}


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Strongly connected components of more than one module."""

    def reached(start: str, edges: dict[str, set[str]]) -> set[str]:
        found, left = {start}, [start]
        while left:
            more = edges[left.pop()] - found
            found |= more
            left += more
        return found

    back: dict[str, set[str]] = {module: set() for module in graph}
    for module, own in graph.items():
        for name in own:
            back[name].add(module)
    found, left = [], set(graph)
    while left:
        module = min(left)
        circle = reached(module, graph) & reached(module, back)
        left -= circle
        if len(circle) > 1:
            found.append(circle)
    return found


def test_imports_of_optics_flow_one_way() -> None:
    wrong: dict[str, set[str]] = {}
    for module, own in import_graph().items():
        for name in own:
            if all(one.startswith("gpusim.optics.") for one in (module, name)):
                if optics_part(module) < optics_part(name):
                    short = name.removeprefix("gpusim.optics.")
                    wrong.setdefault(module.removeprefix("gpusim.optics."), set()).add(short)
    assert wrong == {}


def test_modules_import_each_other_in_no_circle() -> None:
    found = [{name.removeprefix("gpusim.") for name in one} for one in circles(import_graph())]
    assert sorted(map(sorted, found)) == []


def folder_graph(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """Every folder with those whose modules its own import.

    What is in no folder of `gpusim`, as ``errors``, is one of its own; so is each ``__init__``,
    which lists the names of its folder and of those below and is imported for them.
    """
    packages = {name for name in graph if (PACKAGE.joinpath(*name.split(".")[1:])).is_dir()}

    def folder(name: str) -> str:
        if name in packages:
            return f"{name}.__init__"
        return name.rpartition(".")[0] if name.count(".") > 1 else name

    folders: dict[str, set[str]] = {folder(name): set() for name in graph}
    for module, names in graph.items():
        folders[folder(module)] |= {folder(name) for name in names} - {folder(module)}
    return folders


def test_folders_import_each_other_in_no_circle() -> None:
    found = {frozenset(circle) for circle in circles(folder_graph(import_graph(with_types=False)))}
    assert sorted(map(sorted, found)) == []


def test_a_circle_of_folders_is_seen() -> None:
    graph = {
        "gpusim.fem.procedures.linear_static": {"gpusim.fem.model.loads", "gpusim.errors"},
        "gpusim.fem.model.loads": {"gpusim.errors"},
        "gpusim.fem.model.mass": {"gpusim.fem.procedures.newton"},
        "gpusim.fem.procedures.newton": set(),
        "gpusim.errors": set(),
    }
    assert circles(graph) == []
    assert circles(folder_graph(graph)) == [{"gpusim.fem.procedures", "gpusim.fem.model"}]


def test_no_folder_holds_too_many_modules() -> None:
    folders = Counter(path.parent for path in python_files() if path.name != "__init__.py")
    assert {folder.name: count for folder, count in folders.items() if count > MOST_MODULES} == {}


def list_faults(folder: Path) -> set[str]:
    """Modules and folders in a package that its docstring doesn't list, and listed ones that aren't
    there."""
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    heads = re.findall(r"^- (`[^:]*):", text, re.MULTILINE)
    listed = {name for head in heads for name in re.findall(r"`(\w+)`", head)}
    modules = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    return listed ^ (modules | {path.parent.name for path in folder.glob("*/__init__.py")})


def test_every_folder_lists_its_modules() -> None:
    folders = [path.parent for path in python_files() if path.name == "__init__.py"]
    faults = {folder.relative_to(PACKAGE).as_posix(): list_faults(folder) for folder in folders}
    assert {folder: names for folder, names in faults.items() if names} == {}


def test_a_module_that_is_not_listed_is_seen(tmp_path: Path) -> None:
    listed = "- `one`: First.\n- `two`, `three`: More."
    (tmp_path / "__init__.py").write_text(f'"""Parts.\n\n{listed}\n"""\n', encoding="utf-8")
    for name in ("one", "two", "four"):
        (tmp_path / f"{name}.py").touch()
    assert list_faults(tmp_path) == {"three", "four"}


def test_public_names_are_importable_and_sorted() -> None:
    assert list(gpusim.__all__) == sorted(gpusim.__all__)
    assert len(set(gpusim.__all__)) == len(gpusim.__all__)
    missing = [name for name in gpusim.__all__ if not hasattr(gpusim, name)]
    assert missing == []
    public = {name for name in vars(gpusim) if not name.startswith("_")}
    modules = {part_of(path) for path in python_files()}
    assert public - modules - {"annotations"} <= set(gpusim.__all__)
