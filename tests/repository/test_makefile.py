"""What people are told to type works: the Makefile's targets, and the paths in documents."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

HERE = {"clean"}
"""Targets that a test of this file runs, in place of .ci/run."""

needs_make = pytest.mark.skipif(shutil.which("make") is None, reason="no make")


def targets(makefile: str) -> dict[str, set[str]]:
    """Each with those that it runs: its prerequisites, and what it makes itself."""
    rules = re.findall(r"^([\w-]+):(.*)\n((?:\t.*\n)*)", makefile, re.MULTILINE)
    return {
        name: {*before.split(), *re.findall(r"\$\(MAKE\) ([\w-]+)", recipe)}
        for name, before, recipe in rules
    }


def run_by(script: str, makefile: str) -> set[str]:
    """Targets that a shell script's lines make, and those that these run."""
    lines = re.findall(r"^(?:\w+=(?:\"[^\"]*\"|\S*) )*make ([\w -]+)", script, re.MULTILINE)
    rules = targets(makefile)
    left = [name for line in lines for name in line.split()]
    run: set[str] = set()
    while left:
        run.add(name := left.pop())
        left += rules[name] - run
    return run


def missing_paths(text: str, checkout: Path) -> set[str]:
    """Words of shell commands that are paths of the repository, or modules for ``-m``, and aren't
    there."""
    paths = set(re.findall(r"(?<![\w./-])(?:tests|scripts|examples|docs|shaders)\b[\w./*-]*", text))
    modules = {name.replace(".", "/") for name in re.findall(r"-m (benchmarks[.\w]*)", text)}
    paths |= set(re.findall(r"(?<![\w./-])benchmarks/[\w./*-]*", text))
    missing = {name for name in paths if not any(checkout.glob(name))}
    return missing | {
        name
        for name in modules
        if not (checkout / f"{name}.py").is_file()
        and not (checkout / name / "__main__.py").is_file()
    }


def commands(page: str) -> str:
    """The shell commands of a document: its blocks of code, and what stands between backticks."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    return "\n".join([*blocks, *re.findall(r"`((?:make|python|scripts/|tests/)[^`\n]*)`", page)])


@pytest.fixture(scope="module")
def makefile(checkout: Path) -> str:
    return (checkout / "Makefile").read_text(encoding="utf-8")


def test_every_target_is_run(makefile: str, checkout: Path) -> None:
    script = (checkout / ".ci" / "run").read_text(encoding="utf-8")
    assert set(targets(makefile)) == run_by(script, makefile) | HERE


def test_a_target_that_nobody_runs_is_seen() -> None:
    makefile = (
        "all: lint\n\t$(MAKE) test\n\nlint test:\n\ntest:\n\tpytest\n\nlint:\n\nquick: lint\n"
    )
    assert set(targets(makefile)) == {"all", "test", "lint", "quick"}
    assert run_by('A="b c" make all\nstep "make quick"\n', makefile) == {"all", "lint", "test"}


@needs_make
def test_paths_of_targets_exist(makefile: str, checkout: Path) -> None:
    for name in targets(makefile):
        said = subprocess.run(
            ["make", "-n", name], cwd=checkout, capture_output=True, text=True, check=True
        )
        assert missing_paths(said.stdout, checkout) == set(), name


@needs_make
def test_clean_takes_away_what_was_made(checkout: Path, tmp_path: Path) -> None:
    shutil.copy(checkout / "Makefile", tmp_path)
    for name in ("build", "out", ".venv", "gpusim"):
        (tmp_path / name / "inner").mkdir(parents=True)
    subprocess.run(["make", "clean"], cwd=tmp_path, capture_output=True, check=True)
    assert {path.name for path in tmp_path.iterdir()} == {"Makefile", "gpusim"}


def test_paths_in_documents_exist(makefile: str, checkout: Path) -> None:
    pages = [checkout / "README.md", checkout / "CONTRIBUTING.md", *checkout.rglob("docs/**/*.md")]
    assert len(pages) > 60
    for page in pages:
        typed = commands(page.read_text(encoding="utf-8"))
        assert missing_paths(typed, checkout) == set(), page.name
        assert set(re.findall(r"\bmake ([\w-]+)", typed)) <= set(targets(makefile)), page.name


def test_a_path_of_nothing_is_seen(checkout: Path) -> None:
    page = "```sh\npytest tests/fem tests/optics/nowhere -k x # scripts/test.sh\n```\n"
    page += (
        "`python -m benchmarks.identical --write` `python -m benchmarks.nothing` `tests/none.py`"
    )
    missing = {"tests/optics/nowhere", "benchmarks/nothing", "tests/none.py"}
    assert missing_paths(commands(page), checkout) == missing
