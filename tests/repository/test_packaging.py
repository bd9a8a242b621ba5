"""The wheel holds everything that a run needs, and says its version."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from importlib.metadata import entry_points, version
from pathlib import Path

import pytest

import gpusim


@pytest.fixture(scope="module")
def wheel(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=checkout, check=True, capture_output=True)
    (path,) = folder.glob("gpusim-*.whl")
    assert path.name == f"gpusim-{gpusim.__version__}-py3-none-any.whl"
    return zipfile.ZipFile(path)


def test_wheel_holds_every_source_file_and_nothing_else(
    wheel: zipfile.ZipFile, checkout: Path
) -> None:
    expected = {
        ("" if folder == "gpusim" else "gpusim/") + path.relative_to(checkout).as_posix()
        for folder in ("gpusim", "shaders", "examples")
        for path in (checkout / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    found = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert found == expected
    suffixes = {Path(name).suffix for name in found}
    assert {".py", ".wgsl", ".typed"} <= suffixes
    assert any("gpusim/report/" in name and ".html" in name for name in found)


def test_wheel_metadata(wheel: zipfile.ZipFile) -> None:
    folder = f"gpusim-{gpusim.__version__}.dist-info"
    metadata = wheel.read(f"{folder}/METADATA").decode()
    assert "Requires-Python: >=3.11" in metadata
    assert "License-Expression: MIT" in metadata
    assert f"{folder}/licenses/LICENSE" in wheel.namelist()
    assert "gpusim = gpusim.__main__:main" in wheel.read(f"{folder}/entry_points.txt").decode()


@pytest.mark.parametrize("command", ["module", "script"])
def test_version_on_the_command_line(command: str) -> None:
    script = Path(sys.executable).with_name("gpusim")
    if command == "script" and not script.exists():
        pytest.skip("gpusim is not installed in this environment (`make test` installs it)")
    words = [sys.executable, "-m", "gpusim"] if command == "module" else [str(script)]
    done = subprocess.run([*words, "--version"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert gpusim.__version__ in done.stdout


def test_installed_version_is_the_packages() -> None:
    if not entry_points(group="console_scripts", name="gpusim"):
        pytest.skip("gpusim is not installed in this environment (`make test` installs it)")
    assert version("gpusim") == gpusim.__version__
