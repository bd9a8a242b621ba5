"""Lamps that lean at bodies or are half sunk into them: what lies before the lamp hides it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import AreaLight
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shadow.sample_mask import SAMPLES
from gpusim.twin_checks.scenes import block
from tests.support.optics_rays import brute_share, triangles_of
from tests.support.shadow_rays import box

FLOOR = gs.Surface(
    np.array([[-1.2, -1.1, 0], [1.2, -1.1, 0], [1.2, 1.1, 0], [-1.2, 1.1, 0.0]]),
    np.array([[0, 1, 2, 3]]), paint=gs.paint.Plain(0.7),
)  # fmt: skip
COLUMN = block((-0.3, 0.6, 0.4), (0.05, 0.05, 0.4), 0.5)
CAMERA = gs.Camera.from_lens((36.0, 24.0), 30.0, (95, 63), (0.3, -1.4, 0.95), (0.03, 0.05, 0.05))
LEANING = AreaLight((-0.3, 0.5, 0.6), (0.1, -0.5, 0.1), (0.5, 0.3), 2.0)
SUNK = AreaLight((0.1, -0.8, 0.0), (0.1, 0.9, 0.0), (0.6, 0.3), 2.0)


def test_a_lamp_is_seen_before_the_column_that_it_leans_at(device: Device) -> None:
    surfaces = [FLOOR, COLUMN]
    lit, plain = (
        gs.render(surfaces, CAMERA, [replace(LEANING, shadows=shadows)], device=device)
        for shadows in (True, False)
    )
    truth = lit.truth()
    row, column = truth.row, truth.column
    # not beside the lamp's own plane, where what is seen of it changes within a pixel
    bright = plain.radiance[row, column] > 0.1 * plain.radiance.max()
    edges = find_edge_pixels(look(surfaces, CAMERA, lit=True)).pixel
    inside = bright & (truth.face == 0) & ~np.isin(row * CAMERA.width + column, edges)
    rows = np.flatnonzero(inside)[::7]
    got = lit.radiance[row[rows], column[rows]] / plain.radiance[row[rows], column[rows]]
    (lamp,) = lamps_of([LEANING])
    want = brute_share(lamp, truth.reference[rows], triangles_of(surfaces), n=40)
    assert len(want) > 60 and want.min() < 0.5 and want.max() > 0.95
    # without it, 0.15 on average
    assert np.abs(got - want).mean() < 0.006
    assert np.abs(got - want).max() < 0.1


@pytest.mark.parametrize("backend", ["numpy", "gpu"])
def test_half_of_a_lamp_that_is_half_sunk_is_seen(
    backend: str, request: pytest.FixtureRequest
) -> None:
    device = request.getfixturevalue("device") if backend == "gpu" else None
    surfaces = [FLOOR, block((0.0, 0.2, 0.3), (0.4, 0.1, 0.3), 0.5)]
    lit, plain = (
        gs.render(
            surfaces, CAMERA, [replace(SUNK, shadows=shadows)], backend=backend, device=device
        )
        for shadows in (True, False)
    )
    truth = lit.truth()
    front = truth.normal[:, 1] < -0.9
    front &= (np.abs(truth.reference - [0.0, 0.1, 0.3]) < [0.36, 0.01, 0.26]).all(axis=1)
    seen = truth.row[front], truth.column[front]
    assert len(seen[0]) > 300
    np.testing.assert_allclose(lit.radiance[seen] / plain.radiance[seen], 0.5, atol=2 / SAMPLES)


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.03, -0.04)])
@pytest.mark.parametrize("kind", ["point", "spot", "panel"])
def test_a_lamp_on_a_body_s_face_lights_what_is_before_it(
    device: Device, kind: str, place: tuple[float, float], turn: float
) -> None:
    """At a corner of its mesh, and anywhere else."""
    turned = np.array([[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0],
                       [-np.sin(turn), 0.0, np.cos(turn)]])  # fmt: skip
    body = box((0.0, 0.0, 0.0), (0.1, 0.1, 0.1), cut=4)
    body = gs.Surface(body.points @ turned.T + [0.0, 0.0, 0.3], body.faces, gs.paint.Plain(0.5))
    surfaces = [FLOOR, body]
    camera = gs.Camera.from_lens((36.0, 24.0), 24.0, (60, 40), (1.5, -0.8, 1.1), (0.3, 0.0, 0.1))
    seen = gs.render(surfaces, camera, device=device).truth()
    on_floor = np.abs(seen.reference[:, 2]) < 1e-9
    at, aim = (turned @ [0.1 + way, *place] + [0.0, 0.0, 0.3] for way in (0.0, 1.0))
    # not where the lamp's plane passes through a pixel
    before = (seen.reference - at) @ turned[:, 0]
    on_floor &= np.abs(before) > 0.1
    edges = find_edge_pixels(look(surfaces, camera, lit=True)).pixel
    on_floor &= ~np.isin(seen.row * camera.width + seen.column, edges)
    where = tuple(at.tolist()), tuple(aim.tolist())
    lamp = {
        "point": gs.PointLight(where[0], 1.0), "spot": gs.SpotLight(*where, 1.0, cone=2.5),
        "panel": AreaLight(*where, (0.04, 0.03), 1.0),
    }[kind]  # fmt: skip
    plain = gs.render(surfaces, camera, [replace(lamp, shadows=False)], device=device).radiance
    want = np.where(before > 0.0, plain[seen.row, seen.column], 0.0)[on_floor]
    assert np.count_nonzero(want > 0.0) > 100 and np.count_nonzero(want == 0.0) > 100
    for backend in ("gpu", "numpy"):
        own = device if backend == "gpu" else None
        lit = gs.render(surfaces, camera, [lamp], backend=backend, device=own).radiance
        got = lit[seen.row, seen.column][on_floor]
        np.testing.assert_allclose(got, want, atol=1e-5 * float(want.max()))
