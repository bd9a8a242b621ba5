"""What the places that pixels show see of a lamp, past sheets and bodies of many kinds: by rays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shading.lighting import find_shadows
from gpusim.optics.shadow.lamp_visibility import VisibleShares
from gpusim.optics.shadow.sample_mask import SAMPLES
from gpusim.optics.visibility_buffer import visibility_twin
from tests.support.optics_rays import brute_share, triangles_of
from tests.support.optics_skins import skin_of

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Place = tuple[float, float, float]

CAMERA = gs.Camera.from_lens((36.0, 24.0), 45.0, (240, 160), (0.1, -1.0, 0.1), (0.0, 0.0, 0.0))
ABOVE = gs.Camera.from_lens((36.0, 24.0), 34.0, (240, 160), (0.1, -1.2, 0.3), (0.0, 0.1, 0.0))
BESIDE = gs.Camera.from_lens((36.0, 24.0), 34.0, (240, 160), (0.9, -0.9, 0.3), (0.0, 0.1, 0.0))
MATTE = gs.paint.Plain(0.8)
PLACE, AIM = (-0.6, -1.3, 0.5), (0.0, 0.0, 0.0)
LIGHTS: dict[str, Light] = {
    "point": gs.PointLight(PLACE, 50.0),
    "spot": gs.SpotLight(PLACE, AIM, 50.0, cone=0.6),
    "area": gs.AreaLight(PLACE, AIM, (0.2, 0.1), 50.0),
    "large": gs.AreaLight(PLACE, AIM, (0.9, 0.7), 50.0),
    "disc": gs.AreaLight(PLACE, AIM, (0.15, 0.15), 50.0, shape="ellipse"),
    "sun": gs.SunLight((0.5, 1.0, -0.4), 5.0, diameter=0.08),
    "sharp sun": gs.SunLight((0.5, 1.0, -0.4), 5.0, diameter=0.0),
}
LOW: dict[str, Light] = {
    "point": gs.PointLight((-1.5, -0.35, 0.4), 50.0),
    "area": gs.AreaLight((-1.5, -0.35, 0.4), AIM, (0.2, 0.1), 50.0),
    "disc": gs.AreaLight((-1.5, -0.6, 0.4), AIM, (0.1, 0.1), 50.0, shape="ellipse"),
    "sun": gs.SunLight((1.0, 0.4, -0.3), 5.0, diameter=0.05),
    "sharp sun": gs.SunLight((1.0, 0.4, -0.3), 5.0, diameter=0.0),
}


def compared(
    device: Device,
    surfaces: list[gs.Surface],
    light: Light,
    camera: gs.Camera = CAMERA,
    least: float = -np.inf,
    soft: int = 200,
    rays: int = 12,
) -> tuple[Array, Array]:
    """What is seen of a lamp from the middles of pixels off edges that are turned to it, behind y =
    ``least``: by the device, and by ``rays`` each way over the lamp. About ``soft`` of them where
    something changes, or as many there as elsewhere if that is 0."""
    view = look(surfaces, camera, lit=True)
    shadows = find_shadows(view, [light], surfaces, device)
    assert shadows is not None
    truth = gs.render(surfaces, camera, None, backend="numpy").truth()
    triangle = visibility_twin(view)[truth.row, truth.column].astype(np.int64) - 1
    inside = ~np.isin(truth.row * camera.width + truth.column, find_edge_pixels(view).pixel)
    (lamp,) = lamps_of([light])
    turned = np.sum(truth.normal * (lamp.centre - (not lamp.far) * truth.reference), axis=1)
    rows = np.flatnonzero(inside & (turned > 0.0) & (truth.reference[:, 1] > least))
    seen, still = truth.reference[rows], np.zeros((len(rows), 3))
    own = shadows.receivers(seen - camera.eye, truth.normal[rows], still, still, triangle[rows])
    shares = VisibleShares(device, shadows.occluders, own).find(shadows.points, shadows.spaces)[
        :, 0
    ]
    tile = truth.row[rows] // 8 * camera.width + truth.column[rows] // 8
    low, high = np.full(tile.max() + 1, 2.0), np.full(tile.max() + 1, -1.0)
    np.minimum.at(low, tile, shares)
    np.maximum.at(high, tile, shares)
    part = np.flatnonzero(low[tile] < high[tile])
    rest = np.flatnonzero(low[tile] == high[tile])
    kept = np.arange(0, len(rows), 151)
    if soft:
        kept = np.concatenate([part[:: max(len(part) // soft, 1)], rest[::199]])
    # off the plane by what rounding may put a place behind
    start = seen[kept] + 1e-6 * truth.normal[rows[kept]]
    return shares[kept].astype(np.float64), brute_share(lamp, start, triangles_of(surfaces), rays)


def near(shares: Array, want: Array, light: Light) -> None:
    """Rays to a hundred points of the lamp tell to some percent, to one exactly."""
    away = np.abs(shares - want)
    limit = 0.06 if lamps_of([light])[0].extended else 1e-9
    assert (want < 0.5).sum() > 10 and (want > 0.5).sum() > 50
    # a ray may pass an edge that float32 has on the other side
    assert (away > limit).mean() < 1e-2 and (away > 0.1).sum() <= 1


def wall(y: float = 0.25, lean: float = 0.0) -> gs.Surface:
    near, far = y - lean, y + lean
    corners = [[-1.0, near, -0.8], [1.0, near, -0.8], [1.0, far, 0.8], [-1.0, far, 0.8]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), MATTE)


def grid(columns: int, rows: int, half: tuple[float, float]) -> tuple[Array, Numbers]:
    """Points of a flat sheet across y, and its quads, towards smaller y."""
    x, z = (np.linspace(-h, h, n + 1) for h, n in zip(half, (columns, rows), strict=True))
    points = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(columns + 1, rows + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    return points, quads.reshape(-1, 4)


def sheet(scale: float = 0.6, y: float = 0.0, hole: float = 0.0, tilt: float = 0.0) -> gs.Surface:
    points, faces = grid(22, 16, (0.5, 0.33))
    middle = points[faces].mean(axis=1)
    faces = faces[np.hypot(middle[:, 0], middle[:, 2]) >= hole]
    used, faces = np.unique(faces, return_inverse=True)
    points = scale * points[used]
    points[:, 1] = y + tilt * points[:, 2] + 0.01 * np.sin(15.0 * points[:, 0])
    return gs.Surface(points, faces.reshape(-1, 4), MATTE)


def box(half: float = 0.12, centre: Place = (0.0, 0.0, 0.0)) -> gs.Surface:
    """A closed body of fine faces, none of them edge-on to the lamps."""
    n = 8
    u, v = (k.reshape(-1) for k in np.meshgrid(*2 * [np.linspace(-1.0, 1.0, n + 1)], indexing="ij"))
    number = np.arange(u.size).reshape(n + 1, n + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    sides, faces = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            side = np.empty((u.size, 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = sign, u, v
            faces.append(quads.reshape(-1, 4)[:, :: int(sign)] + u.size * len(sides))
            sides.append(side)
    points, which = np.unique(np.concatenate(sides), axis=0, return_inverse=True)
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    every = which.reshape(-1)[np.concatenate(faces)]
    return gs.Surface(np.array(centre) + half * points @ turn.T, every, MATTE)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("sheet", "point"),
        ("hole", "point"),
        ("box", "spot"),
        *(
            pytest.param(kind, name, marks=pytest.mark.slow)
            for kind, name in [
                *(("sheet", name) for name in LIGHTS if name != "point"),
                ("hole", "area"),
                ("box", "area"),
                ("tilted", "large"),
            ]
        ),
    ],
)
def test_one_body_before_a_wall(device: Device, kind: str, name: str) -> None:
    before = {
        "sheet": sheet(), "hole": sheet(hole=0.12), "box": box(), "tilted": sheet(tilt=0.6),
    }[kind]  # fmt: skip
    near(*compared(device, [before, wall(lean=0.1)], LIGHTS[name]), LIGHTS[name])


@pytest.mark.parametrize(
    "name", ["point", *(pytest.param(name, marks=pytest.mark.slow) for name in ("area", "large"))]
)
def test_several_over_each_other(device: Device, name: str) -> None:
    surfaces = [box(0.06, (-0.12, -0.25, 0.05)), wall(), sheet(), sheet(0.4, 0.12, hole=0.1)]
    near(*compared(device, surfaces, LIGHTS[name]), LIGHTS[name])


@pytest.mark.parametrize("name", ["point", "area", pytest.param("sun", marks=pytest.mark.slow)])
def test_a_sheet_that_leans_at_the_wall_and_goes_through_it(device: Device, name: str) -> None:
    surfaces = [sheet(0.5, 0.13, tilt=-0.5), wall(0.2)]
    near(*compared(device, surfaces, LIGHTS[name]), LIGHTS[name])


def test_a_sheet_before_its_own_soft_shadow(device: Device) -> None:
    light = gs.AreaLight(PLACE, AIM, (0.5, 0.4), 50.0)
    near(*compared(device, [sheet(0.7), wall(0.6)], light), light)


def rod(around: int, along: int, bend: float = 0.15) -> gs.Surface:
    """A bent round bar with round ends, closed, before the wall."""
    turn = np.arange(around) * (2.0 * np.pi / around)
    end = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, along + 2)[1:-1])
    x = 0.25 * end
    radius = 0.06 * np.sqrt(1.0 - end**8)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.concatenate(
        [np.insert(r * ring, 0, at, axis=1) for at, r in zip(x, radius, strict=True)]
    )
    points = np.concatenate([points, [[-0.25, 0.0, 0.0], [0.25, 0.0, 0.0]]])
    points[:, 2] -= bend * points[:, 0] ** 2
    k = np.arange(along - 1)[:, None] * around + np.arange(around)
    after = k - np.arange(around) + (np.arange(around) + 1) % around
    faces = np.stack([k, after, after + around, k + around], axis=-1).reshape(-1, 4)
    first, last = np.arange(around), (along - 1) * around + np.arange(around)
    tips = [
        np.stack([np.full(around, len(points) - 2), np.roll(first, -1), first], axis=1),
        np.stack([np.full(around, len(points) - 1), last, np.roll(last, -1)], axis=1),
    ]
    triangles = np.insert(np.concatenate(tips), 3, -1, axis=1)
    points += np.array([0.0, -0.15, 0.1])
    return gs.Surface(points, np.concatenate([faces, triangles]), MATTE)


@pytest.mark.parametrize(
    ("around", "name"),
    [
        (40, "point"),
        (40, "area"),
        *(
            pytest.param(around, name, marks=pytest.mark.slow)
            for around, name in ((40, "large"), (40, "disc"), (40, "sun"), (64, "area"))
        ),
    ],
)
def test_behind_a_round_bar(device: Device, around: int, name: str) -> None:
    """Every point of a lamp with a size sees another outline of it."""
    surfaces = [rod(around, around // 2), wall(lean=0.1)]
    near(*compared(device, surfaces, LIGHTS[name], least=0.0), LIGHTS[name])


@pytest.mark.parametrize(
    "name",
    ["point", *(pytest.param(name, marks=pytest.mark.slow) for name in ("area", "disc", "sun"))],
)
def test_a_body_that_hides_parts_of_itself(device: Device, name: str) -> None:
    parts = [box(0.08, (-0.1, -0.3, 0.08)), box(0.1, (0.03, -0.02, 0.0))]
    points = np.concatenate([part.points for part in parts])
    faces = np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].points)])
    surfaces = [gs.Surface(points, faces, MATTE), wall(lean=0.1)]
    near(*compared(device, surfaces, LIGHTS[name]), LIGHTS[name])


def skin(filled: npt.NDArray[np.bool_], size: Place) -> gs.Surface:
    """That of cells, closed, of a body of such a ``size``."""
    corners, quads = skin_of(filled)
    points = (corners / np.array(filled.shape) - 0.5) * np.array(size)
    points[:, 2] -= 0.1 * points[:, 0] ** 2
    return gs.Surface(points, quads, MATTE)


def shelf(boards: int = 9) -> gs.Surface:
    """Boards over each other that a back holds: one body, as many layers before what is behind."""
    filled = np.zeros((12, 8, 2 * boards - 1), bool)
    filled[:, :, ::2] = filled[:, -1] = True
    return skin(filled, (0.4, 0.2, 0.4))


def beam() -> gs.Surface:
    part = np.arange(14) * 7 // 14
    section = (part[:, None] == 3) | (part == 0) | (part == 6)
    return skin(np.broadcast_to(section, (60, 14, 14)), (0.8, 0.2, 0.2))


def angle(fine: int = 4) -> gs.Surface:
    """A bent L beam, closed: one leg's shadow falls on the other."""
    filled = np.zeros((6 * fine, 3 * fine, 3 * fine), bool)
    filled[:, fine:, :fine] = filled[:, -fine:] = True
    return skin(filled, (0.6, 0.3, 0.3))


def ring(points: Array, radius: float, around: int) -> tuple[Array, Numbers]:
    """A tube round a line of points (n, 3), and its quads; not closed by ends."""
    way = np.gradient(points, axis=0)
    way /= np.linalg.norm(way, axis=1)[:, None]
    side = np.cross(way, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    other = np.cross(way, side)
    turn = 2.0 * np.pi * np.arange(around) / around
    circle = np.cos(turn)[:, None] * side[:, None] + np.sin(turn)[:, None] * other[:, None]
    first = np.arange(around)
    row, after = around * np.arange(len(points) - 1)[:, None], np.roll(first, -1)
    quads = [first + row, after + row, after + row + around, first + row + around]
    skinned = (points[:, None] + radius * circle).reshape(-1, 3)
    return skinned, np.stack(quads, axis=-1).reshape(-1, 4)


def tube() -> gs.Surface:
    x = np.linspace(-0.35, 0.35, 30)
    return gs.Surface(*ring(np.stack([x, 0.0 * x, -0.1 * x**2], axis=1), 0.1, 48), MATTE)


def spring(turns: int = 9) -> gs.Surface:
    """One strip over itself ``turns`` times, as the lamp along its axis sees it."""
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 24 * turns)
    place = [0.12 * np.cos(angle), 0.04 * angle / (2.0 * np.pi) - 0.18, 0.12 * np.sin(angle)]
    points, quads = ring(np.stack(place, axis=1), 0.035, 12)
    ends = [np.arange(12)[::-1], len(points) - 12 + np.arange(12)]
    middle = [points[end].mean(axis=0) for end in ends]
    caps = [
        np.stack([end, np.roll(end, -1), np.full(12, len(points) + k), np.full(12, -1)], axis=1)
        for k, end in enumerate(ends)
    ]
    faces = np.concatenate([quads, *caps])
    whole = np.concatenate([points, middle])
    corner = whole[np.where(faces < 0, faces[:, 2:3], faces)]
    volume = np.einsum("fa,fa->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))
    if volume < 0.0:
        faces = np.where((faces[:, 3:] < 0), faces[:, [1, 0, 2, 3]], faces[:, ::-1])
    return gs.Surface(whole, faces, MATTE)


BODIES = {"shelf": shelf, "beam": beam, "tube": tube, "spring": spring, "angle": angle}
LAMP = gs.AreaLight((-0.5, -1.1, 1.3), (0.0, 0.1, 0.0), (0.25, 0.15), 50.0)
ALONG = gs.AreaLight((0.05, -1.5, 0.1), (0.0, 0.1, 0.0), (0.12, 0.08), 50.0)
"""About along the spring."""


@pytest.mark.parametrize("body", list(BODIES))
def test_bodies_of_several_layers(device: Device, body: str) -> None:
    light = ALONG if body == "spring" else LAMP
    shares, want = compared(device, [BODIES[body](), wall(0.4)], light, ABOVE, soft=60, rays=8)
    assert (want < 0.5).sum() > 10 and (want > 0.5).sum() > 10
    away = np.abs(shares - want)
    assert (away > 0.08).mean() < 0.05 and np.median(away) < 0.01


def discs(count: int) -> gs.Surface:
    """Flat round bodies one behind the other, which are one surface."""
    around, across = 24, 12
    turn = np.arange(around) * (2.0 * np.pi / around)
    tilt = np.linspace(-0.5 * np.pi, 0.5 * np.pi, across + 2)[1:-1]
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings = [np.insert(np.cos(a) * ring, 1, np.sin(a), axis=1) for a in tilt]
    ball = np.concatenate([*rings, [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]]) * [0.15, 0.01, 0.15]
    k = np.arange(across - 1)[:, None] * around + np.arange(around)
    after = k - np.arange(around) + (np.arange(around) + 1) % around
    sides = np.stack([k, k + around, after + around, after], axis=-1).reshape(-1, 4)
    first, none = np.arange(around), np.full(around, -1)
    last, tip = first + (across - 1) * around, across * around
    ends = [
        np.stack([np.full(around, tip), first, np.roll(first, -1), none], axis=1),
        np.stack([np.full(around, tip + 1), np.roll(last, -1), last, none], axis=1),
    ]
    faces = np.concatenate([sides, *ends])
    place, apart = np.array([0.0, -0.5, 0.0]), np.array([0.004, 0.05, 0.003])
    points = [ball + place + n * apart for n in range(count)]
    used = [np.where(faces < 0, -1, faces + n * len(ball)) for n in range(count)]
    return gs.Surface(np.concatenate(points), np.concatenate(used), MATTE)


@pytest.mark.parametrize("far", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("count", [pytest.param(6, marks=pytest.mark.slow), 8,
                                   pytest.param(9, marks=pytest.mark.slow)])  # fmt: skip
def test_layers_over_each_other_are_no_hole(device: Device, count: int, far: bool) -> None:
    light: Light = gs.AreaLight((0.0, -2.0, 0.0), AIM, (0.1, 0.1), 50.0)
    if far:
        light = gs.SunLight((0.0, 1.0, 0.0), 5.0, diameter=0.01)
    near(*compared(device, [discs(count), wall(0.4)], light, BESIDE, 0.3, 60), light)


def eggs(columns: int = 54, rows: int = 36) -> gs.Surface:
    """Bumps that a low lamp's light doesn't get behind; of triangles, as a bent quad may hide some
    of itself from rays that begin at it."""
    points, faces = grid(columns, rows, (0.33, 0.22))
    points[:, 1] = 0.03 * np.sin(25.0 * points[:, 0] + 0.3) * np.sin(23.0 * points[:, 2])
    triangles = np.concatenate([faces[:, :3], faces[:, [0, 2, 3]]])
    return gs.Surface(points, triangles, MATTE)


@pytest.mark.parametrize("name", LOW)
def test_bumps_in_grazing_light(device: Device, name: str) -> None:
    near(*compared(device, [eggs()], LOW[name]), LOW[name])


@pytest.mark.parametrize(
    "light",
    [
        gs.PointLight((-1.5, -0.35, 0.3), 50.0),
        gs.AreaLight((-1.5, -0.6, 0.3), (0.0, 0.0, 0.0), (0.15, 0.1), 50.0),
    ],
)
def test_a_sheet_that_hides_some_of_itself(device: Device, light: Light) -> None:
    points, faces = grid(40, 24, (0.4, 0.25))
    points[:, 1] = 0.05 * np.sin(16.0 * points[:, 0]) * np.cos(6.0 * points[:, 2])
    triangles = np.concatenate([faces[:, :3], faces[:, [0, 2, 3]]])
    got, want = compared(device, [gs.Surface(points, triangles, MATTE)], light, soft=0, rays=16)
    assert (want < 0.5).sum() > 5 and (want == 1.0).sum() > 50
    assert (got[want == 1.0] == 1.0).mean() > 0.99
    assert np.abs(got - want).mean() < 0.005


@pytest.mark.parametrize("cut", [1, 24])
def test_how_finely_a_flat_sheet_is_cut_changes_no_shadow(device: Device, cut: int) -> None:
    points, faces = grid(cut, cut, (0.3, 0.2))
    whole = gs.Surface(*grid(3, 2, (0.3, 0.2)), MATTE)
    fine = gs.Surface(points, faces, MATTE)
    one, other = (
        gs.render([v, wall()], CAMERA, [LIGHTS["area"]], device=device).radiance.astype(np.float64)
        for v in (whole, fine)
    )
    changed = np.abs(one - other) / one.max()
    assert changed.max() <= 3.0 / SAMPLES and (changed > 1e-6).mean() < 0.05
