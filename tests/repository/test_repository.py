"""What is committed: nothing private, nothing unfinished, requirements that match the imports."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from pathlib import Path

from tests.support.source_outline import outline

TEXT_SUFFIXES = {
    ".py",
    ".wgsl",
    ".sh",
    ".toml",
    ".md",
    ".txt",
    ".html",
    ".css",
    ".js",
    ".ipynb",
    "",
}
SKIPPED = {".git", ".venv", "build", "dist", "out", "__pycache__"}
# Written in pieces, so that this file passes its own test.
FORBIDDEN = {
    "absolute path of one machine": re.compile(r"(?<![\w.\-}/])/" + r"(?:home|root|work|tmp)/\w"),
    "address of a package registry": re.compile(
        "extra-index" + "-url|index" + "-url|pypi" + r"\.org/simple|python" + "hosted"
    ),
    "unfinished work": re.compile(r"\b(?:TO" + "DO|FIX" + "ME|XX" + "X)\\b"),
    "left-over of debugging": re.compile(r"\bbreak" + r"point\(|\bpdb\." + r"set_trace"),
    # of which a container may have fewer than its machine
    "as many test processes as cores": re.compile("-n " + "(?:auto|logical)"),
}


def committed_texts(checkout: Path) -> dict[str, str]:
    texts = {}
    for path in sorted(checkout.rglob("*")):
        relative = path.relative_to(checkout)
        hidden = any(part.startswith(".") and part != ".ci" for part in relative.parts)
        if hidden or SKIPPED & set(relative.parts) or not path.is_file():
            continue
        if path.suffix in TEXT_SUFFIXES:
            texts[relative.as_posix()] = path.read_text(encoding="utf-8")
    assert {"pyproject.toml", "README.md", ".ci/run", "gpusim/errors.py"} <= set(texts)
    return texts


def test_nothing_private_or_unfinished_is_committed(checkout: Path) -> None:
    faults = [
        f"{name}:{text[: match.start()].count(chr(10)) + 1}: {what}: {match.group()}"
        for name, text in committed_texts(checkout).items()
        for what, pattern in FORBIDDEN.items()
        for match in pattern.finditer(text)
    ]
    assert faults == []


def test_no_file_is_left_in_the_root(checkout: Path) -> None:
    """As an example that was run there leaves one."""
    files = {path.name for path in checkout.iterdir() if path.is_file()}
    assert {name for name in files if not name.startswith(".")} == {
        "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE", "Makefile", "README.md", "constraints.txt",
        "pyproject.toml",
    }  # fmt: skip


def test_no_file_is_longer_than_400_lines(checkout: Path) -> None:
    lengths = {
        name: text.count("\n")
        for name, text in committed_texts(checkout).items()
        if name.endswith((".py", ".wgsl", ".sh"))
    }
    assert {name: length for name, length in lengths.items() if length > 400} == {}


def long_functions(text: str) -> list[tuple[str, int, int]]:
    """Functions that are too long, and their lines: without their docstring, and with it."""
    return [
        (name, lines, whole)
        for name, lines, whole in outline(text).functions
        if lines > 60 or whole > 80
    ]


def test_no_function_is_longer_than_60_lines_and_80_with_its_docstring(checkout: Path) -> None:
    too_long = {
        name: found
        for name, text in committed_texts(checkout).items()
        if name.startswith("gpusim/") and name.endswith(".py") and (found := long_functions(text))
    }
    assert too_long == {}


def test_long_functions_are_found() -> None:
    def function(name: str, statements: int, documented: int) -> str:
        docstring = '    """Said' + "\n" * (documented - 1) + '    """\n' if documented else ""
        return f"def {name}():\n{docstring}" + "    x = 1\n" * statements

    allowed = function("most", 59, 20) + function("undocumented", 59, 0)
    assert long_functions(allowed) == []
    code = function("body", 60, 0) + function("body", 1, 0) + "async " + function("whole", 59, 21)
    method = function("method", 61, 1).replace("\n", "\n    ")
    assert long_functions(f"{allowed}{code}class C:\n    {method}") == [
        ("body", 61, 61),
        ("whole", 60, 81),
        ("method", 62, 63),
    ]


def test_requirements_and_imports_agree(checkout: Path) -> None:
    names = {"cv2": "opencv-contrib-python-headless", "PIL": "pillow", "pydantic_core": "pydantic"}
    names |= {"mpl_toolkits": "matplotlib", "yaml": "pyyaml"}
    imported = set()
    for path in sorted((checkout / "gpusim").rglob("*.py")):
        for node in outline(path.read_text(encoding="utf-8")).imports:
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif not node.level and node.module:
                imported.add(node.module.split(".")[0])
    imported -= set(sys.stdlib_module_names) | {"gpusim"}
    project = tomllib.loads((checkout / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split(r"[\[<>=!~; ]", entry)[0].lower() for entry in project["dependencies"]}
    optional = project["optional-dependencies"]
    extras = {
        re.split(r"[\[<>=!~; ]", entry)[0].lower()
        for extra, entries in optional.items()
        if extra != "dev"
        for entry in entries
    }
    assert {names.get(name, name).lower() for name in imported} == declared | extras
    constraints = (checkout / "constraints.txt").read_text(encoding="utf-8").lower()
    pinned = {line.split("==")[0] for line in constraints.splitlines() if "==" in line}
    development = optional["dev"]
    declared |= extras
    declared |= {re.split(r"[\[<>=!~; ]", entry)[0].lower() for entry in development}
    assert declared <= pinned
