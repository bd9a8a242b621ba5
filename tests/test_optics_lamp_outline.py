"""Shadows told by outlines in place of faces: against rays, and what faces must tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import TwinMismatch
from gpusim.gpu import Device
from gpusim.optics import half_shadow, lamp_layer, lamp_shadow, shadow_pass, shadow_tables
from gpusim.optics.binning import bin_edges
from gpusim.optics.emitters import lamps_of
from gpusim.optics.lamp_band import band_of, turning
from gpusim.optics.lamp_turn import turned_to
from gpusim.optics.lamp_view import LampView
from gpusim.optics.light import Light
from gpusim.optics.lighting import find_shadows
from gpusim.optics.loops import Loops
from gpusim.optics.outline_shadow import OutlineShadow
from gpusim.optics.shadow_probe import outlined_scene, probe_outlines
from gpusim.optics.shadow_tiles import Chains, ShadowTiles
from gpusim.optics.view import look
from tests.optics_rays import brute_share, triangles_of

Array = npt.NDArray[np.float64]

EYE = np.array([0.1, -1.0, 0.1])
CAMERA = gs.Camera.from_lens((36.0, 24.0), 45.0, (240, 160), tuple(EYE), (0.0, 0.0, 0.0))
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


def wall(y: float = 0.25, lean: float = 0.0) -> gs.Surface:
    near, far = y - lean, y + lean
    corners = [[-1.0, near, -0.8], [1.0, near, -0.8], [1.0, far, 0.8], [-1.0, far, 0.8]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), MATTE)


def sheet(scale: float = 0.6, y: float = 0.0, hole: float = 0.0, tilt: float = 0.0) -> gs.Surface:
    x, z = np.linspace(-0.5, 0.5, 23), np.linspace(-0.33, 0.33, 17)
    points = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(23, 17)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    faces = quads.reshape(-1, 4)
    middle = points[faces].mean(axis=1)
    faces = faces[np.hypot(middle[:, 0], middle[:, 2]) >= hole]
    used, faces = np.unique(faces, return_inverse=True)
    points = scale * points[used]
    points[:, 1] = y + tilt * points[:, 2] + 0.01 * np.sin(15.0 * points[:, 0])
    return gs.Surface(points, faces.reshape(-1, 4), MATTE)


def box(half: float = 0.12, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> gs.Surface:
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


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lamp_layer, "FEWEST", 500)
    monkeypatch.setattr(lamp_shadow, "MANY", 1)


def compared(
    surfaces: list[gs.Surface], light: Light, least: float = -np.inf
) -> tuple[ShadowTiles, Array, Array]:
    """What was found; what pixels' centres off edges see of the lamp by that, and by rays, from
    behind y = ``least``."""
    view = look(surfaces, CAMERA, lit=True)
    tiles = find_shadows(view, [light], surfaces)
    assert tiles is not None
    truth = gs.render(surfaces, CAMERA, [light], backend="numpy").truth()
    inside = ~np.isin(truth.row * CAMERA.width + truth.column, bin_edges(view).pixel)
    (lamp,) = lamps_of([light])
    turned = np.sum(truth.normal * (lamp.centre - (not lamp.far) * truth.reference), axis=1)
    rows = np.flatnonzero(inside & (turned > 0.0) & (truth.reference[:, 1] > least))
    # most where something changes
    part = tiles.entry[truth.row[rows] // 8, truth.column[rows] // 8] > 0
    rows = np.concatenate([rows[part][:: max(part.sum() // 200, 1)], rows[~part][::199]])
    seen, still = truth.reference[rows], np.zeros((len(rows), 3))
    place = truth.column[rows].astype(float), truth.row[rows].astype(float)
    shares = tiles.shares(*place, seen - EYE, truth.normal[rows], still, still)[:, 0]
    return tiles, shares, brute_share(lamp, seen, triangles_of(surfaces), 12)


def near(shares: Array, want: Array, light: Light) -> None:
    """Rays to a hundred points of the lamp tell to some percent, to one exactly."""
    away = np.abs(shares - want)
    limit = 0.06 if lamps_of([light])[0].extended else 1e-9
    assert (want < 0.5).sum() > 10 and (want > 0.5).sum() > 50
    # a ray may pass an edge that float32 has on the other side
    assert (away > limit).mean() < 1e-2 and (away > 0.1).sum() <= 1


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
def test_shares_of_lamps_are_those_of_rays(kind: str, name: str) -> None:
    before = {
        "sheet": sheet(), "hole": sheet(hole=0.12), "box": box(), "tilted": sheet(tilt=0.6),
    }[kind]  # fmt: skip
    tiles, shares, want = compared([before, wall(lean=0.1)], LIGHTS[name])
    near(shares, want, LIGHTS[name])
    # no face was listed where nothing comes near the wall
    assert len(tiles.chains.ends) > 0 and len(tiles.face) == 0


@pytest.mark.parametrize(
    "name", ["point", *(pytest.param(name, marks=pytest.mark.slow) for name in ("area", "large"))]
)
def test_several_over_each_other(name: str) -> None:
    """Tiles that one of them makes dark may be half lit as far as another is concerned."""
    surfaces = [box(0.06, (-0.12, -0.25, 0.05)), wall(), sheet(), sheet(0.4, 0.12, hole=0.1)]
    tiles, shares, want = compared(surfaces, LIGHTS[name])
    near(shares, want, LIGHTS[name])
    dark = np.flatnonzero((tiles.lit.reshape(-1) & 1) == 0)
    assert len(dark) > 5 or name == "large"
    assert (tiles.entry.reshape(-1)[dark] == 0).all()


@pytest.mark.parametrize("name", ["point", "area", pytest.param("sun", marks=pytest.mark.slow)])
def test_faces_tell_where_bodies_meet(name: str) -> None:
    """A sheet that leans at the wall and goes through it: outlines far from there alone."""
    surfaces = [sheet(0.5, 0.13, tilt=-0.5), wall(0.2)]
    tiles, shares, want = compared(surfaces, LIGHTS[name])
    near(shares, want, LIGHTS[name])
    assert len(tiles.face) > 0 and len(tiles.chains.ends) > 0


def test_faces_joined_for_far_receivers_hide_nothing_near_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A sheet before its own soft shadow, by faces alone: none of its pixels is dark."""

    def unsure(*of: tuple[int, int]) -> OutlineShadow:
        shape = of[-1]
        return replace(OutlineShadow.none(), unsure=np.arange(shape[0] * shape[1]))

    monkeypatch.setattr(lamp_shadow, "outline_shadow", unsure)
    monkeypatch.setattr(half_shadow, "MANY", 1 << 60)
    light = gs.AreaLight(PLACE, AIM, (0.5, 0.4), 50.0)
    tiles, shares, want = compared([sheet(0.7), wall(0.6)], light)
    assert len(tiles.face) > 0 and len(tiles.chains.ends) == 0
    near(shares, want, light)


def moved_end(chains: Chains) -> Chains:
    """With one of the vertices elsewhere."""
    ends = chains.ends.copy()
    ends[(ends == ends[len(ends) // 2, 0]).all(axis=2)] += [0.05, 0.0, 0.05]
    return replace(chains, ends=ends)


@pytest.mark.slow
def test_an_end_elsewhere_is_seen() -> None:
    light = LIGHTS["area"]
    tiles, shares, want = compared([sheet(), wall()], light)
    near(shares, want, light)
    wrong = replace(tiles, chains=moved_end(tiles.chains))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tests.test_optics_lamp_outline.find_shadows", lambda *_: wrong)
        _, shares, want = compared([sheet(), wall()], light)
    with pytest.raises(AssertionError):
        near(shares, want, light)


def test_the_device_with_an_end_elsewhere_is_found_out(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup = probe_outlines()
    shadow_pass._compare(device, setup, False)
    right = shadow_tables._ends
    monkeypatch.setattr(shadow_tables, "_ends", lambda chains: right(moved_end(chains)))
    with pytest.raises(TwinMismatch):
        shadow_pass._compare(device, setup, False)


def test_pictures_are_those_of_faces(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where lamps are many, and in a series."""
    surfaces, camera, lights = outlined_scene()
    moved = [surfaces[0], surfaces[1].moved(surfaces[1].points + np.array([0.02, 0.01, 0.05]))]

    def pictures() -> list[npt.NDArray[np.float32]]:
        frames = [gs.render(own, camera, lights, device=device) for own in (surfaces, moved)]
        return [frame.radiance for frame in frames]

    got = pictures()
    monkeypatch.setattr(
        "gpusim.optics.lighting.surfaces_alone", lambda lamps, *_: [[] for _ in lamps]
    )
    for one, other in zip(got, pictures(), strict=True):
        off = np.abs(one - other) / other.max()
        # an edge pixel under many lists may be the host's or the device's
        assert np.quantile(off, 0.999) < 0.01 and off.max() < 0.1


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
def test_shares_behind_round_bodies_are_those_of_rays(around: int, name: str) -> None:
    """Every point of a lamp with a size sees another outline of them. On the bodies themselves
    faces at the lamp's horizon hide what isn't lit anyway."""
    surfaces = [rod(around, around // 2), wall(lean=0.1)]
    tiles, shares, want = compared(surfaces, LIGHTS[name], 0.0)
    near(shares, want, LIGHTS[name])
    assert len(tiles.chains.ends) > 0


@pytest.mark.parametrize("around", [40, pytest.param(240, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["point", "disc", "sun", "large"])
def test_pictures_behind_round_bodies_are_those_of_faces(
    device: Device, monkeypatch: pytest.MonkeyPatch, name: str, around: int
) -> None:
    surfaces, light = [rod(around, around // 2), wall(1.0)], LIGHTS[name]
    (alone,) = lamp_layer.surfaces_alone(lamps_of([light]), surfaces, EYE)
    assert len(alone) == 1
    patch = alone[0].patch
    if isinstance(patch, lamp_layer.Later):
        # folds of its outline reach too far to be sure that it hides nothing of itself
        assert name != "point" and patch.patch is not None
        patch = patch.patch
    assert (len(patch.band) > 30) == (name != "point")
    tiles = find_shadows(look(surfaces, CAMERA, lit=True), [light], surfaces)
    assert tiles is not None and len(tiles.chains.ends) > 0
    # the wall's tiles list faces of the band alone
    assert around == 40 or len(np.unique(tiles.face)) < 0.25 * len(surfaces[0].faces)
    got = np.array(gs.render(surfaces, CAMERA, [light], device=device).radiance, np.float64)
    monkeypatch.setattr(
        "gpusim.optics.lighting.surfaces_alone", lambda lamps, *_: [[] for _ in lamps]
    )
    want = np.array(gs.render(surfaces, CAMERA, [light], device=device).radiance, np.float64)
    away = np.abs(got - want) / want.max()
    # a sample of the lamp, one either way
    assert away.max() < 2.5 / 512
    assert away.mean() < 2e-5


@pytest.mark.parametrize(
    "name",
    ["point", *(pytest.param(name, marks=pytest.mark.slow) for name in ("area", "disc", "sun"))],
)
def test_a_body_that_hides_parts_of_itself(name: str) -> None:
    """Its border tells what the wall sees of the lamp, faces what it sees of it itself."""
    parts = [box(0.08, (-0.1, -0.3, 0.08)), box(0.1, (0.03, -0.02, 0.0))]
    points = np.concatenate([part.points for part in parts])
    faces = np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].points)])
    surfaces = [gs.Surface(points, faces, MATTE), wall(lean=0.1)]
    (alone,) = lamp_layer.surfaces_alone(lamps_of([LIGHTS[name]]), surfaces, EYE)
    assert isinstance(alone[0].patch, lamp_layer.Later)
    tiles, shares, want = compared(surfaces, LIGHTS[name])
    near(shares, want, LIGHTS[name])
    assert len(tiles.chains.ends) > 0 and len(tiles.face) > 0


@pytest.mark.parametrize("around", [12, 40, 120])
@pytest.mark.parametrize("name", ["area", "large", "sun"])
def test_a_border_and_a_band_hide_what_the_body_hides(around: int, name: str) -> None:
    """Rays from points all over the lamp, against all of the body's triangles."""
    body = rod(around, around // 2)
    (lamp,) = lamps_of([LIGHTS[name]])
    view = LampView.of(lamp)[0]
    places = np.stack(view.place(*body.points.T))
    topology = body.topology
    turned = turned_to(view, places, topology.triangles, True)
    assert turned is not None
    own = turning(turned, topology.source)
    assert own is not None
    band = band_of(view, places, topology, turned, own)
    assert band is not None
    assert 0.01 < band.triangles.mean() < 0.3 and not (band.triangles & band.dark).any()
    rng = np.random.default_rng(3)
    low, high = places[:2].min(axis=1), places[:2].max(axis=1)
    hidden = told = 0
    for a, b in rng.uniform(-1.0, 1.0, (6, 2)) * view.half:
        at = np.stack([places[0] - a * places[2], places[1] - b * places[2]])
        middle = places[2].mean() * np.array([a, b])
        # half of the rays near the outline
        ends = at[:, rng.choice(np.unique(topology.triangles[band.triangles]), 150)]
        rays = np.concatenate(
            [rng.uniform(low, high, (150, 2)) - middle, ends.T * (1.0 + rng.normal(0, 0.003, 2))]
        )
        sides = _inside(rays, at[:, topology.triangles])
        turn = np.sign(view.across @ np.cross(view.along, view.axis))
        want = (sides != 0).any(axis=1)
        around_it = _winding(rays, at, band.border)
        enters = (sides * turn > 0)[:, band.triangles].any(axis=1)
        np.testing.assert_array_equal((around_it != 0) | enters, want)
        hidden, told = hidden + want.sum(), told + ((around_it == 0) & enters).sum()
    assert hidden > 200 and told > 5


def _inside(rays: Array, corners: Array) -> npt.NDArray[np.int64]:
    """(N, T): 1 or -1 where rays (N, 2) meet triangles (2, T, 3), by the way these go round."""
    a, b = corners, np.roll(corners, -1, axis=2)
    way = b - a
    to = rays.T[:, :, None, None] - a[:, None]
    cross = way[0] * to[1] - way[1] * to[0]
    left, right = (cross > 0.0).all(axis=2), (cross < 0.0).all(axis=2)
    return left.astype(np.int64) - right.astype(np.int64)


def _winding(rays: Array, at: Array, border: Loops) -> npt.NDArray[np.int64]:
    """(N,) how often a border winds round rays (N, 2)."""
    start, end = at[:, border.vertex], at[:, border.vertex[border.after]]
    x, y = rays.T[:, :, None]
    up = (start[1] <= y).astype(np.int64) - (end[1] <= y)
    share = (y - start[1]) / np.where(up != 0, end[1] - start[1], 1.0)
    return np.asarray((up * (start[0] + share * (end[0] - start[0]) > x)).sum(axis=1))
