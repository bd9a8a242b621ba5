"""Pictures in colour are measured by their luminance, in every function and from every file."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.arrays.grey import LUMINANCE, grey_of
from gpusim.export.images import write_image
from gpusim.files.picture_file import read_grey


def speckle(shift: float) -> npt.NDArray[np.uint8]:
    """(60, 90) grey, moved along x."""
    y, x = np.mgrid[:60, :90].astype(np.float64)
    waves = np.random.default_rng(7).uniform(-0.9, 0.9, (40, 3)) * [1, 1, 20]
    value = sum(np.cos(a * (x - shift) + b * y + c) for a, b, c in waves)
    return np.rint(128 + 14 * np.clip(np.asarray(value), -9, 9)).astype(np.uint8)


def colored(shift: float) -> npt.NDArray[np.uint8]:
    """Green moves by ``shift``; blue and red stand still and have a little of the contrast."""
    still = 110 + speckle(0.0) // 16
    return np.dstack([still, speckle(shift), 200 - still]).astype(np.uint8)


def test_weights_are_those_of_bt_709() -> None:
    """Item 3 of the recommendation: the luminance of a grey picture is itself."""
    assert LUMINANCE == (0.2126, 0.7152, 0.0722) and sum(LUMINANCE) == pytest.approx(1.0)
    picture = colored(0.3)
    want = picture.astype(np.float64) @ LUMINANCE
    assert np.abs(grey_of(picture) - want).max() <= 1e-4 and grey_of(picture).dtype == np.float32
    assert grey_of(picture.astype(np.float64)).dtype == np.float64
    grey = np.dstack(3 * [speckle(0.0)])
    assert np.array_equal(grey_of(grey), speckle(0.0)) and grey_of(grey).dtype == np.uint8


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_files_give_the_same_grey(tmp_path: Path, name: str) -> None:
    picture = colored(0.0)
    write_image(tmp_path / name, picture)
    assert np.array_equal(read_grey(tmp_path / name), grey_of(picture))
    clear = np.dstack([picture[..., ::-1], np.full((60, 90), 9, np.uint8)])
    cv2.imwrite(str(tmp_path / "clear.png"), clear)
    assert np.array_equal(read_grey(tmp_path / "clear.png"), grey_of(picture))


def test_correlation_takes_the_luminance() -> None:
    before, after = colored(0.0), colored(0.25)
    options = {"points": [[45, 30]], "subset": 31, "backend": "numpy"}
    found = gs.measure.dic(before, after, **options)
    grey = gs.measure.dic(grey_of(before), grey_of(after), **options)
    assert np.array_equal(found.displacement, grey.displacement)
    assert found.displacement[0] == pytest.approx([0.25, 0.0], abs=0.03)
    (last,) = gs.measure.dic_sequence(before, [after], **options)
    assert np.array_equal(found.displacement, last.displacement)


def test_a_channel_at_full_scale_is_saturated() -> None:
    before, after = colored(0.0), colored(0.25)
    before[20:40, 30:60, 0] = 255
    found = gs.measure.dic(before, after, points=[[45, 30], [15, 30]], subset=21, backend="numpy")
    assert [gs.measure.Status(s).name for s in found.status] == ["SATURATED", "OK"]


def test_targets_in_colour() -> None:
    board = gs.measure.Chessboard(7, 5, 10.0)
    cells = (np.indices((5, 7)).sum(axis=0) % 2).repeat(20, axis=0).repeat(20, axis=1)
    large = np.pad(cells, 30, constant_values=1)[..., None]
    picture = np.where(large == 1, [250, 220, 160], [20, 40, 60]).astype(np.uint8)
    picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8))
    seen = gs.measure.find_chessboard(picture, board)
    x, y = np.meshgrid(29.5 + 20 * np.arange(1, 7), 29.5 + 20 * np.arange(1, 5))
    want = np.stack([x.ravel(), y.ravel()], axis=1)
    order = np.lexsort((seen.image[:, 0], seen.image[:, 1] // 20))
    assert np.abs(seen.image[order] - want).max() <= 0.02
