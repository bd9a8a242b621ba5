"""Demosaicing against OpenCV, the published filters and pictures that linear filters give back."""

from __future__ import annotations

from fractions import Fraction

import cv2
import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.optics.sensor.channels import picked
from gpusim.optics.sensor.demosaicing import METHODS, TILES, demosaiced

HEIGHT, WIDTH = 33, 58
INNER = np.s_[2:-2, 2:-2]


def mosaic_of(picture: npt.NDArray[np.generic], bayer: str) -> npt.NDArray[np.generic]:
    return picked([np.ascontiguousarray(picture[..., k]) for k in range(3)], bayer)


@pytest.mark.parametrize("bayer", sorted(TILES))
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_bilinear_is_opencv_s(bayer: str, kind: type[np.unsignedinteger]) -> None:
    """OpenCV names a pattern by its second row and column, and rounds halves up."""
    rng = np.random.default_rng(2)
    mosaic = rng.integers(0, np.iinfo(kind).max, (HEIGHT, WIDTH), kind, endpoint=True)
    code = {"RGGB": cv2.COLOR_BayerBG2RGB, "BGGR": cv2.COLOR_BayerRG2RGB,
            "GRBG": cv2.COLOR_BayerGB2RGB, "GBRG": cv2.COLOR_BayerGR2RGB}[bayer]  # fmt: skip
    want = cv2.demosaicing(mosaic, code).astype(np.float64)
    got = demosaiced(mosaic, bayer, "bilinear")
    assert np.array_equal(np.floor(got + 0.5)[INNER], want[INNER])


def test_filters_of_malvar_are_the_published_ones() -> None:
    """Figure 2 of the paper, in eighths; each passes a constant."""
    eighths = {
        "green": "0 0 -1 0 0  0 0 2 0 0  -1 2 4 2 -1  0 0 2 0 0  0 0 -1 0 0",
        "row": "0 0 1/2 0 0  0 -1 0 -1 0  -1 4 5 4 -1  0 -1 0 -1 0  0 0 1/2 0 0",
        "opposite": "0 0 -3/2 0 0  0 2 0 2 0  -3/2 0 6 0 -3/2  0 2 0 2 0  0 0 -3/2 0 0",
    }
    for name, text in eighths.items():
        published = np.array([float(Fraction(word)) / 8 for word in text.split()]).reshape(5, 5)
        assert np.array_equal(getattr(METHODS["malvar"], name), published), name
        assert published.sum() == 1.0


@pytest.mark.parametrize("bayer", sorted(TILES))
@pytest.mark.parametrize("method", sorted(METHODS))
def test_what_is_linear_comes_back(bayer: str, method: str) -> None:
    """Three ramps of different slope and direction; grey ones for Malvar, whose correction takes
    the slopes of all channels for equal."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    ramps = [3.0 * x + 7.0 * y + 20.0, 2.0 * x - 4.0 * y + 300.0, -5.0 * x + y + 400.0]
    picture = np.stack(ramps, axis=2)
    got = demosaiced(mosaic_of(picture, bayer), bayer, method)
    assert np.abs(got - picture)[INNER].max() <= 1e-3
    # a parabola bends: only the correction by another channel gives its bend back
    bent = np.repeat((0.3 * (x - 20) ** 2 + 0.1 * y)[..., None], 3, axis=2)
    error = np.abs(demosaiced(mosaic_of(bent, bayer), bayer, method) - bent)[INNER].max()
    assert error == pytest.approx(0.3 if method == "bilinear" else 0.15, rel=1e-3)


def test_malvar_is_better_on_a_picture() -> None:
    """Of a star, whose edges lie at all angles, blurred as by a lens; PSNR as in the paper."""
    y, x = np.mgrid[:201, :240].astype(np.float64)
    star = np.sin(14 * np.arctan2(y - 90, x - 110)) > 0
    share = cv2.GaussianBlur(star.astype(np.float64), (0, 0), 0.9)[..., None]
    picture = 255 * ((1 - share) * [0.75, 0.7, 0.6] + share * [0.1, 0.15, 0.2])

    def psnr(method: str) -> float:
        got = demosaiced(mosaic_of(picture, "GRBG"), "GRBG", method)
        return float(10 * np.log10(255**2 / np.mean((got - picture)[INNER] ** 2)))

    assert psnr("malvar") > psnr("bilinear") + 4.0


@pytest.mark.parametrize("method", sorted(METHODS))
def test_a_sensor_demosaics_digital_numbers(method: str) -> None:
    """A flat coloured frame comes back from its mosaic, of the sensor's depth."""
    camera = gs.Camera(57, 33, np.diag([50.0, 50.0, 1.0]))
    view = gs.render([gs.Surface([[0, 0, 5], [1, 0, 5], [0, 1, 5]], [[0, 1, 2]])], camera,
                     backend="numpy").view  # fmt: skip
    flat = [
        gs.Frame(view, None, radiance=np.full((33, 57), v, np.float32)) for v in (0.2, 0.7, 0.4)
    ]
    frame = gs.Frame.of_planes(flat)
    sensor = gs.Sensor(12, channels="rgb", bayer="BGGR", demosaic=method, white_balance=(2, 1, 1.5))
    image = sensor.expose(frame)
    assert image.shape == (33, 57, 3) and image.dtype == np.uint16
    assert np.unique(image.reshape(-1, 3), axis=0).tolist() == [
        [round(4095 * v) for v in (0.4, 0.7, 0.6)]
    ]
