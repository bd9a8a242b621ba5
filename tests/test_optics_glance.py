"""Light as a function of the pixel on small triangles, against each pixel's own."""

from __future__ import annotations

import sys

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import PointLight
from gpusim.optics.probes.paints import sheets_setup
from gpusim.optics.raster.compute_raster import Sight, sheet, sight_twin
from gpusim.optics.shading import glance
from gpusim.optics.shading.forward_pass import ShadePass
from gpusim.optics.shading.glance import TOLERANCE, GlancePass, glance_twin, may_glance
from gpusim.optics.shading.scene_buffers import Tables
from gpusim.optics.shading.setup import Setup
from gpusim.surface.paint import Checker, Plain
from gpusim.surface.surface import Surface


def shaded(
    device: Device, setup: Setup, rows: int
) -> tuple[npt.NDArray[np.float32], GlancePass | None]:
    """The image (H, W) before edges are resolved, band by band."""
    camera = setup.view.camera
    sight = Sight(device, setup.view, rows)
    shading, found = ShadePass(Tables(device, setup, sight), rows, True, sight), []
    out = device.empty(4 * shading.stride * rows, "test.out")
    for row0 in range(0, camera.height, rows):
        with device.recording("test") as recording:
            shading.record(recording, out, row0, rows)
        found.append(out.read(np.float32, (rows, shading.stride))[:, : camera.width])
    return np.concatenate(found)[: camera.height], shading.glance


# triangles of 2, 57 and 213 px: affine, affine with fields of a board, of second degree
@pytest.mark.parametrize("scale,rows", [(1.0, 14), (5.0, 70), (10.0, 391)])
def test_pixels_are_what_they_are_one_by_one(
    device: Device, monkeypatch: pytest.MonkeyPatch, scale: float, rows: int
) -> None:
    setup = sheets_setup(scale)
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    found, work = shaded(device, setup, rows)
    assert work is not None
    assert (len(work.bare) > 0) == (scale > 1.0) and work.quadratic == (scale > 5.0)
    monkeypatch.setattr(glance, "LEAST_SHARE", 2.0)
    want, other = shaded(device, setup, rows)
    assert other is None
    ids = sight_twin(setup.view, 0, setup.view.camera.height).astype(np.int64)
    looked = np.isin(ids, work.triangles.astype(np.int64) + 1)
    even = looked & ~np.isin(ids, work.refused())
    assert 0.2 < even.mean() < 0.95 and (looked & ~even).any() and (ids == 0).any()
    np.testing.assert_array_equal(found[~even], want[~even])
    # off most where it was tested; and float32
    assert np.abs(found - want)[even].max() <= TOLERANCE * want.max() + 1e-6
    assert (found != want).any()


def test_large_triangles_are_looked_at_where_paint_and_light_are_even(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    monkeypatch.setattr(glance, "FEWEST", 100)
    rendering = sys.modules["gpusim.optics.rendering.renderer"]
    camera = Camera(590, 390, np.array([[1110.0, 0.3, 287.0], [0.0, 1100.0, 202.0], [0, 0, 1]]))
    lamp = PointLight((-60.0, -50.0, -90.0), 2e4, shadows=False)
    hard = PointLight((-60.0, -50.0, -90.0), 2e4)
    crumpled = sheet(0.95, 1.3, 0.4, Checker(0.31))

    def images(light: PointLight, *surfaces: Surface) -> list[npt.NDArray[np.float32]]:
        result = []
        for asked in (may_glance, lambda view, lights: False):
            monkeypatch.setattr(rendering, "may_glance", asked)
            result.append(gs.render(surfaces, camera, [light], device=device).radiance)
        return result

    got, other = images(lamp, crumpled)
    assert not np.array_equal(got, other)
    want = gs.render([crumpled], camera, [lamp], backend="numpy").radiance
    assert np.abs(got - want).max() < 2e-4 * want.max()
    assert not may_glance(look([crumpled], camera, lit=False), None)
    # fields as small as footprints, shadows, gloss
    for light, *surfaces in (
        (lamp, sheet(0.95, 1.3, 0.4, Checker(0.005))),
        (hard, crumpled, crumpled.moved(crumpled.points + np.array([0.0, 0.0, 0.5]))),
        (lamp, sheet(0.95, 1.3, 0.4, Checker(0.31, roughness=0.4))),
    ):
        got, want = images(light, *surfaces)
        np.testing.assert_array_equal(got, want)


def test_without_lights_it_is_the_albedo(device: Device) -> None:
    lit = sheets_setup()
    setup = Setup.build(lit.view, None, 0.25)
    found, work = shaded(device, setup, setup.view.camera.height)
    assert (work is not None) == device.atomics64
    ids = sight_twin(setup.view, 0, setup.view.camera.height)
    plain = np.isin(ids, np.flatnonzero(setup.groups == 0) + 1)
    assert set(found[plain].tolist()) <= {float(np.float32(v)) for v in (0.6, 0.05, 0.9)}
    assert (found[ids == 0] == np.float32(0.25)).all()


def test_shadows_are_left_to_the_pixels(device: Device) -> None:
    view = sheets_setup().view
    surfaces = [sheet(0.95, 1.3, 0.0, Plain(0.6))]
    view = look(surfaces, view.camera, lit=True)
    for shadows in (False, True):
        lamp = PointLight((-60.0, -50.0, -90.0), 2e4, shadows=shadows)
        setup = Setup.build(view, [lamp], 0.0, surfaces, device)
        if shadows and setup.lighting.shadows is None:
            continue
        _, work = shaded(device, setup, 39)
        assert (work is not None) == (device.atomics64 and not shadows)


def test_the_twin_tells_curved_light_from_even(device: Device) -> None:
    setup = sheets_setup()
    plain = np.flatnonzero(setup.groups == 0)
    radiance, off = glance_twin(setup, plain, False)
    x = setup.view.vertices[setup.view.corner[plain], 0].mean(axis=1)
    assert radiance.shape == (len(plain), 3) and (radiance > 0.0).all()
    calm, rough = off[x < -0.5], off[x > 0.5]
    assert calm.max() < TOLERANCE < np.median(rough)
    _, closer = glance_twin(setup, plain, True)
    assert np.isfinite(closer).all() and np.median(closer) < 0.1 * np.median(off)
