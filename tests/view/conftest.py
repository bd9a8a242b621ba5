"""A viewer of the small scene under a sun; the folder of its run."""

from __future__ import annotations

import copy
from pathlib import Path

import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.scene.toml_text import toml_text
from gpusim.view.viewer import Viewer
from tests.support.small_scene import DOCUMENT
from tests.support.viewing import LIGHT, SIZE


@pytest.fixture
def scene_path(tmp_path: Path) -> Path:
    path = tmp_path / "bar.toml"
    path.write_text(toml_text({**DOCUMENT, "light": LIGHT}), encoding="utf-8")
    return path


@pytest.fixture
def viewer(device: Device, scene_path: Path):  # type: ignore[no-untyped-def]
    made = Viewer(device, scene_path, SIZE, solve=False)
    assert made.fault == ""
    yield made
    made.close()


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """OUT of a run whose stress isn't written."""
    document = copy.deepcopy(DOCUMENT)
    document["output"] |= {"stress": False, "truth": ["depth", "displacement", "flow", "reference"]}
    folder = tmp_path_factory.mktemp("run")
    (folder / "bar.toml").write_text(toml_text(document), encoding="utf-8")
    gs.run(gs.load_scene(folder / "bar.toml"), folder / "out")
    assert not (folder / "out" / "solution" / "stress.npz").exists()
    return folder / "out"


@pytest.fixture
def run_viewer(device: Device, run_folder: Path):  # type: ignore[no-untyped-def]
    made = Viewer(device, run_folder, (480, 320))
    assert made.fault == ""
    yield made
    made.close()
