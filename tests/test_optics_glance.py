"""Light as an affine function of the pixel on small triangles, against each pixel's own."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.gpu import Device
from gpusim.optics import glance
from gpusim.optics.glance import TOLERANCE, GlancePass, glance_twin, probe_setup
from gpusim.optics.light import PointLight
from gpusim.optics.setup import Setup
from gpusim.optics.shade import ShadePass, Tables
from gpusim.optics.sight import Sight, sheet, sight_twin
from gpusim.optics.view import look
from gpusim.surface.paint import Plain


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


def test_pixels_are_what_they_are_one_by_one(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup = probe_setup()
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    found, work = shaded(device, setup, 14)
    assert work is not None
    monkeypatch.setattr(glance, "LEAST_SHARE", 2.0)
    want, other = shaded(device, setup, 14)
    assert other is None
    ids = sight_twin(setup.view, 0, setup.view.camera.height).astype(np.int64)
    plain = np.isin(ids, work.triangles.astype(np.int64) + 1)
    affine = plain & ~np.isin(ids, work.refused())
    assert 0.2 < affine.mean() < 0.8 and (plain & ~affine).any() and (ids == 0).any()
    np.testing.assert_array_equal(found[~affine], want[~affine])
    # off most at the middles of sides, where it was tested; and float32
    assert np.abs(found - want)[affine].max() <= TOLERANCE * want.max() + 1e-6
    assert (found != want).any()


def test_without_lights_it_is_the_albedo(device: Device) -> None:
    lit = probe_setup()
    setup = Setup.build(lit.view, None, 0.25)
    found, work = shaded(device, setup, setup.view.camera.height)
    assert (work is not None) == device.atomics64
    ids = sight_twin(setup.view, 0, setup.view.camera.height)
    plain = np.isin(ids, np.flatnonzero(setup.groups == 0) + 1)
    assert set(found[plain].tolist()) <= {float(np.float32(v)) for v in (0.6, 0.05, 0.9)}
    assert (found[ids == 0] == np.float32(0.25)).all()


def test_shadows_are_left_to_the_pixels(device: Device) -> None:
    view = probe_setup().view
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
    setup = probe_setup()
    plain = np.flatnonzero(setup.groups == 0)
    radiance, off = glance_twin(setup, plain)
    x = setup.view.vertices[setup.view.corner[plain], 0].mean(axis=1)
    assert radiance.shape == (len(plain), 3) and (radiance > 0.0).all()
    calm, rough = off[x < -0.5], off[x > 0.5]
    assert calm.max() < TOLERANCE < np.median(rough)
