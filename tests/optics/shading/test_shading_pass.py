"""Pixels shaded once their triangle is known, against triangles shaded one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry.view import look
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.shading_pass import ShadingPass, small_triangles
from gpusim.optics.shadow.sample_mask import SAMPLES

CAMERA = gs.Camera.from_lens((36.0, 24.0), 40.0, (90, 61), (0.12, -1.0, 0.08), (0.02, 0, 0))
LAMP = gs.AreaLight((-0.4, -1.2, 0.7), (0.0, 0.0, 0.0), (0.2, 0.1), 20.0)


def plate(rows: int, columns: int, paints: dict[str, object]) -> gs.Surface:
    """A bumpy plate of 0.6 x 0.3 in the x-z plane, its left part in the first paint."""
    x, z = np.linspace(-0.3, 0.3, columns + 1), np.linspace(-0.15, 0.15, rows + 1)
    flat = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    bumpy = flat + 0.01 * np.sin(9.0 * flat[:, :1]) * np.array([0.0, 1.0, 0.0])
    number = np.arange(len(flat)).reshape(columns + 1, rows + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    quads = quads.reshape(-1, 4)
    region = (flat[quads, 0].mean(axis=1) > 0.1).astype(np.int32) * (len(paints) - 1)
    return gs.Surface(bumpy, quads, paints, region=region, reference=flat)  # type: ignore[arg-type]


CHECKED = {"left": gs.paint.Checker(0.037, dark=0.2, light=0.8)}
PAINTS = {
    **CHECKED,
    "right": gs.paint.Plain(0.6, roughness=0.3, metallic=0.5),
}


def shading_of(device: Device, setup: Setup, rows: int, deferred: bool) -> ShadingPass:
    marked = setup.lighting.shadows is not None
    return ShadingPass(SceneBuffers(device, setup), rows, deferred, marked=marked)


@pytest.mark.parametrize("paints", [CHECKED, PAINTS], ids=["one program", "several"])
@pytest.mark.parametrize("lit", [False, True], ids=["unlit", "shadowed"])
def test_both_ways_give_the_same_image(
    paints: dict[str, object], lit: bool, device: Device
) -> None:
    blocker = gs.Surface(
        np.array([[-0.1, -0.3, 0.1], [-0.02, -0.3, 0.1], [-0.02, -0.3, 0.15], [-0.1, -0.3, 0.15]]),
        np.array([[0, 1, 2, 3]]),
    )
    surfaces = [plate(30, 40, paints), blocker]
    lights = [LAMP] if lit else None
    view = look(surfaces, CAMERA, lit)
    assert small_triangles(view)
    setup = Setup.build(view, lights, 0.25, surfaces)
    assert (setup.lighting.shadows is not None) == lit
    images, marks = [], []
    for deferred in (False, True):
        shading = shading_of(device, setup, 40, deferred)
        image = []
        for row0, rows in ((0, 40), (40, 21)):
            out = device.empty(4 * shading.stride * rows, "test.out")
            with device.recording("test") as recording:
                shading.record(recording, [out], row0, rows)
            image.append(out.read(np.float32, (rows, shading.stride))[:, :90])
        images.append(np.concatenate(image))
        marks.append(shading.marks)
    assert (marks[0] is not None) == lit
    assert (images[0] == 0.25).any() and len(np.unique(images[0])) > 100
    np.testing.assert_array_equal(images[1], images[0])


def before_a_wall(paints: dict[str, object]) -> list[gs.Surface]:
    """The plate, and a wall of a few large triangles that passes through the picture behind it."""
    wall = np.array([[-0.9, 0.06, -0.1], [0.9, 0.06, -0.3], [0.9, 0.3, 0.9], [-0.9, 0.3, 0.9]])
    return [plate(30, 40, paints), gs.Surface(wall, np.array([[0, 1, 2, 3]]), gs.paint.Plain(0.7))]


LARGER = gs.Camera.from_lens((36.0, 24.0), 30.0, (333, 221), (0.12, -1.0, 0.08), (0.02, 0, 0))


@pytest.mark.parametrize("paints", [CHECKED, PAINTS], ids=["matte", "glossy"])
def test_shadows_on_small_triangles_are_those_of_the_twin(
    paints: dict[str, object], device: Device
) -> None:
    surfaces = before_a_wall(paints)
    camera = gs.Camera.from_lens((36.0, 24.0), 30.0, (167, 111), (0.12, -1.0, 0.08), (0.02, 0, 0))
    got = gs.render(surfaces, camera, [LAMP], device=device).radiance
    want = gs.render(surfaces, camera, [LAMP], backend="numpy").radiance
    bare = gs.render(surfaces, camera, [replace(LAMP, shadows=False)], device=device).radiance
    # many pixels lie in the shadow on the wall
    assert np.count_nonzero(np.abs(got - bare) > 0.02 * want.max()) > 125
    # one sample may fall to the other side of an outline
    assert np.abs(got - want).max() <= 2.5 / SAMPLES * want.max()


def test_large_triangles_are_shaded_one_by_one() -> None:
    assert not small_triangles(look([plate(3, 4, CHECKED)], CAMERA, lit=False))
    large = gs.Camera.from_lens((36.0, 24.0), 40.0, (2700, 1830), (0.1, -1.0, 0.1), (0, 0, 0))
    assert not small_triangles(look([plate(30, 40, CHECKED)], large, lit=False))
