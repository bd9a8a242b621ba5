"""Radiance in files: every number comes back by readers that aren't ours."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile

import gpusim as gs
from gpusim.errors import InputError
from gpusim.files.picture_file import decode

VALUES = np.random.default_rng(1).uniform(-1, 9, (33, 57, 3)).astype(np.float32)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("values", [VALUES, np.ascontiguousarray(VALUES[..., 1])])
def test_numbers_come_back(tmp_path: Path, values: np.ndarray, half: bool) -> None:
    exr = pytest.importorskip("OpenEXR")
    want = values.astype(np.float16) if half else values
    path = gs.export.write_radiance(tmp_path / "a.exr", values, half=half)
    with exr.File(str(path)) as file:
        channels = file.channels()
        assert list(channels) == ["RGB" if values.ndim == 3 else "Y"]
        got = next(iter(channels.values())).pixels
    assert got.dtype == want.dtype and np.array_equal(got, want)
    path = gs.export.write_radiance(tmp_path / "a.tiff", values, half=half)
    got = tifffile.imread(path)
    assert got.dtype == want.dtype and np.array_equal(got, want)
    assert np.array_equal(decode(path)[..., ::-1] if values.ndim == 3 else decode(path), want)


def test_a_coloured_frame(tmp_path: Path) -> None:
    camera = gs.Camera(57, 33, np.diag([50.0, 50.0, 1.0]))
    wall = gs.Surface([[-9, -9, 5], [9, -9, 5], [0, 9, 5]], [[0, 2, 1]])
    view = gs.render([wall], camera, backend="numpy").view
    planes = [gs.Frame(view, None, radiance=np.ascontiguousarray(VALUES[..., k])) for k in range(3)]
    path = gs.export.write_radiance(tmp_path / "a.tif", gs.Frame.of_planes(planes))
    assert np.array_equal(tifffile.imread(path), VALUES)


@pytest.mark.parametrize(
    ("name", "values", "half", "message"),
    [
        ("a.png", VALUES, False, "got suffix '.png'; expected .exr, .tif or .tiff"),
        ("a.tif", VALUES[..., :2], False, r"\(33, 57, 2\)"),
        ("a.tif", VALUES.astype(int), False, "expected a Frame, or floats"),
        ("a.tif", VALUES[:0], False, "at least one pixel"),
        ("a.tif", 1e5 * VALUES, True, "expected at most 65504 with half"),
    ],
)
def test_bad_input_writes_nothing(
    tmp_path: Path, name: str, values: np.ndarray, half: bool, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        gs.export.write_radiance(tmp_path / name, values, half=half)
    assert list(tmp_path.iterdir()) == []


def test_without_openexr_one_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(InputError, match=r"a\.exr: got no package OpenEXR.*gpusim\[exr\]"):
        gs.export.write_radiance(tmp_path / "a.exr", VALUES)
    assert list(tmp_path.iterdir()) == []
