"""Symbols are where their camera puts them, and hidden by what lies before them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.visualization.mesh_edges import crease_edges
from gpusim.visualization.overlay import Overlay
from gpusim.visualization.placement import Placement
from gpusim.visualization.symbols import Symbols, clusters, frustum
from tests.support.view_bodies import camera_before, small_crane

DISTORTION = [-0.2, 0.05, 1e-3, -2e-3]


def ends_of(quads: npt.NDArray[np.void]) -> npt.NDArray[np.float64]:
    """(n, 2, 2): where lines begin and end."""
    corner = quads["corner"].astype(np.float64)
    return np.stack([corner[:, [0, 3]].mean(axis=1), corner[:, [1, 2]].mean(axis=1)], axis=1)


def symbols(device: Device, distortion: list[float] | None = None) -> Symbols:
    return Symbols(Overlay(device), camera_before(distortion), Placement(11.0, -4.0, 1.7))


@pytest.mark.parametrize("distortion", [None, DISTORTION])
def test_lines_go_where_their_points_are_seen(
    device: Device, distortion: list[float] | None
) -> None:
    pen = symbols(device, distortion)
    ends = np.array([[0.0, 0.1, 0.0], [0.5, -0.1, 0.6]])
    pen.lines(ends, "black")
    found = ends_of(pen.overlay.quads())
    share = np.linspace(0.0, 1.0, 2000)[:, None]
    line = pen.camera.project((1 - share) * ends[0] + share * ends[1])
    window = np.array([11.0, -4.0]) + 1.7 * (line + 0.5)
    assert found[0, 0] == pytest.approx(window[0], abs=1e-3)
    assert found[-1, 1] == pytest.approx(window[-1], abs=1e-3)
    assert len(found) == 1 if distortion is None else len(found) > 20
    off = [np.hypot(*(window - place).T).min() for place in found.mean(axis=1)]
    assert max(off) < 0.2


def test_what_is_behind_the_camera_is_cut_off(device: Device) -> None:
    pen = symbols(device)
    eye, forward = pen.camera.eye, pen.camera.camera_from_world[2, :3]
    side = pen.camera.camera_from_world[0, :3]
    before = eye + 1.2 * forward + 0.1 * side
    pen.lines([[before, eye - 2.0 * forward + 0.1 * side]], "black")
    (found,) = ends_of(pen.overlay.quads())
    assert np.isfinite(found).all()
    assert found[0] == pytest.approx(pen.window(before), abs=1e-3)
    assert found[1, 0] > found[0, 0] + 100.0  # towards the side that it passes on
    pen.lines([[eye - forward, eye - 2.0 * forward]], "black")
    pen.pyramids(eye - forward, forward)
    pen.arrows(eye - forward, forward * 0.1)
    assert len(pen.overlay.quads()) == 1


def test_what_a_body_hides_is_left_out(device: Device) -> None:
    crane, overlay = small_crane(), Overlay(device)
    frame = gs.render([crane.surface, crane.wall], camera_before(), backend="numpy")
    pen = Symbols(overlay, camera_before(), None, frame)
    behind = np.array([[0.1, 0.3, 0.2], [0.4, 0.3, 0.2]])
    pen.lines(behind, "black")
    assert len(overlay.quads()) == 0
    pen.lines(behind, "black", pale=0.5)
    assert set(overlay.quads()["color"][:, 3]) == {np.float32(0.5)}
    overlay.clear()
    pen.lines(behind - [0.0, 0.4, 0.0], "black")
    assert overlay.quads()["color"][:, 3].min() == 1.0
    # past the column, behind it
    overlay.clear()
    pen.place = Placement(scale=12.0)
    past = [[-0.1, 0.1, 0.3], [0.2, 0.1, 0.3]]
    pen.lines([past], "black")
    quads = overlay.quads()
    length = np.hypot(*(ends_of(quads)[:, 1] - ends_of(quads)[:, 0]).T).sum()
    whole = np.hypot(*np.diff(pen.window(past), axis=0)[0])
    assert 0.5 * whole < length < 0.97 * whole


@pytest.mark.parametrize("divisions", [(4, 2, 1), (40, 20, 10), (80, 40, 20)])
def test_a_box_shows_nine_of_its_edges(device: Device, divisions: tuple[int, int, int]) -> None:
    """However many elements they go along: the three that meet in the far corner are hidden."""
    mesh = gs.mesh.box(size=(0.4, 0.2, 0.1), divisions=divisions)
    faces = gs.mesh.boundary_faces(mesh)
    skin = gs.Skin(mesh, faces)
    surface = skin.surface({"": gs.paint.Plain()}, np.zeros(len(faces), np.int32), {}, "box")
    camera = gs.Camera.from_lens((36, 24), 50, (450, 300), (0.7, -0.5, 0.5), (0.2, 0.1, 0.05))
    pen = Symbols(Overlay(device), camera, None, gs.render([surface], camera, device=device))
    pen.lines(crease_edges(surface), "black")
    drawn = ends_of(pen.overlay.quads())
    corner = np.array([[x, y, z] for x in (0.0, 0.4) for y in (0.0, 0.2) for z in (0.0, 0.1)])
    far = int(np.argmax(camera.to_camera(corner)[:, 2]))
    pairs = [(i, j) for i in range(8) for j in range(i) if np.sum(corner[i] != corner[j]) == 1]
    for pair in pairs:
        first, last = pen.window(corner[list(pair)])
        along = last - first
        share = (drawn - first) @ along / (along @ along)
        off = np.abs((drawn - first) @ (along[1], -along[0])) / np.hypot(*along)
        on = (off.max(axis=1) < 0.01) & (share.min(axis=1) > -0.01) & (share.max(axis=1) < 1.01)
        length = np.abs(np.diff(share[on], axis=1)).sum()
        assert length == pytest.approx(0.0 if far in pair else 1.0, abs=0.06), pair


def test_clusters_keep_the_sum() -> None:
    rng = np.random.default_rng(1)
    points, vectors = rng.uniform(size=(900, 3)) * [4, 1, 1], rng.normal(size=(900, 3))
    vectors[::3] = 0.0
    at, total, count = clusters(points, vectors, 30)
    assert 8 <= len(at) <= 30 and count.sum() == 600
    assert total.sum(axis=0) == pytest.approx(vectors.sum(axis=0), abs=1e-9)
    weight = np.linalg.norm(vectors, axis=1)
    one, _, _ = clusters(points, vectors, 1)
    assert one[0] == pytest.approx((weight[:, None] * points).sum(axis=0) / weight.sum())
    wide, _, _ = clusters(points, vectors, 500, side=1.9)
    assert len(wide) == 2
    assert clusters(points, 0.0 * vectors, 30)[0].shape == (0, 3)


@pytest.mark.parametrize("held", [[False, False, True], [True, True, True]])
def test_supports_point_at_held_nodes(device: Device, held: list[bool]) -> None:
    crane, pen = small_crane(), symbols(device)
    points = crane.surface.rest
    fixed = np.repeat(points[:, 2:] < 1e-9, 3, axis=1)
    pen.supports(points, fixed & False)
    assert len(pen.overlay.quads()) == 0
    pen.supports(points, fixed & held, most=12)
    corner = pen.overlay.quads()["corner"].astype(np.float64)
    # sides of pyramids are triangles, whose first corner is the tip
    tips = np.unique(corner[(corner[:, 2] == corner[:, 3]).all(axis=1), 0], axis=0)
    assert 1 <= len(tips) <= 12
    places = pen.window(points[fixed.any(axis=1)])
    gap = np.hypot(*(tips[:, None] - places[None]).transpose(2, 0, 1)).min(axis=1)
    assert gap.max() < 1e-3
    # and their bases lie below, away from the crane, about 13 px
    below = corner[..., 1].max() - tips[:, 1].max()
    assert 8.0 < below < 20.0
    count = len(pen.overlay.quads())
    pen.overlay.clear()
    pen.supports(points, fixed & [True, False, True], most=12)
    assert len(pen.overlay.quads()) > 1.4 * count


def test_loads_end_where_they_act_and_say_their_sum(device: Device) -> None:
    crane, pen = small_crane(), symbols(device)
    points, forces = crane.model.mesh.points, np.zeros((crane.model.mesh.node_count, 3))
    forces[[5, 400]] = [[0.0, 0.0, -3.0], [0.0, 0.0, -6.0]]
    texts = []
    pen.overlay.text = lambda x, y, text, *a, **k: texts.append((x, y, text))  # type: ignore[method-assign]
    pen.loads(points, forces)
    red = pen.overlay.quads()
    red = red[red["color"][:, 0] > 0.8]
    heads = red["corner"][(red["corner"][:, 2] == red["corner"][:, 3]).all(axis=1), 0]
    heads = heads[np.argsort(heads[:, 0])][-4:]
    places = pen.window(points[[5, 400]])
    gap = np.hypot(*(heads[:, None] - places[None]).transpose(2, 0, 1)).min(axis=0)
    assert gap.max() < 1e-3
    ((_, y, text),) = texts
    assert text == "9 N" and y < places[:, 1].min() - 20.0
    pen.overlay.clear()
    pen.loads(points, 0.0 * forces)
    assert len(pen.overlay.quads()) == 0


Box = npt.NDArray[np.float64]


def boxes_of(pen: Symbols, monkeypatch: pytest.MonkeyPatch) -> list[Box]:
    """Gets the rectangle behind each text: its upper left and its lower right corner."""
    found: list[Box] = []

    def rectangle(left: float, top: float, wide: float, tall: float, color: object) -> None:
        found.append(np.array([[left, top], [left + wide, top + tall]]))

    monkeypatch.setattr(pen.overlay, "rectangle", rectangle)
    return found


def meet(one: Box, other: Box) -> bool:
    return bool((np.minimum(one[1], other[1]) > np.maximum(one[0], other[0])).all())


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_texts_of_rings_hide_as_little_as_they_can(
    device: Device, monkeypatch: pytest.MonkeyPatch, scale: float
) -> None:
    """Of a square plate in the middle of a picture that lies anywhere in a window."""
    plate = gs.mesh.box(size=(0.4, 0.01, 0.4), divisions=(1, 1, 1), origin=(-0.2, 0.0, -0.2))
    skin = gs.Skin(plate, gs.mesh.boundary_faces(plate))
    camera = gs.Camera.from_lens((36, 24), 50, (600, 400), (0, -2, 0), (0, 0, 0))
    surface = skin.surface({"": gs.paint.Plain()}, np.zeros(6, np.int32), {}, "plate")
    half = camera.reframed(300, 200, scale=(0.5, 0.5))  # pictures of another size show the same
    frame = gs.render([surface], half, device=device)
    pen = Symbols(Overlay(device), camera, Placement(30.0, 20.0, scale), frame)
    boxes = boxes_of(pen, monkeypatch)
    free = np.array([[0.0, 0.0], [600.0, 400.0]]) * scale + [30.0, 20.0]
    front = np.array([[-0.2, 0.0, -0.2], [0.2, 0.0, 0.2]])
    body = np.sort(pen.window(front), axis=0)
    for x, z in ((-0.2, 0.2), (0.2, 0.2), (0.2, -0.2), (-0.2, -0.2)):
        boxes.clear()
        pen.rings([("corner", np.array([x, 0.0, z]))], 20, free)
        assert not meet(boxes[0], body) and (boxes[0][0] > 0).all()
        assert np.abs(boxes[0] - pen.window([x, 0.0, z])).min(axis=0).max() <= 17.0  # beside it
    # to the middle of the picture, where there is no body
    pen.camera = camera.reframed(600, 400, (125.0, 0.0))
    pen.frame = gs.render([surface], half.reframed(300, 200, (62.5, 0.0)), device=device)
    body = np.sort(pen.window(front), axis=0)
    boxes.clear()
    pen.rings([("edge", np.array([0.2, 0.0, 0.0]))], 20, free)
    assert not meet(boxes[0], body) and boxes[0][0, 0] > body[1, 0]
    # beside a narrow picture there is no room: then on the plate, and not out of what is free
    boxes.clear()
    free[1, 0] = body[1, 0] + 20.0
    pen.rings([("a long text", np.array([0.2, 0.0, 0.1]))], 20, free)
    assert meet(boxes[0], body) and boxes[0][1, 0] <= free[1, 0]


def test_texts_of_rings_do_not_lie_on_one_another(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    pen = symbols(device)
    boxes = boxes_of(pen, monkeypatch)
    near = [np.array([0.3 + 0.005 * k, 0.0, 0.4]) for k in range(3)]
    behind = pen.camera.eye - pen.camera.camera_from_world[2, :3]
    marks = [(f"mark {k}", place) for k, place in enumerate([near[0], behind, *near[1:]])]
    pen.rings(marks, 14, np.array([[-2e3, -2e3], [4e3, 4e3]]))
    assert len(boxes) == 3  # what is behind the camera has none
    assert not any(meet(boxes[a], boxes[b]) for a, b in ((0, 1), (0, 2), (1, 2)))
    pen.rings([], 14, np.zeros((2, 2)))


def test_rings_say_what_a_body_hides(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    crane, overlay = small_crane(), Overlay(device)
    frame = gs.render([crane.surface, crane.wall], camera_before(), backend="numpy")
    pen, texts = Symbols(overlay, camera_before(), None, frame), []
    monkeypatch.setattr(overlay, "text", lambda x, y, text, *rest: texts.append(text))
    places = np.array([[0.1, -0.3, 0.2], [0.1, 0.3, 0.2]])
    pen.rings([("before", places[0]), ("behind", places[1])], 14, np.array([[0, 0], [99, 99.0]]))
    assert texts == ["before", "behind, hidden"]


def test_the_tripod_shows_the_worlds_axes(device: Device) -> None:
    overlay = Overlay(device)
    camera = gs.Camera.from_lens((36, 24), 30, (60, 40), (0, -2, 0), (0, 0, 0))
    Symbols(overlay, camera).tripod(100.0, 80.0, 40.0)
    quads = overlay.quads()
    quads = quads[(quads["sprite"][:, 1] == 0) & (quads["color"][:, 3] == 1.0)]
    tips = quads["corner"][(quads["corner"][:, 2] == quads["corner"][:, 3]).all(axis=1), 0]
    rows = {tuple(np.rint(tip).astype(int)) for tip in tips}
    assert {(140, 80), (100, 40)} <= rows  # x to the right, z upwards


def test_a_camera_is_drawn_by_the_rays_of_its_corners(device: Device) -> None:
    scene_camera = camera_before(DISTORTION)
    border = frustum(scene_camera, 0.3)
    back = scene_camera.project(border)
    w, h = scene_camera.width, scene_camera.height
    on = (np.abs(back[:, 0] + 0.5) < 1e-6) | (np.abs(back[:, 0] - w + 0.5) < 1e-6)
    on |= (np.abs(back[:, 1] + 0.5) < 1e-6) | (np.abs(back[:, 1] - h + 0.5) < 1e-6)
    assert on.all() and back[0] == pytest.approx([-0.5, -0.5], abs=1e-6)
    assert back[[8, 16, 24]] == pytest.approx(
        np.array([[w, 0], [w, h], [0, h]]) - 0.5, abs=1e-6
    )  # fmt: skip
    assert scene_camera.to_camera(border)[:, 2] == pytest.approx(0.3)
    other = gs.Camera.from_lens((36, 24), 30, (600, 400), (2.5, -2.0, 1.5), (-0.3, -0.8, 0.7))
    overlay = Overlay(device)
    Symbols(overlay, other).cameras([scene_camera], 0.3)
    quads = overlay.quads()
    lines = ends_of(quads[quads["sprite"][:, 1] == 0])
    eye = other.project(scene_camera.eye) + 0.5
    assert (np.hypot(*(lines[:, 0] - eye).T) < 1e-3).sum() == 4
    assert (quads["sprite"][:, 1] > 0).sum() >= 5 * len("camera")
