"""Lamps that nothing is hidden from: told from those that something is, against rays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shadow import single_layer
from gpusim.optics.shadow.single_layer import without_shadows
from tests.support.optics_rays import brute_share, triangles_of

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
    # all of it turned to the lamp, part of the way round and more than once
    assert not hides([ribbon(0.3, 0.1)], above)
    assert hides([ribbon(1.5, 0.1)], above)


def test_of_several_surfaces_nothing_is_told() -> None:
    sheet = wavy(0.005)
    assert hides([sheet, shifted(sheet, 0.0, 0.3)], LAMP)
    assert hides([sheet, shifted(sheet, 1.1)], LAMP)


def test_parts_of_one_surface() -> None:
    """Beside each other nothing is told, behind each other one hides the other."""
    for x, y in ((1.1, 0.0), (0.0, 0.3)):
        one, other = wavy(0.005), shifted(wavy(0.005), x, y)
        points = np.concatenate([one.points, other.points])
        faces = np.concatenate([one.faces, other.faces + len(one.points)])
        assert hides([gs.Surface(points, faces, MATTE)], LAMP)


def test_wide_lamps_see_round_what_a_small_one_sees_straight() -> None:
    """A sheet with a step, lit along its riser."""
    points, faces = grid()
    points[:, 1] -= 0.04 * np.tanh(40.0 * points[:, 0])
    step = gs.Surface(points, faces, MATTE)
    at = (0.3, -1.2, 0.0)
    assert not hides([step], gs.PointLight(at, 50.0))
    assert not hides([step], gs.AreaLight(at, (0.0, 0.0, 0.0), (0.1, 0.1), 50.0))
    assert hides([step], gs.AreaLight(at, (0.0, 0.0, 0.0), (2.0, 0.1), 50.0))


def test_a_waisted_specimen() -> None:
    """Not starlike: its corners aren't seen from its middle."""
    points, faces = grid(100, 20)
    narrow = 1.0 - 0.8 / (1.0 + np.exp(40.0 * (np.abs(points[:, 0]) - 0.3)))
    points[:, 2] *= 0.5 * narrow
    bar = gs.Surface(points, faces, MATTE)
    for light in (LAMP, gs.AreaLight(LAMP.position, (0.0, 0.0, 0.0), (0.2, 0.1), 50.0)):
        assert not hides([bar], light)


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
    assert not hides([relief], LAMP)
    assert hides([relief], LAMP, aside)


def test_a_part_that_is_wound_inwards() -> None:
    """Beside a larger one that isn't, or within it: the walls that it shows are its far ones."""
    body = slab()
    for place in ([0.9, 0.0, 0.0], [0.0, 0.012, 0.0]):
        small = 0.3 * body.points + np.array(place)
        points = np.concatenate([body.points, small])
        every = np.concatenate([body.faces, body.faces[:, ::-1] + len(body.points)])
        assert hides([gs.Surface(points, every, MATTE)], LAMP)


def test_other_lights_stay() -> None:
    lights = [LAMP, gs.AmbientLight(0.1), gs.PointLight(LAMP.position, 5.0, shadows=False)]
    found = without_shadows([wavy()], lights, EYE)
    assert found[1] is lights[1] and found[2] is lights[2]
    assert without_shadows([slab(0.5), wavy()], lights, EYE) == lights


def test_the_back_of_a_sheet() -> None:
    """Dark by itself, unless normals for shading or a relief may lean towards the lamp."""
    behind = np.array([0.1, 1.0, 0.1])
    low = gs.PointLight((-1.5, -0.6, 0.5), 50.0)
    relief = gs.paint.Plain(0.8, bump=gs.paint.Bump(0.01, 0.1))
    for paint, light, eye, hidden in (
        (MATTE, LAMP, behind, False),
        (MATTE, low, EYE, False),
        (MATTE, low, behind, True),
        (relief, LAMP, EYE, False),
        (relief, LAMP, behind, True),
    ):
        sheet = wavy(0.005)
        own = gs.Surface(sheet.points, sheet.faces, paint)
        assert hides([own], light, eye) is hidden


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


def crumpled(rng: np.random.Generator) -> gs.Surface:
    """A sheet with waves, maybe with a hole, wound up, or with a thickness."""
    points, faces = grid(16, 12)
    x, z = points[:, 0].copy(), points[:, 2].copy()
    by = rng.uniform(0.0, 0.12) * np.sin(rng.uniform(2, 20) * x + rng.uniform(0, 6))
    points[:, 1] += by * np.cos(rng.uniform(0, 12) * z)
    points[:, 2] *= 1.0 + rng.uniform(-0.8, 0.8) * np.cos(rng.uniform(2, 12) * x)
    if rng.random() < 0.3:
        turn = rng.uniform(0.5, 4.0)
        points[:, 0], points[:, 2] = (0.4 + z) * np.cos(turn * x), (0.4 + z) * np.sin(turn * x)
        points[:, 1] -= rng.uniform(0.0, 0.3) * x
    if rng.random() < 0.4:
        middle = np.stack([x, z], axis=1)[faces].mean(axis=1)
        faces = faces[np.hypot(*(middle - rng.uniform(-0.2, 0.2, 2)).T) > 0.12]
    triangles = np.concatenate([faces[:, :3], faces[:, [0, 2, 3]]])
    if rng.random() < 0.4:
        edge = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        back = set(map(tuple, edge[:, ::-1].tolist()))
        rim = np.array([e for e in edge.tolist() if tuple(e) not in back])
        a, b = rim.T
        count = len(points)
        sides = [np.stack([b, a, a + count], axis=1), np.stack([b, a + count, b + count], axis=1)]
        points = np.concatenate([points, points + np.array([0.0, rng.uniform(0.01, 0.2), 0.0])])
        triangles = np.concatenate([triangles, triangles[:, ::-1] + count, *sides])
    return gs.Surface(points, triangles, MATTE)


def test_random_shapes_against_rays() -> None:
    """Nothing is before any triangle that is turned to a lamp, where that is said."""
    rng = np.random.default_rng(11)
    clear = {False: 0, True: 0}
    for _ in range(300):
        surface = crumpled(rng)
        at = tuple(rng.uniform([-1.5, -1.6, -1.5], [1.5, -0.5, 1.5]).tolist())
        light: Light = gs.PointLight(at, 50.0)
        if rng.random() < 0.5:
            size = tuple(rng.uniform(0.05, 0.8, 2).tolist())
            light = gs.AreaLight(at, (0.0, 0.0, 0.0), size, 50.0)
        if hides([surface], light):
            continue
        (lamp,) = lamps_of([light])
        closed = surface.topology.closed
        clear[closed] += 1
        triangles = triangles_of([surface])
        middle = triangles.mean(axis=1)
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        turned = np.sum(normal * (lamp.centre - middle), axis=1) > 0.0
        seen = middle[turned] if closed else middle
        assert (brute_share(lamp, seen[::3], triangles, 3) == 1.0).all()
    assert min(clear.values()) >= 8 and sum(clear.values()) < 200


def test_pictures_are_those_of_all_the_shadows(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shown(surface: gs.Surface) -> Array:
        frame = gs.render([surface], small, lights, device=device)
        result = frame.radiance.astype(np.float64)
        frame.release()
        return result

    small = gs.Camera.from_lens((36.0, 24.0), 45.0, (120, 80), tuple(EYE), (0.0, 0.0, 0.0))
    lights = [LAMP, gs.SunLight((0.3, 1.0, -0.2), 5.0, 0.02)]
    plain = [gs.PointLight(LAMP.position, LAMP.power, shadows=False)]
    plain.append(gs.SunLight((0.3, 1.0, -0.2), 5.0, 0.02, shadows=False))
    sheet = wavy()
    twin = gs.render([sheet], small, plain, backend="numpy").radiance
    assert np.abs(shown(sheet) - twin).max() < 2e-5 * twin.max()
    # a sheet that hides some of itself isn't taken for one that doesn't
    steep, lights = wavy(0.08, 25.0), [gs.PointLight((-1.5, -0.3, 0.3), 50.0)]
    twin = gs.render([steep], small, lights, backend="numpy").radiance
    assert np.sqrt(np.mean((shown(steep) - twin) ** 2)) < 3e-3 * twin.max()
    monkeypatch.setattr(single_layer, "_single_layer", lambda *_: True)
    assert np.sqrt(np.mean((shown(steep) - twin) ** 2)) > 3e-2 * twin.max()
