"""Lamps that nothing is hidden from: told from those that something is, against rays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics import lamp_layer
from gpusim.optics.binning import bin_edges
from gpusim.optics.emitters import lamps_of
from gpusim.optics.lamp_layer import surfaces_alone, without_shadows
from gpusim.optics.light import Light
from gpusim.optics.lighting import find_shadows
from gpusim.optics.loops import Loops
from gpusim.optics.view import look
from tests.optics_rays import brute_share, triangles_of

Array = npt.NDArray[np.float64]

EYE = np.array([0.1, -1.0, 0.1])
CAMERA = gs.Camera.from_lens((36.0, 24.0), 45.0, (240, 160), tuple(EYE), (0.0, 0.0, 0.0))
LAMP = gs.PointLight((-0.6, -1.3, 0.5), 50.0)
MATTE = gs.paint.Plain(0.8)


def grid(columns: int = 50, rows: int = 40) -> tuple[Array, npt.NDArray[np.int64]]:
    """Points (P, 3) of a flat sheet of 1 x 0.66 before the camera, and its faces, towards it."""
    x, z = np.linspace(-0.5, 0.5, columns + 1), np.linspace(-0.33, 0.33, rows + 1)
    flat = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(flat)).reshape(columns + 1, rows + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    return flat, quads.reshape(-1, 4)


def wavy(height: float = 0.02, waves: float = 9.0) -> gs.Surface:
    points, faces = grid()
    by = height * np.sin(waves * points[:, 0]) * np.cos(5.0 * points[:, 2])
    return gs.Surface(points + np.array([0.0, 1.0, 0.0]) * by[:, None], faces, MATTE)


def ribbon(turns: float, rise: float) -> gs.Surface:
    """A ribbon round the y axis that rises towards the camera by ``rise`` a turn."""
    points, faces = grid(200, 8)
    angle, radius = 2.0 * np.pi * turns * points[:, 0], 0.3 + 0.3 * points[:, 2]
    place = radius * np.cos(angle), -rise * turns * points[:, 0], radius * np.sin(angle)
    return gs.Surface(np.stack(place, axis=1), faces, MATTE)


def slab(thick: float = 0.02) -> gs.Surface:
    """A closed body with a wavy front."""
    front, faces = grid()
    front[:, 1] += 0.01 * np.sin(7.0 * front[:, 0])
    count = len(front)
    number = np.arange(count).reshape(51, 41)
    ring = np.concatenate([number[:, 0], number[-1, 1:], number[-2::-1, -1], number[0, -2:0:-1]])
    after = np.roll(ring, -1)
    side = np.stack([after, ring, ring + count, after + count], axis=-1)
    back = front * [1.0, 0.0, 1.0] + [0.0, 0.02 + thick, 0.0]
    every = np.concatenate([faces, faces[:, ::-1] + count, side])
    return gs.Surface(np.concatenate([front, back]), every, MATTE)


def hides(surfaces: list[gs.Surface], light: Light, eye: Array = EYE) -> bool:
    return bool(getattr(without_shadows(surfaces, [light], eye)[0], "shadows"))  # noqa: B009


def shifted(surface: gs.Surface, x: float = 0.0, y: float = 0.0) -> gs.Surface:
    return gs.Surface(surface.points + np.array([x, y, 0.0]), surface.faces, MATTE)


@pytest.mark.parametrize(
    "light",
    [
        LAMP,
        gs.SpotLight((-0.6, -1.3, 0.5), (0.0, 0.0, 0.0), 50.0, 1.0),
        gs.AreaLight((-0.6, -1.3, 0.5), (0.0, 0.0, 0.0), (0.2, 0.1), 50.0),
        gs.SunLight((0.3, 1.0, -0.2), 5.0),
        gs.SunLight((0.3, 1.0, -0.2), 5.0, 0.05),
    ],
)
def test_a_gently_wavy_sheet_hides_nothing(light: Light) -> None:
    sheet = wavy()
    assert not hides([sheet], light)
    # its back is lit as well, and which way faces are wound doesn't matter
    assert not hides([gs.Surface(sheet.points, sheet.faces[:, ::-1], MATTE)], light)


def test_sheets_that_hide_parts_of_themselves() -> None:
    assert hides([wavy(0.08, 25.0)], LAMP)
    assert hides([wavy(0.02, 25.0)], gs.SunLight((1.0, 0.1, 0.0), 5.0))
    above = gs.PointLight((0.0, -2.0, 0.0), 50.0)
    # all of it turned to the lamp, once round and twice
    assert not hides([ribbon(0.9, 0.1)], above)
    assert hides([ribbon(1.5, 0.1)], above)


def test_sheets_beside_and_behind_each_other() -> None:
    sheet = wavy(0.005)
    assert not hides([sheet, shifted(sheet, 1.1)], LAMP)
    assert hides([sheet, shifted(sheet, 0.0, 0.3)], LAMP)
    # beside each other for the middle of the lamp, behind each other for its ends
    near = shifted(sheet, -1.02, -0.4)
    front = gs.PointLight((-0.1, -3.0, 0.0), 50.0)
    wide = gs.AreaLight((-0.1, -3.0, 0.0), (-0.1, 0.0, 0.0), (1.9, 0.1), 50.0)
    assert not hides([sheet, near], front)
    assert hides([sheet, near], wide)


def test_gaps_are_narrower_for_wide_lamps() -> None:
    spiral = ribbon(0.985, 0.3)
    above = (0.0, -2.0, 0.0)
    assert not hides([spiral], gs.PointLight(above, 50.0))
    assert not hides([spiral], gs.AreaLight(above, (0.0, 0.0, 0.0), (0.005, 0.005), 50.0))
    assert hides([spiral], gs.AreaLight(above, (0.0, 0.0, 0.0), (0.4, 0.4), 50.0))


def test_holes_don_t_hide() -> None:
    points, faces = grid()
    middle = points[faces].mean(axis=1)
    away = np.hypot(middle[:, 0] - 0.1, middle[:, 2]) > 0.15
    assert not hides([gs.Surface(points, faces[away], MATTE)], LAMP)


def test_closed_bodies() -> None:
    body = slab()
    assert not hides([body], LAMP)
    assert hides([gs.Surface(body.points, body.faces[:, ::-1], MATTE)], LAMP)
    # a lamp within
    assert hides([slab(0.5)], gs.PointLight((0.0, 0.3, 0.0), 50.0))
    # dark sides that are seen are dark by themselves where their edges are sharp
    aside = np.array([1.2, -0.4, 0.0])
    assert not hides([body], LAMP, aside)
    round_off = gs.Surface(body.points, body.faces, MATTE, smooth_angle=3.1)
    assert not hides([round_off], LAMP, np.array([0.0, -2.0, 0.0]))
    assert hides([round_off], LAMP, aside)
    relief = gs.Surface(body.points, body.faces, gs.paint.Plain(0.8, bump=gs.paint.Bump(0.01, 0.1)))
    assert hides([relief], LAMP)


def test_a_part_that_is_wound_inwards() -> None:
    """Beside a larger one that isn't: the walls that it shows are its far ones."""
    body = slab()
    small = 0.3 * body.points + np.array([0.9, 0.0, 0.0])
    points = np.concatenate([body.points, small])
    for faces, hidden in ((body.faces, False), (body.faces[:, ::-1], True)):
        every = np.concatenate([body.faces, faces + len(body.points)])
        assert hides([gs.Surface(points, every, MATTE)], LAMP) is hidden


def test_few_triangles_and_other_lights_stay() -> None:
    points, faces = grid(10, 10)
    lights = [LAMP, gs.AmbientLight(0.1)]
    assert without_shadows([gs.Surface(points, faces, MATTE)], lights, EYE) == lights
    assert without_shadows([wavy()], lights, EYE)[1] is lights[1]


@pytest.mark.slow
def test_random_sheets_against_rays(device: Device) -> None:
    """Where nothing is said to be hidden, rays from what is seen meet nothing."""
    rng = np.random.default_rng(5)
    clear = 0
    for _ in range(24):
        points, faces = grid(40, 30)
        x, z = points[:, 0], points[:, 2]
        points[:, 1] += rng.uniform(0.0, 0.05) * np.sin(rng.uniform(2, 20) * x) * np.cos(9 * z)
        if rng.random() < 0.5:
            points[:, 2] += 0.2 * np.sin(rng.uniform(2, 9) * x)
        # triangles: a quad that is bent may hide some of itself from rays that begin at it
        triangles = np.concatenate([faces[:, :3], faces[:, [0, 2, 3]]])
        surface = gs.Surface(points, triangles, MATTE)
        at = (float(rng.uniform(-1, 1)), -1.0, float(rng.uniform(-1, 1)))
        light: Light = gs.PointLight(at, 50.0)
        if rng.random() < 0.5:
            light = gs.AreaLight(at, (0.0, 0.0, 0.0), (0.3, 0.2), 50.0)
        if hides([surface], light):
            continue
        clear += 1
        frame = gs.render([surface], CAMERA, [light], device=device)
        seen = frame.truth().reference[::149]
        frame.release()
        (lamp,) = lamps_of([light])
        assert (brute_share(lamp, seen, triangles_of([surface]), 3) == 1.0).all()
    assert 5 <= clear <= 23


def test_pictures_are_those_of_all_the_shadows(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shown(surface: gs.Surface) -> Array:
        frame = gs.render([surface], CAMERA, lights, device=device)
        result = frame.radiance.astype(np.float64)
        frame.release()
        return result

    lights = [LAMP, gs.SunLight((0.3, 1.0, -0.2), 5.0, 0.02)]
    plain = [gs.PointLight(LAMP.position, LAMP.power, shadows=False)]
    plain.append(gs.SunLight((0.3, 1.0, -0.2), 5.0, 0.02, shadows=False))
    sheet = wavy()
    twin = gs.render([sheet], CAMERA, plain, backend="numpy").radiance
    assert np.abs(shown(sheet) - twin).max() < 2e-5 * twin.max()
    # a sheet that hides some of itself isn't taken for one that doesn't
    steep, lights = wavy(0.08, 25.0), [gs.PointLight((-1.5, -0.3, 0.3), 50.0)]
    twin = gs.render([steep], CAMERA, lights, backend="numpy").radiance
    assert np.sqrt(np.mean((shown(steep) - twin) ** 2)) < 3e-3 * twin.max()
    monkeypatch.setattr(lamp_layer, "_lights_all", lambda *_: True)
    assert np.sqrt(np.mean((shown(steep) - twin) ** 2)) > 3e-2 * twin.max()


@pytest.mark.slow
def test_what_hides_nothing_of_itself_still_hides_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wavy sheet before a wall: shares of a lamp at pixels' centres, against rays."""
    wall = gs.Surface(
        np.array([[-1.0, 0.25, -0.8], [1.0, 0.25, -0.8], [1.0, 0.25, 0.8], [-1.0, 0.25, 0.8]]),
        np.array([[0, 1, 2, 3]]), MATTE,
    )  # fmt: skip
    monkeypatch.setattr(lamp_layer, "FEWEST", 500)
    points, faces = grid(20, 16)
    by = 0.01 * np.sin(9.0 * points[:, 0]) * np.cos(5.0 * points[:, 2])
    small = 0.6 * points + np.array([0.0, 1.0, 0.0]) * by[:, None]
    surfaces = [gs.Surface(small, faces, MATTE), wall]
    light = gs.AreaLight((-0.6, -1.3, 0.5), (0.0, 0.0, 0.0), (0.2, 0.1), 50.0)
    (lamp,) = lamps_of([light])
    assert [one.surface for one in surfaces_alone([lamp], surfaces, EYE)[0]] == [0]
    view = look(surfaces, CAMERA, lit=True)
    truth = gs.render(surfaces, CAMERA, [light], backend="numpy").truth()
    inside = ~np.isin(truth.row * CAMERA.width + truth.column, bin_edges(view).pixel)
    rows = np.flatnonzero(inside)[::97]
    seen, still = truth.reference[rows], np.zeros((len(rows), 3))
    own = truth.face[rows] < len(faces)

    def found() -> tuple[Array, int]:
        tiles = find_shadows(view, [light], surfaces)
        assert tiles is not None
        place = truth.column[rows].astype(float), truth.row[rows].astype(float)
        shares = tiles.shares(*place, seen - EYE, truth.normal[rows], still, still)
        return shares[:, 0], len(tiles.place)

    shares, halves = found()
    want = brute_share(lamp, seen, triangles_of(surfaces))
    assert (shares[own] == 1.0).all()
    assert ((want > 0.02) & (want < 0.98)).sum() > 10 and (want < 0.5).sum() > 10
    assert np.abs(shares - want)[~own].max() < 0.04

    # it isn't even asked whether its triangles lie beside each other; else most are in doubt
    def unknown(half: object, receivers: object, box: Array, *_: object) -> npt.NDArray[np.bool_]:
        return np.zeros(len(box), bool)

    monkeypatch.setattr("gpusim.optics.faces_before.apart", unknown)
    assert found()[1] == halves
    monkeypatch.setattr(
        "gpusim.optics.lighting.surfaces_alone", lambda lamps, *_: [[] for _ in lamps]
    )
    assert found()[1] > 2 * halves


def test_nothing_left_to_look_at() -> None:
    """Surfaces that hide nothing of themselves, and neither of each other."""
    sheets = [wavy(), shifted(wavy(), 1.2)]
    behind = gs.Camera.from_lens((36.0, 24.0), 45.0, (240, 160), (0.1, 1.0, 0.1), (0.0, 0.0, 0.0))
    (lamp,) = lamps_of([LAMP])
    assert [one.surface for one in surfaces_alone([lamp], sheets, EYE)[0]] == [0, 1]
    for camera in (CAMERA, behind):
        assert find_shadows(look(sheets, camera, lit=True), [LAMP], sheets) is None


def chain(*loops: list[tuple[float, float]]) -> tuple[Loops, Array]:
    starts: list[int] = []
    ends: list[int] = []
    for loop in loops:
        own = np.arange(len(loop)) + len(starts)
        starts += own.tolist()
        ends += np.roll(own, -1).tolist()
    found = Loops.of(np.array(starts), np.array(ends))
    assert found is not None
    places = np.array([corner for loop in loops for corner in loop], np.float64).T
    return found, np.concatenate([places, np.ones((1, len(starts)))])


def square(size: float, x: float = 0.0, way: int = 1) -> list[tuple[float, float]]:
    corners = [(-size, -size), (size, -size), (size, size), (-size, size)][::way]
    return [(x + p, q) for p, q in corners]


@pytest.mark.parametrize(
    ("loops", "once"),
    [
        ([square(1.0)], True),
        ([square(1.0, way=-1)], True),
        ([square(1.0), square(0.5, way=-1)], True),
        ([square(1.0), square(0.5)], False),
        ([square(1.0), square(1.0, 3.0)], True),
        ([square(1.0), square(1.0, 3.0, -1)], False),
        ([square(1.0), square(1.0, 1.5)], False),
        ([square(2.0), square(1.0, way=-1), square(0.5)], True),
        ([[(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)]], False),
        ([[(0.0, 0.0), (2.0, 0.0), (1.0, 0.0), (1.0, 1.0)]], False),
    ],
)
def test_loops(loops: list[list[tuple[float, float]]], once: bool) -> None:
    found, places = chain(*loops)
    assert found.wind_once(places, (0.0, 0.0)) is once


def test_loops_that_part_are_refused() -> None:
    assert Loops.of(np.array([0, 1, 0, 2]), np.array([1, 0, 2, 0])) is None
    assert Loops.of(np.array([0, 1]), np.array([1, 2])) is None


def test_loops_move_apart_by_their_depths() -> None:
    found, places = chain(square(1.0), square(1.0, 2.5))
    assert found.wind_once(places, (1.0, 1.0))
    places[2, 4:] = 1.4
    assert found.wind_once(places, (1.0, 1.0))
    places[2, 4:] = 1.6
    assert not found.wind_once(places, (1.0, 1.0))
