"""What documents, docstrings and comments name exists: files, modules, and what modules hold."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import gpusim

PACKAGE = Path(gpusim.__file__).parent


def texts(checkout: Path) -> Iterator[tuple[str, str]]:
    """Those that speak of the code, each with its place."""
    pages = [checkout / "README.md", checkout / "CONTRIBUTING.md"]
    for folder, ending in (("docs", "md"), ("gpusim", "py"), ("shaders", "wgsl")):
        pages += sorted((checkout / folder).rglob(f"*.{ending}"))
    for page in pages:
        yield page.relative_to(checkout).as_posix(), page.read_text(encoding="utf-8")


def missing_files(text: str, files: set[str]) -> list[str]:
    """`name.py`, `folder/name.wgsl`: which of ``files`` (paths after a slash) aren't there."""
    named = re.findall(r"`([\w/]+\.(?:py|wgsl))`", text)
    return [name for name in named if not any(file.endswith(f"/{name}") for file in files)]


def missing_modules(text: str) -> list[str]:
    """`gpusim.optics.shadow.brute_force.shares_of`: the module, and the first name in it."""
    missing = []
    for name in re.findall(r"`(gpusim(?:\.\w+)+)`", text):
        place, left = PACKAGE, name.split(".")[1:]
        while left and (place / left[0]).is_dir():
            place /= left.pop(0)
        module = place / f"{left[0]}.py" if left else place
        if left and module.is_file():
            place = module
            left.pop(0)
        source = place if place.is_file() else place / "__init__.py"
        if left and not re.search(rf"\b{left[0]}\b", source.read_text(encoding="utf-8")):
            missing.append(name)
    return missing


def test_what_is_named_exists(checkout: Path) -> None:
    folders = ("gpusim", "shaders", "tests", "benchmarks", "scripts")
    files = {f"/{path.relative_to(checkout).as_posix()}"
             for folder in folders for path in (checkout / folder).rglob("*.*")}  # fmt: skip
    faults = {page: missing_files(text, files) + missing_modules(text)
              for page, text in texts(checkout)}  # fmt: skip
    assert {page: names for page, names in faults.items() if names} == {}


@pytest.mark.parametrize(
    "name",
    ["optics/checker_fields.py", "gpusim.optics.nowhere", "gpusim.optics.frame.Nothing"],
)
def test_a_name_of_nothing_is_seen(name: str) -> None:
    assert missing_files(f"`{name}`", {"/gpusim/optics/frame.py"}) + missing_modules(f"`{name}`")
