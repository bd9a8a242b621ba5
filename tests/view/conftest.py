"""A viewer of the small scene under a sun."""

from __future__ import annotations

from pathlib import Path

import pytest

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
