"""The README tells the truth: its example runs, its links and commands exist."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import gpusim


@pytest.fixture(scope="module")
def readme(checkout: Path) -> str:
    return (checkout / "README.md").read_text(encoding="utf-8")


def test_python_example_runs(readme: str, tmp_path: Path) -> None:
    (example,) = re.findall(r"^```python\n(.*?)^```", readme, re.MULTILINE | re.DOTALL)
    lines = [line for line in example.splitlines() if line.strip()]
    assert len(lines) <= 15, "longer than anybody reads"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", example],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(gpusim.__file__).parents[1])},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    expected = re.findall(r"print\(.*# -> (.*)$", example, re.MULTILINE)
    assert expected and done.stdout.split() == " ".join(expected).split()


def test_links_lead_somewhere(readme: str, checkout: Path) -> None:
    links = [link.split("#")[0] for link in re.findall(r"\]\(([^)]+)\)", readme)]
    assert links
    missing = [x for x in links if not x.startswith("http") and not (checkout / x).exists()]
    assert missing == []


def test_make_targets_exist(readme: str, checkout: Path) -> None:
    makefile = (checkout / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([\w-]+):", makefile, re.MULTILINE))
    named = set(re.findall(r"(?:`|^)make (\w+)", readme, re.MULTILINE))
    assert {"demo", "test"} <= named <= targets
