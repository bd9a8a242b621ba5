"""Colours of paint: what is accepted, and the grey paints of the three bands."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.surface import paint as paints
from gpusim.surface.color import BANDS, color, grey, in_band, is_colored
from gpusim.surface.features import Features

LOW, HIGH = np.zeros(2), np.array([1.0, 0.7])
PLACES = np.array([[0.2, 0.3], [0.7, 0.4]])
TAN = "#c0a080"
LINEAR = (0.527115, 0.351533, 0.215861)
"""Of TAN by the sRGB curve: IEC 61966-2-1 at 192, 160 and 128 of 255."""

PAINTS: dict[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "Plain": (paints.Plain, ("albedo",)),
    "Checker": (lambda **k: paints.Checker(0.1, 4, 3, **k), ("dark", "light", "ground")),
    "Dots": (lambda **k: paints.Dots(0.03, 0.1, **k), ("albedo", "ground")),
    "Markers": (lambda **k: paints.Markers(PLACES, 0.1, **k), ("dark", "light", "ground")),
    "Circles": (lambda **k: paints.Circles(PLACES, (0.3, 0.2), **k), ("dark", "light", "ground")),
    "Lines": (lambda **k: paints.Lines(0.1, 0.01, **k), ("albedo", "ground")),
    "Star": (lambda **k: paints.Star(PLACES, 0.1, 8, **k), ("dark", "light", "ground")),
    "Aruco": (lambda **k: paints.Aruco(PLACES, (3, 7), 0.1, **k), ("dark", "light", "ground")),
    "Charuco": (lambda **k: paints.Charuco(5, 4, 0.1, 0.07, **k), ("dark", "light", "ground")),
    "RingCodes": (lambda **k: paints.RingCodes(PLACES, (11, 5), 0.05, **k), ("dot", "ground")),
    "Speckle": (lambda **k: paints.Speckle(0.03, seed=4, **k), ("dot", "ground")),
    "Image": (
        lambda **k: paints.Image(np.arange(35.0).reshape(5, 7) / 35.0, 0.1, **k),
        ("dark", "light", "ground"),
    ),
}


def test_every_paint_is_tried() -> None:
    """`Bump`, `Features` and `Paint` are no paints."""
    assert set(PAINTS) == set(paints.__all__) - {"Bump", "Features", "Paint"}


@pytest.mark.parametrize("kind", PAINTS)
def test_a_band_is_the_grey_paint_of_its_albedos(kind: str) -> None:
    """Each field in turn, and all at once, so that none is mistaken for another."""
    make, names = PAINTS[kind]
    plain = make()
    assert not plain.colored and not is_colored(plain)
    assert plain.in_band(2) is plain and in_band(plain, 0) is plain
    for chosen in [(name,) for name in names] + [names]:
        values = {name: (0.1 + 0.02 * k, 0.3, 0.6 - 0.03 * k) for k, name in enumerate(chosen)}
        colored = make(**values)
        assert colored.colored and is_colored(colored)
        for band in BANDS:
            got = colored.in_band(band)
            assert type(got) is type(plain) and not got.colored
            assert got is colored.in_band(band) is in_band(colored, band)
            want = make(**{name: value[band] for name, value in values.items()})
            for name in names:
                assert getattr(got, name) == getattr(want, name)
            same_features(got.features(LOW, HIGH), want.features(LOW, HIGH))


def same_features(got: Features | None, want: Features | None) -> None:
    if want is None:
        assert got is None
        return
    assert got is not None
    for name, value in vars(want).items():
        np.testing.assert_array_equal(getattr(got, name), value)


def test_what_a_colour_may_be_written_as() -> None:
    for value in (TAN, TAN.upper(), list(LINEAR), LINEAR, np.array(LINEAR)):
        wall = gs.paint.Plain(value)
        assert isinstance(wall.albedo, tuple) and wall.ground == wall.albedo
        np.testing.assert_allclose(wall.albedo, LINEAR, atol=5e-7)
    for value in (0.25, [0.25] * 3, np.full(3, 0.25), np.float32(0.25)):
        assert gs.paint.Plain(value) == gs.paint.Plain(0.25)
        assert type(gs.paint.Plain(value).albedo) is float
    assert gs.paint.Plain("#808080").albedo == pytest.approx(0.2158605)
    assert color("#ffffff") == 1.0 and color("#000000") == 0.0
    np.testing.assert_allclose(color("#010a0b"), (1 / 3294.6, 0.0030353, 0.0033465), rtol=1e-4)


@pytest.mark.parametrize(
    "value",
    ["grey", "#fff", "#gg0000", "c0a080", b"abc", True, [0.1, 0.2], [0.1, 0.2, 1.2],
     ["1", "0", "0"], [0.1, np.nan, 0.3], [-0.1, 0.2, 0.3], np.zeros((3, 3)),
     [[0.1], [0.2, 0.3]], {}, None, 1.5, np.array("x"), [0.1, 0.2, True]],
)  # fmt: skip
def test_what_is_no_albedo(value: Any) -> None:
    with pytest.raises(InputError, match=r"(?s)Dots ground; got .*; expected an albedo from 0 to"):
        gs.paint.Dots(0.1, 0.2, ground=value)


def test_coloured_paints_are_values() -> None:
    """Tables are filed by equality, and paints are sent to other processes."""
    one, same = (paints.Speckle(0.03, dot=TAN, ground=[0.9, 0.8, 0.7]) for _ in range(2))
    assert one == same and hash(one) == hash(same) and one != replace(one, dot=0.05)
    assert one.in_band(1) == same.in_band(1) != one.in_band(2)
    sent = pickle.loads(pickle.dumps(one))
    assert sent == one and sent.in_band(2) == one.in_band(2)
    assert repr(paints.Image(np.eye(2), 1.0, dark=TAN)).endswith("dark=(0.5271, 0.3515, 0.2159))")


def test_a_coloured_paint_has_no_features_itself() -> None:
    for kind in ("Checker", "Dots", "Circles", "Lines", "Charuco", "RingCodes", "Speckle"):
        make, names = PAINTS[kind]
        with pytest.raises(InputError, match=r"colour; got \(.*expected grey: the paint's in_band"):
            make(**{name: TAN for name in names}).features(LOW, HIGH)
    assert grey(0.3) == 0.3


class Foreign:
    """A paint as a user might write one, without a word of colour."""

    ground = 0.4

    def features(self, low: np.ndarray, high: np.ndarray) -> None:
        return None


def test_a_paint_that_knows_no_colour_is_grey() -> None:
    own = Foreign()
    assert not is_colored(own) and in_band(own, 1) is own
    assert gs.Surface(np.eye(3), [[0, 1, 2]], paint=own).extents == {}


def test_surfaces_carry_coloured_patterns() -> None:
    points = np.array([[-1.0, 0, -0.5], [1, 0, -0.5], [1, 0, 0.5], [-1, 0, 0.5]])
    wall = gs.Surface(points, [[0, 1, 2, 3]], paint=gs.paint.Dots(0.1, 0.2, albedo=TAN))
    low, high = wall.extents[0]
    np.testing.assert_allclose(high - low, [2.0, 1.0])
    moved = wall.moved(points + np.array([0, 0.3, 0]))
    assert moved.paints is wall.paints and set(moved.frames) == {"surface"}
    assert gs.Surface(points, [[0, 1, 2, 3]], paint=gs.paint.Plain(TAN)).extents == {}


# -- bitmaps --------------------------------------------------------------------------------------


def test_bands_of_a_coloured_bitmap() -> None:
    pixels = np.random.default_rng(3).integers(0, 65536, (5, 7, 3)).astype(np.uint16)
    dark, light = (0.02, 0.04, 0.06), (0.9, 0.8, 0.7)
    image = gs.paint.Image(pixels, 0.1, dark=dark, light=light, gamma="srgb", ground=0.3)
    assert image.colored and image.size == (pytest.approx(0.7), 0.5)
    assert image.albedo().shape == (5, 7, 3)
    share = np.where(
        pixels > 2650, ((pixels / 65535 + 0.055) / 1.055) ** 2.4, pixels / 65535 / 12.92
    )
    np.testing.assert_allclose(
        image.albedo(), dark + (np.array(light) - dark) * share, rtol=1e-13, atol=0
    )
    for band in BANDS:
        want = gs.paint.Image(
            pixels[..., band], 0.1, dark=dark[band], light=light[band], gamma="srgb", ground=0.3
        )
        got = image.in_band(band)
        assert got.levels is image.in_band(band).levels  # found once
        for a, b in zip(got.levels, want.levels, strict=True):
            np.testing.assert_array_equal(a.coefficients, b.coefficients)


def test_equal_channels_are_a_grey_bitmap() -> None:
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    image = gs.paint.Image(np.repeat(pixels[..., None], 3, axis=2), 0.1)
    assert not image.colored and image.in_band(1) is image
    np.testing.assert_array_equal(image.pixels, pixels)
    with pytest.raises(InputError, match=r"of shape \(3, 4, 2\); expected one grey picture \(H, W"):
        gs.paint.Image(np.zeros((3, 4, 2), np.uint8), 0.1)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp"])
def test_files_keep_their_colours(tmp_path: Path, suffix: str) -> None:
    pixels = np.random.default_rng(5).integers(0, 256, (9, 13, 3)).astype(np.uint8)
    path, alpha = tmp_path / f"c{suffix}", np.full((9, 13, 1), 80, np.uint8)
    for bgr in (pixels[..., ::-1], np.concatenate([pixels[..., ::-1], alpha], axis=2)):
        cv2.imwrite(str(path), bgr)
        np.testing.assert_array_equal(gs.paint.Image.read(path, 0.1).pixels, pixels)
        luma = gs.paint.Image.read(path, 0.1, channels="grey").albedo()
        np.testing.assert_allclose(luma, pixels / 255 @ [0.299, 0.587, 0.114], atol=1e-15)
    with pytest.raises(InputError, match="channels; got 'mono'; expected 'rgb' or 'grey'"):
        gs.paint.Image.read(path, 0.1, channels="mono")


@pytest.mark.parametrize(
    ("suffix", "dtype"),
    [(".png", np.uint8), (".tif", np.uint8), (".bmp", np.uint8), (".jpg", np.uint8),
     (".png", np.uint16), (".tif", np.uint16)],
)  # fmt: skip
def test_grey_files_are_read_as_before(tmp_path: Path, suffix: str, dtype: type) -> None:
    """Stored in one channel or in three equal ones: what OpenCV's own conversion gives."""
    pixels = np.random.default_rng(6).integers(0, np.iinfo(dtype).max, (9, 13)).astype(dtype)
    for name, stored in (("one", pixels), ("three", np.repeat(pixels[..., None], 3, axis=2))):
        path = tmp_path / f"{name}{suffix}"
        cv2.imwrite(str(path), stored)
        want = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE)
        got = gs.paint.Image.read(path, 0.1)
        assert not got.colored and got.pixels.dtype == dtype
        np.testing.assert_array_equal(got.pixels, want)
