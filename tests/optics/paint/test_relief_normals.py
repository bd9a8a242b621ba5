"""Fine relief against brute force: heights of the same waves, differentiated point by point."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim import render
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import AreaLight, Light, SunLight
from gpusim.optics.paint.relief_normals import Bumps
from gpusim.optics.shading.setup import Setup
from gpusim.surface.features import Bump
from gpusim.surface.paint import Plain
from gpusim.surface.surface import Surface

Array = npt.NDArray[np.float64]
FACE = np.array([[0, 1, 2, 3]])
SIDES = np.array([[-60.0, -50.0, 0.0], [55.0, -50.0, 0.0], [55.0, 45.0, 0.0], [-60.0, 45.0, 0.0]])
SUN = np.array([0.5, 0.3, -1.0])


def _camera(scale: int = 1) -> Camera:
    """Straight above the plate, which fills the picture: 0.5 mm a pixel, x and y as seen."""
    K = np.array([[200.0, 0.0, 0.0], [0.0, 200.0, 0.0], [0.0, 0.0, 1.0]]) * scale
    K[:2, 2] = scale * np.array([40.0, 30.0]) - 0.5
    K[2, 2] = 1.0
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[2, 3] = 100.0
    return Camera(80 * scale, 60 * scale, K, camera_from_world=pose)


def _means(image: npt.NDArray[np.floating], side: int) -> Array:
    rows, columns = image.shape
    blocks = image.reshape(rows // side, side, columns // side, side)
    return np.asarray(blocks.mean(axis=(1, 3)), np.float64)


def _brute_force(bump: Bump, albedo: float, rays: int) -> Array:
    """Radiance of a matte plate under a sun, the mean of ``rays`` x ``rays`` normals a pixel."""
    y, x = (np.mgrid[: 60 * rays, : 80 * rays] + 0.5) / rays
    at = np.stack([(x - 40.0) * 0.5, -(y - 30.0) * 0.5, 0.0 * x], axis=-1).reshape(-1, 3)
    step = 1e-4 * bump.length
    slopes = [
        (bump.heights(at + step * unit) - bump.heights(at - step * unit)) / (2.0 * step)
        for unit in np.eye(3)[:2]
    ]
    normal = np.stack([-slopes[0], -slopes[1], np.ones(len(at))], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    to_sun = -SUN / np.linalg.norm(SUN)
    light = np.maximum(normal @ to_sun, 0.0) * albedo / np.pi
    return _means(light.reshape(60 * rays, 80 * rays), rays)


@pytest.mark.parametrize(
    "bump",
    [
        pytest.param(Bump(0.06, 4.0, seed=2), marks=pytest.mark.slow),
        Bump(0.02, 0.9),
        Bump(0.01, 0.6, (1.0, 2.0, 0.5), 8.0, 7),
    ],
    ids=["resolved", "about a pixel", "brushed"],
)
def test_matte_relief_is_the_mean_over_each_pixel(device: Device, bump: Bump) -> None:
    surface = Surface(SIDES, FACE, paint=Plain(0.6, bump=bump))
    got = render([surface], _camera(), [SunLight(tuple(SUN), 1.0)]).radiance
    want = _brute_force(bump, 0.6, 8)
    smooth = 0.6 / np.pi / np.linalg.norm(SUN)
    assert np.std(want) > 2e-3 * smooth
    # the mean of normals of length 1 is shorter than 1 by half the variance of the slope
    variance = 2.0 * bump.slope**2
    assert np.abs(got - want).max() <= variance * smooth
    assert np.std(got - want) <= 0.05 * np.std(want)
    assert np.corrcoef(got.ravel(), want.ravel())[0, 1] > 0.999


def test_relief_below_the_pixel_makes_gloss_rougher(device: Device) -> None:
    lamp: list[Light] = [AreaLight((5.0, -3.0, 60.0), (2.0, 1.0, 0.0), (8.0, 8.0), 100.0)]
    bump = Bump(0.006, 0.1, seed=1)

    def image(relief: Bump | None, scale: int) -> Array:
        surface = Surface(SIDES, FACE, paint=Plain(0.7, 0.3, 1.0, relief))
        return _means(render([surface], _camera(scale), lamp).radiance, scale)

    smooth, coarse, fine = image(None, 1), image(bump, 1), image(bump, 16)
    peak = float(_means(fine, 4).max())
    apart = np.abs(_means(coarse, 4) - _means(fine, 4)).max()
    # a Gaussian relief on GGX's facets isn't quite GGX again
    assert apart < 0.22 * peak
    assert np.abs(_means(smooth, 4) - _means(fine, 4)).max() > 1.5 * peak
    assert abs(coarse.mean() / fine.mean() - 1.0) < 0.1


def test_relief_moves_with_the_material(device: Device) -> None:
    bump = Bump(0.06, 4.0)
    rest = Surface(SIDES, FACE, paint=Plain(0.6, bump=bump))
    sun: list[Light] = [SunLight(tuple(SUN), 1.0)]
    moved = rest.moved(SIDES + np.array([3.0, -2.0, 0.0]))  # 6 px to the right, 4 px down
    first, second = (render([s], _camera(), sun).radiance for s in (rest, moved))
    assert np.abs(second[4:, 6:] - first[:-4, :-6]).max() < 2e-6
    assert np.abs(second - first).max() > 1e-2 * first.mean()
    # pulled to twice its length it is half as steep across
    wide = rest.moved(SIDES * np.array([2.0, 1.0, 1.0]))
    assert np.std(np.diff(render([wide], _camera(), sun).radiance, axis=1)) < 0.4 * np.std(
        np.diff(first, axis=1)
    )


def test_statistics_of_the_heights() -> None:
    bump = Bump(2e-3, 0.5, (1.0, 0.0, 0.0), 4.0, seed=3)
    at = np.random.default_rng(1).uniform(-200.0, 200.0, (20_000, 3))
    heights = bump.heights(at)
    assert abs(heights.std() / bump.height - 1.0) < 0.02
    assert abs(heights.mean()) < 0.02 * bump.height
    for axis, stretch in ((0, 4.0), (1, 1.0), (2, 1.0)):
        unit = np.eye(3)[axis]
        slope = (bump.heights(at + 1e-4 * unit) - heights) / 1e-4
        assert abs(slope.std() * stretch / bump.slope - 1.0) < 0.02
        for share in (0.25, 0.5, 1.0):
            apart = bump.heights(at + share * 0.5 * stretch * unit)
            correlation = np.mean(heights * apart) / heights.var()
            assert abs(correlation - np.exp(-(share**2))) < 0.095
    other = Bump(2e-3, 0.5, (1.0, 0.0, 0.0), 4.0, seed=4).heights(at)
    assert abs(np.corrcoef(heights, other)[0, 1]) < 0.02


def test_what_has_no_relief_pays_nothing(device: Device) -> None:
    plain = Surface(SIDES, FACE, paint=Plain(0.6))
    bumpy = Surface(
        SIDES + np.array([0.0, 0.0, -5.0]), FACE, paint=Plain(0.6, bump=Bump(0.02, 0.9))
    )
    sun: list[Light] = [SunLight(tuple(SUN), 1.0)]
    one = Setup.build(look([plain], _camera(), lit=True), sun, 0.0)
    assert one.traits.bumps is None and not one.traits.bumpy.any()
    both = Setup.build(look([plain, bumpy], _camera(), lit=True), sun, 0.0)
    assert isinstance(both.traits.bumps, Bumps) and 0 < both.traits.bumpy.sum() < both.view.count
    # without light there is nothing to see of it
    assert Setup.build(look([bumpy], _camera(), lit=False), None, 0.0).traits.bumps is None
    hidden = render([plain, bumpy], _camera(), sun).radiance
    assert np.abs(hidden - render([plain], _camera(), sun).radiance).max() < 1e-7


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((0.0, 1.0), "height; got 0"),
        ((0.1, -1.0), "length; got -1"),
        ((np.nan, 1.0), "height; got nan"),
        ((0.3, 1.0), "slopes up to 0.35"),
        ((0.01, 1.0, None, 3.0), "without along"),
        ((0.01, 1.0, (0.0, 0.0, 0.0)), "expected a direction"),
        ((0.01, 1.0, (0.0, 1.0, 0.0), 0.5), "stretch; got 0.5"),
        (("0.01", 1.0), "height; got '0.01'"),
    ],
)
def test_what_is_no_relief_is_refused(arguments: tuple[object, ...], text: str) -> None:
    with pytest.raises(InputError, match=text):
        Bump(*arguments)  # type: ignore[arg-type]
