"""Shadows on the device against rays in float64: lamps of all kinds, and what they may stand in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.light.lights import AreaLight, Light, PointLight, SpotLight, SunLight
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shadow.brute_force import shares_twin
from gpusim.optics.shadow.light_space import light_spaces
from gpusim.optics.shadow.occluders import NO_OCCLUDER, Occluders, relative_points
from gpusim.optics.shadow.receivers import Receivers
from gpusim.optics.shadow.sample_mask import SAMPLES
from tests.support.shadow_rays import box, by_rays, found, on_plane, sheet

AREA = AreaLight((-0.6, -0.3, 1.0), (0.0, 0.0, 0.1), (0.3, 0.2), 5.0)
DISC = AreaLight((0.5, 0.6, 0.9), (0.0, 0.0, 0.1), (0.25, 0.25), 5.0, shape="ellipse")
POINT = PointLight((0.4, -0.7, 0.8), 5.0)
SPOT = SpotLight((-0.2, -0.8, 1.1), (0.0, 0.1, 0.0), 3.0, cone=0.9)
SUN = SunLight((0.4, 0.3, -1.0), 0.6, diameter=0.05)
THIN_SUN = SunLight((0.4, 0.3, -1.0), 0.6, diameter=0.0)
LAMPS = [AREA, DISC, POINT, SPOT, SUN, THIN_SUN]
INSIDE = [
    PointLight((0.1, 0.05, 0.5), 5.0), AreaLight((0.1, 0.05, 0.5), (0.1, 0.2, 0.0), (0.1, 0.1), 5.0)
]  # fmt: skip

RMS, MOST = 0.01, 0.07
"""Of shares: 512 samples, and 400 rays of each lamp and piece."""


def scene() -> list[gs.Surface]:
    return [
        box((0.0, 0.0, 0.2), (0.15, 0.1, 0.1), 2), sheet((-0.5, 0.1), (-0.1, 0.5), 0.3, 6, 0.03)
    ]  # fmt: skip


def agree(
    device: Device, surfaces: Sequence[gs.Surface], lights: Sequence[Light], own: Receivers
) -> np.ndarray:
    """What the device finds, which has to be what rays and the flat loop say."""
    eye = np.array([0.3, -1.4, 0.9])
    got = found(device, surfaces, lights, own, eye)
    want = by_rays(surfaces, lights, own)
    assert np.isfinite(got).all()
    assert np.abs(got - want).max() <= MOST
    assert (np.sqrt(((got - want) ** 2).mean(axis=0)) <= RMS).all()
    points = relative_points(surfaces, eye)
    spaces = light_spaces(lamps_of(lights), points, eye)
    moved = Receivers(own.at - eye, own.normal, own.across, own.down, own.on)
    flat = shares_twin(Occluders.of(surfaces), points[:, :3].astype(float), spaces, moved)
    assert np.abs(got - flat).max() <= 2.5 / SAMPLES
    return want


def test_every_kind_of_lamp(device: Device) -> None:
    want = agree(device, scene(), LAMPS, on_plane(60, (-0.8, -0.8), (0.8, 0.8)))
    assert (want.min(axis=0) < 0.01).all() and (want.max(axis=0) > 0.99).all()
    assert ((want > 0.1) & (want < 0.9)).sum() > 10


def test_a_lamp_larger_than_the_scene(device: Device) -> None:
    large = AreaLight((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (2.0, 1.5), 5.0)
    agree(device, scene(), [large], on_plane(60, (-0.8, -0.8), (0.8, 0.8)))


def test_a_body_on_the_ground(device: Device) -> None:
    own = on_plane(90, (-0.45, -0.4), (0.45, 0.4))
    # pieces half under a body are none that a picture has
    beside = np.abs(own.at[:, :2]) - [0.2, 0.15]
    own = own[np.abs(beside.max(axis=1)) > 0.01]
    surfaces = [box((0.0, 0.0, 0.1), (0.2, 0.15, 0.1), 2), sheet((-1.0, -1.0), (1.0, 1.0), 0.0, 3)]
    want = agree(device, surfaces, LAMPS, own)
    under = (np.abs(own.at[:, :2]) < [0.19, 0.14]).all(axis=1)
    assert under.sum() > 5 and (want[under] == 0.0).all()


def test_occluders_pass_through_the_lamps_plane(device: Device) -> None:
    wall = [[0.0, -0.9, 0.0], [0.0, 0.9, 0.0], [0.1, 0.9, 1.5], [0.1, -0.9, 1.5]]
    surfaces = [
        gs.Surface(np.array(wall), np.array([[0, 1, 2, 3]]), gs.paint.Plain(0.5)),
        box((0.3, 0.2, 0.55), (0.5, 0.1, 0.3)), box((0.5, -0.3, 0.5), (0.1, 0.1, 0.4), 3),
    ]  # fmt: skip
    lamp = AreaLight((0.3, 0.2, 0.5), (0.35, 0.2, 0.0), (0.4, 0.3), 5.0)
    want = agree(device, surfaces, [lamp], on_plane(80, (-0.8, -0.8), (0.8, 0.8)))
    assert ((want > 0.1) & (want < 0.9)).sum() > 10


@pytest.mark.parametrize("place", ["among bodies", "closed box", "open box", "room"])
def test_a_lamp_inside_the_scene(device: Device, place: str) -> None:
    around = {
        "among bodies": [
            box((0.1, 0.3, 0.5), (0.2, 0.05, 0.4), 2), box((-0.3, 0.0, 0.25), (0.1, 0.3, 0.2), 2),
            box((0.0, 0.0, 1.2), (0.5, 0.5, 0.1), 2),
        ],
        "closed box": [box((0.1, 0.05, 0.5), (0.2, 0.2, 0.2), 3)],
        "open box": [box((0.1, 0.05, 0.5), (0.2, 0.2, 0.2), 3, open_top=True)],
        "room": [box((0.0, 0.0, 0.5), (0.9, 0.9, 0.6), 4), box((0.3, 0.2, 0.2), (0.1, 0.1, 0.1))],
    }  # fmt: skip
    want = agree(device, around[place], INSIDE, on_plane(60, (-0.8, -0.8), (0.8, 0.8)))
    if place != "among bodies" and place != "room":
        assert (want == 0.0).all()
    assert len(light_spaces(lamps_of(INSIDE[:1]), relative_points(around[place], np.zeros(3)),
                            np.zeros(3))) == 2  # fmt: skip


@pytest.mark.parametrize("count", [7, 8, 9, 16, 17, 32])
def test_many_layers(device: Device, count: int) -> None:
    sheets = [sheet((-0.3, -0.3), (0.3, 0.3), 0.2 + 0.003 * k, 1) for k in range(count)]
    own = on_plane(25, (-0.3, -0.3), (0.5, 0.5))
    want = agree(device, sheets, [AREA, POINT], own)
    assert (want < 0.01).sum() > 10


def test_a_lattice_of_bars(device: Device) -> None:
    bars = [box((0.0, 0.0, 0.1 + 0.012 * k), (0.2, 0.02, 0.005)) for k in range(15)]
    bars += [box((0.0, 0.0, 0.28 + 0.012 * k), (0.02, 0.2, 0.005)) for k in range(15)]
    agree(device, bars, [AREA, POINT], on_plane(50, (-0.3, -0.3), (0.6, 0.6)))


def joined(surfaces: Sequence[gs.Surface]) -> gs.Surface:
    """One surface of several, whose vertices in one place are one."""
    points = np.concatenate([surface.points for surface in surfaces])
    first = np.cumsum([0, *(len(surface.points) for surface in surfaces)])
    faces = np.concatenate([v.faces + n for v, n in zip(surfaces, first[:-1], strict=True)])
    places, same = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    faces = same.reshape(-1)[faces].astype(np.int32)
    return gs.Surface(places, faces, gs.paint.Plain(0.5))


def test_t_junctions(device: Device) -> None:
    points = [[-0.3, -0.3, 0.2], [0.3, -0.3, 0.2], [0.3, 0.0, 0.22], [0.0, 0.0, 0.22],
              [-0.3, 0.0, 0.22], [0.3, 0.3, 0.2], [0.0, 0.3, 0.2], [-0.3, 0.3, 0.2]]  # fmt: skip
    quads = [[0, 1, 2, 4], [4, 3, 6, 7], [3, 2, 5, 6]]
    surface = gs.Surface(np.array(points), np.array(quads), gs.paint.Plain(0.5))
    agree(device, [surface], LAMPS[:4], on_plane(50, (-0.6, -0.6), (0.6, 0.6)))


def test_edges_of_more_than_two_triangles(device: Device) -> None:
    surface = joined(
        [box((0.0, 0.0, 0.2), (0.2, 0.2, 0.05)), box((0.4, 0.4, 0.2), (0.2, 0.2, 0.05))]
    )
    assert (np.bincount(surface.topology.edge.reshape(-1)) == 4).any()
    neighbours = Occluders.of([surface]).neighbours
    assert (neighbours == NO_OCCLUDER).sum() == 4
    agree(device, [surface], LAMPS[:4], on_plane(50, (-0.7, -0.7), (0.7, 0.7)))


def test_level_with_a_lamp_inside_the_scene(device: Device) -> None:
    # where its two spaces meet
    turn = np.linspace(0.1, 6.2, 40)
    way = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    up = np.broadcast_to([0.0, 0.0, 0.01], way.shape)
    along = 0.01 * np.cross(way, [0.0, 0.0, 1.0])
    own = Receivers(0.9 * way, -way, along, up, np.full(len(turn), -1))
    bodies = [box((x, x, 0.0), (0.1, 0.1, 0.2)) for x in (-0.3, 0.3)]
    room = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    want = agree(device, [room, *bodies], [PointLight((0.0, 0.0, 0.0), 5.0)], own)
    assert want.min() == 0.0 and want.max() == 1.0


def test_as_many_triangles_as_leaves(device: Device) -> None:
    # the walk through the tree has to end after its last leaf
    surface = sheet((-0.3, -0.3), (0.3, 0.3), 0.2, 8)
    assert Occluders.of([surface]).count == 128
    agree(device, [surface], [AREA, POINT], on_plane(40, (-0.1, -0.1), (0.5, 0.7)))


def test_a_lamp_partly_below_the_horizon(device: Device) -> None:
    """Where a sheet hides what of it is above, little is left, whatever is below."""
    wall = [[0.5, -0.6, 0.02], [0.5, 0.6, 0.02], [0.5, 0.6, 1.0], [0.5, -0.6, 1.0]]
    grazing = [
        AreaLight((1.5, 0.1, 0.07), (0.0, 0.0, 0.0), (0.13, 0.31), 5.0),
        AreaLight((1.5, 0.1, 0.1), (0.0, 0.0, 0.0), (0.3, 0.3), 5.0, shape="ellipse"),
        SunLight((-1.0, 0.1, -0.01), 0.6, diameter=0.05),
    ]
    surfaces = [gs.Surface(np.array(wall), np.array([[0, 1, 2, 3]]), gs.paint.Plain(0.5))]
    want = agree(device, surfaces, grazing, on_plane(80, (-0.8, -0.6), (0.8, 0.6)))
    assert ((want < 0.6) & (want > 0.0)).any(axis=0).all()
    assert (want == 1.0).any(axis=0).all()
