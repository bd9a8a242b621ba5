"""Lenses refitted to what a format has, and what is said of how far off they are."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from tests.support.optics_rigs import rig

FORMATS = ("opencv", "kalibr", "matchid", "vic", "dice")
LENS = [-0.12, 0.08, 9e-4, -7e-4, 0.03]


def camera(distortion: list[float] | None, skew: float = 0.0) -> gs.Camera:
    base, _ = rig("off centre", 1)
    K = base.K.copy()
    K[0, 1] = skew
    return gs.Camera(base.width, base.height, K, distortion, base.camera_from_world, "left")


def seen(of: gs.Camera, count: int = 4000) -> np.ndarray:
    """Points (n, 3) of the scene, at any depth, that fill the image."""
    rng = np.random.default_rng(8)
    pixels = rng.uniform([-0.5, -0.5], [of.width - 0.5, of.height - 0.5], (count, 2))
    rays = np.c_[of.undistort(pixels), np.ones(count)] @ of.ray_matrix().T
    inside = rng.uniform(0.3, 3.0, (count, 1)) * rays - of.camera_from_world[:3, 3]
    return inside @ of.camera_from_world[:3, :3]


@pytest.mark.parametrize("format", FORMATS)
def test_a_lens_that_the_format_holds_stays(format: str) -> None:
    plain = camera([0.1, -0.05, 0.0, 0.0])
    fit = gs.fit_lens(plain, format)
    assert fit.camera is plain and (fit.rms, fit.largest, fit.words) == (0.0, 0.0, "")


@pytest.mark.parametrize(
    ("format", "distortion", "skew", "lacks", "most"),
    [
        ("vic", LENS, 0.0, "p1 p2", 0.8),
        ("kalibr", LENS, 0.0, "k3", 0.51),
        ("kalibr", LENS[:4], 2.0, "skew", 0.78),
        ("opencv", LENS, 2.0, "skew", 0.29),
        ("matchid", [*LENS, 0.04, -0.02, 0.01], 0.0, "k4 k5 k6", 1e-2),
        ("vic", [*LENS, 0.0, 0.0, 0.0, 1e-3, 0.0, 5e-4, 0.0], 0.0, "p1 p2 s1 s3", 0.97),
    ],
)
def test_what_is_said_of_a_fit_is_so(
    format: str, distortion: list[float], skew: float, lacks: str, most: float
) -> None:
    """At points that the fit has not seen, near and far: the position is the camera's own."""
    true = camera(distortion, skew)
    fit = gs.fit_lens(true, format)
    points = seen(true)
    off = np.linalg.norm(fit.camera.project(points) - true.project(points), axis=1)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(
        fit.rms, rel=0.3
    )  # the fit looks at borders, too
    assert off.max() <= 1.02 * fit.largest <= 1.02 * most
    np.testing.assert_allclose(fit.camera.eye, true.eye, atol=1e-12)
    turned = gs.Camera(10, 10, np.eye(3), None, fit.camera.camera_from_world).to_camera(true.eye)
    assert np.abs(turned).max() <= 1e-12
    cosine = fit.camera.camera_from_world[2, :3] @ true.camera_from_world[2, :3]
    assert (
        np.degrees(np.arccos(cosine)) <= float(fit.words.split(" turned by ")[1].split()[0]) + 1e-4
    )
    assert fit.words.startswith(f"{format} has no {lacks}: lens refitted, camera turned by ")
    assert fit.words.endswith(f", off by RMS {fit.rms:.4f} px, {fit.largest:.4f} px at most")


def test_a_fit_is_the_nearest() -> None:
    """No coefficient, angle or length changed a little comes nearer."""
    true = camera(LENS)
    fit = gs.fit_lens(true, "vic")
    points = seen(true)
    where = true.project(points)

    def rms(other: gs.Camera) -> float:
        return float(np.sqrt(np.mean(np.sum((other.project(points) - where) ** 2, axis=1))))

    own, K, pose = rms(fit.camera), fit.camera.K, fit.camera.camera_from_world
    assert own < 0.25 * rms(camera([LENS[0], LENS[1], 0.0, 0.0, LENS[4]]))  # p1 p2 left out
    lens = np.asarray(fit.camera.distortion)
    for row, column in ((0, 0), (1, 1), (0, 2), (1, 2)):
        for step in (-0.3, 0.3):
            moved = K.copy()
            moved[row, column] += step
            shape = fit.camera.width, fit.camera.height
            assert rms(gs.Camera(*shape, moved, lens, pose)) > own
    for place in (0, 1, 4):
        for step in (-3e-3, 3e-3):
            bent = lens.copy()
            bent[place] += step
            assert rms(gs.Camera(*shape, K, bent, pose)) > own


def test_refusals() -> None:
    with pytest.raises(InputError, match="fit_lens: format; got 'vic2'; expected one of"):
        gs.fit_lens(camera(None), "vic2")
    with pytest.raises(InputError, match=r"k3, all that .*gs.fit_lens\(camera, 'vic'\)"):
        gs.write_calibration("none.xml", [camera(LENS)], "vic")
