"""Contours in place of the faces before tiles: against rays, against faces, layer over layer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics import half_shadow, tile_contours
from gpusim.optics.casters import Casters
from gpusim.optics.emitters import lamps_of
from gpusim.optics.light import Light
from gpusim.optics.lighting import find_shadows
from gpusim.optics.setup import Setup
from gpusim.optics.shade import shade_twin
from gpusim.optics.shadow_tiles import ShadowTiles
from gpusim.optics.tile_contours import sides_of
from gpusim.optics.tile_edges import Closing
from gpusim.optics.view import look
from gpusim.optics.visibility import visibility_twin
from tests.optics_rays import brute_share, triangles_of
from tests.optics_skins import skin_of

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

EYE = np.array([0.1, -1.2, 0.3])
CAMERA = gs.Camera.from_lens((36.0, 24.0), 34.0, (240, 160), tuple(EYE), (0.0, 0.1, 0.0))
MATTE = gs.paint.Plain(0.8)
LAMP = gs.AreaLight((-0.5, -1.1, 1.3), (0.0, 0.1, 0.0), (0.25, 0.15), 50.0)
DISC = gs.AreaLight((-0.9, -1.2, 0.2), (0.0, 0.1, 0.0), (0.2, 0.2), 50.0, shape="ellipse")


def wall() -> gs.Surface:
    corners = [[-1.0, 0.4, -0.8], [1.0, 0.4, -0.8], [1.0, 0.4, 0.8], [-1.0, 0.4, 0.8]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), MATTE)


def skin(filled: npt.NDArray[np.bool_], size: tuple[float, float, float]) -> gs.Surface:
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


BODIES = {"shelf": shelf, "beam": beam, "tube": tube, "spring": spring}
ALONG = gs.AreaLight((0.05, -1.5, 0.1), (0.0, 0.1, 0.0), (0.12, 0.08), 50.0)
"""About along the spring."""


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (half_shadow, tile_contours):
        monkeypatch.setattr(module, "FEWEST", 2)
    monkeypatch.setattr(half_shadow, "MANY", 0)
    # wherever they may stand for faces, not only where they are fewer
    monkeypatch.setattr(tile_contours, "WORTH", 0.0)
    monkeypatch.setattr(
        "gpusim.optics.lighting.surfaces_alone", lambda lamps, *_: [[] for _ in lamps]
    )


def shadows(surfaces: list[gs.Surface], light: Light) -> tuple[ShadowTiles, Array]:
    view = look(surfaces, CAMERA, lit=True)
    setup = Setup.build(view, [light], 0.0, surfaces)
    assert setup.lighting.shadows is not None
    return setup.lighting.shadows, shade_twin(setup, visibility_twin(view))


@pytest.mark.parametrize(
    ("body", "light"),
    [*((body, LAMP) for body in BODIES), ("beam", DISC), ("tube", DISC), ("spring", ALONG)],
    ids=lambda value: value if isinstance(value, str) else f"{value.position}",
)
def test_pictures_are_those_of_faces(
    monkeypatch: pytest.MonkeyPatch, body: str, light: gs.AreaLight
) -> None:
    surfaces = [BODIES[body](), wall()]
    tiles, got = shadows(surfaces, light)
    monkeypatch.setattr(half_shadow, "MANY", 1 << 60)
    faces, want = shadows(surfaces, light)
    assert len(tiles.chains.ends) > 0 and len(faces.chains.ends) == 0
    assert len(tiles.face) < (0.7 if light is LAMP else 0.95) * len(faces.face)
    away = np.abs(got - want) / want.max()
    # an edge within float64 of a sample, and what is seen of a face from its other side
    assert away.max() < 2.5 / 512 and (away > 1e-9).mean() < 0.05


@pytest.mark.parametrize("body", list(BODIES))
def test_shares_of_the_lamp_are_those_of_rays(body: str) -> None:
    surfaces = [BODIES[body](), wall()]
    light = ALONG if body == "spring" else LAMP
    view = look(surfaces, CAMERA, lit=True)
    tiles = find_shadows(view, [light], surfaces)
    assert tiles is not None and len(tiles.chains.ends) > 0
    truth = gs.render(surfaces, CAMERA, [light], backend="numpy").truth()
    told = tiles.chains.count[:, 0] > 0
    entry = tiles.entry[truth.row // 8, truth.column // 8].astype(np.int64) - 1
    (lamp,) = lamps_of([light])
    turned = np.sum(truth.normal * (lamp.centre - truth.reference), axis=1) > 0.0
    rows = np.flatnonzero((entry >= 0) & told[entry] & turned)
    rows = rows[:: max(len(rows) // 60, 1)]
    seen, still = truth.reference[rows], np.zeros((len(rows), 3))
    place = truth.column[rows].astype(float), truth.row[rows].astype(float)
    shares = tiles.shares(*place, seen - EYE, truth.normal[rows], still, still)[:, 0]
    want = brute_share(lamp, seen + 1e-6 * truth.normal[rows], triangles_of(surfaces), 8)
    assert (want < 0.5).sum() > 10 and (want > 0.5).sum() > 10
    away = np.abs(shares - want)
    assert (away > 0.08).mean() < 0.05 and np.median(away) < 0.01


def test_layers_over_each_other_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """In one piece with their back, as if there were no crease, eight boards wind round a sample as
    often as none do."""
    surfaces = [shelf(8), wall()]
    light = gs.AreaLight((0.0, 0.05, 2.5), (0.0, 0.05, 0.0), (0.06, 0.06), 50.0)
    ground = np.array([[-1.0, -0.8, -0.3], [1.0, -0.8, -0.3], [1.0, 0.4, -0.3], [-1.0, 0.4, -0.3]])
    surfaces.append(gs.Surface(ground, np.array([[0, 1, 2, 3]]), MATTE))
    _, right = shadows(surfaces, light)
    with monkeypatch.context() as patch:
        patch.setattr(half_shadow, "MANY", 1 << 60)
        _, want = shadows(surfaces, light)
    monkeypatch.setattr(tile_contours, "SMOOTH", -2.0)
    _, guarded = shadows(surfaces, light)
    monkeypatch.setattr(tile_contours, "OVER", np.inf)
    _, wrong = shadows(surfaces, light)
    found = [
        np.count_nonzero(np.abs(v - want) > 0.02 * want.max()) for v in (right, guarded, wrong)
    ]
    # where pixels on the ground reach under the lowest board, faces are off, as rays tell
    assert found[0] < 10
    # most pieces cover more than can lie side by side
    assert found[2] > 50 and found[1] < 10


@pytest.mark.parametrize("body", [pytest.param("shelf", marks=pytest.mark.slow), "tube"])
def test_the_device_agrees(device: Device, monkeypatch: pytest.MonkeyPatch, body: str) -> None:
    """The same picture, but one in which an end of a contour has moved."""
    surfaces = [BODIES[body](), wall()]
    tiles, want = shadows(surfaces, LAMP)

    def away() -> Array:
        frame = gs.render(surfaces, CAMERA, [LAMP], device=device)
        inside = want > 0.0
        picture = gs.render(surfaces, CAMERA, [LAMP], backend="numpy").radiance
        return np.abs(frame.radiance - picture)[inside] / want.max()

    right = away()
    assert np.quantile(right, 0.999) < 3.5 / 512
    original = tile_contours.TileEdges.__getitem__

    def moved(self: tile_contours.TileEdges, index: Numbers) -> tile_contours.TileEdges:
        result = original(self, index)
        return replace(result, ends=result.ends + np.array([0.02, 0.0, 0.02]))

    assert len(tiles.chains.ends) > 0
    frame = gs.render(surfaces, CAMERA, [LAMP], device=device).radiance
    monkeypatch.setattr(tile_contours.TileEdges, "__getitem__", moved)
    wrong = gs.render(surfaces, CAMERA, [LAMP], device=device).radiance
    assert np.abs(wrong - frame).max() > 0.05 * want.max()


def test_sides_meet_end_by_end_where_joined_faces_do_not() -> None:
    """Of faces that were joined, each side but those at the outside is another's, turned round."""
    surface = beam()
    casters = Casters.of([surface], lambda points: np.full(len(points), 2e-3))
    assert len(casters.faces) < 0.2 * len(surface.faces)
    sides = sides_of([casters], np.arange(len(casters.faces)))
    there = {(a, b): f for a, b, f in zip(sides.first, sides.second, sides.face, strict=True)}
    assert len(there) == len(sides.first)
    meets = 0
    for a, b, face, beside in zip(sides.first, sides.second, sides.face, sides.beside, strict=True):
        # of a closed body all are beside others; creases end what goes on
        other = there[(b, a)]
        assert beside in (-1, other) and other != face
        meets += beside >= 0
    assert meets > 50
    for face in range(len(casters.faces)):
        own = slice(sides.begin[face], sides.begin[face + 1])
        assert sorted(sides.first[own]) == sorted(sides.second[own])
    # of some of them alone the others are beside none
    some = sides_of([casters], np.arange(0, len(casters.faces), 2))
    assert set(np.unique(some.face)) == set(range(0, len(casters.faces), 2))
    assert (some.beside % 2 == 0)[some.beside >= 0].all()


def test_what_closes_a_border_winds_as_often() -> None:
    """Edges beside a window, and those in their place: as many cross each row, signs and all."""
    random = np.random.default_rng(5)
    points = random.uniform(-1.0, 1.0, (60, 3)) + np.array([3.0, 0.0, 0.0])
    for count in (3, 17, 60):
        loop = random.permutation(60)[:count]
        first, second = loop, np.roll(loop, -1)
        twice = np.zeros(2 * count, np.int64)
        one, other = np.tile(first, 2), np.tile(second, 2)
        # a part of the loop, twice: what it is part of ends somewhere
        part = np.flatnonzero(np.arange(2 * count) % count < 0.7 * count)
        rows = np.full(len(part), -0.4), np.full(len(part), 0.3)
        closing = Closing.of(twice[part], one[part], other[part], points[:, 1], rows)
        high, low = (np.tile([5.0, y, 0.0], (len(closing.border), 1)) for y in (2.0, -2.0))
        ends = closing.ends(points, high, low)
        for q in random.uniform(-0.4, 0.3, 50):

            def turns(edges: Array, q: float = q) -> int:
                start, stop = edges[:, 0, 1] > q, edges[:, 1, 1] > q
                return int(np.sum(start & ~stop)) - int(np.sum(stop & ~start))

            whole = np.stack([points[one[part]], points[other[part]]], axis=1)
            assert (turns(whole) - turns(ends)) % 8 == 0
