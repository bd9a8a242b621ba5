"""Images of one fine surface in a series, whose vertices the device looks at: the same pictures."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import TwinMismatch
from gpusim.gpu import Device
from gpusim.optics.geometry.view import View, look
from gpusim.optics.probes.paints import sheets_setup
from gpusim.optics.series import late, normals, project, resident
from gpusim.optics.series.late import LateSight
from gpusim.optics.shading.looks import NONE
from gpusim.surface.paint import Checker, Paint, Plain

Array = npt.NDArray[np.float64]

EYE = (0.07, -0.84, 0.05)
CAMERA = gs.Camera.from_lens((36.0, 24.0), 46.0, (361, 242), EYE, (0.0, 0.0, 0.01))
ABOVE = gs.Camera.from_lens((36.0, 24.0), 46.0, (361, 242), (0.07, 0.9, 0.05), (0.0, 0.0, 0.01))
CLOSE = gs.Camera.from_lens((36.0, 24.0), 66.0, (361, 242), EYE, (-0.04, 0.0, 0.03))
LIGHTS = [
    gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows=False),
    gs.PointLight((0.1, 1.7, 0.3), 20.0, shadows=False),
]
BOARD = Checker(0.061, 7, 5, (-0.23, -0.13), 0.1, 0.7, 0.4)


@pytest.fixture(autouse=True)
def needed(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(late, "FEWEST", 1000)
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    device.pool.notes.clear()


def sheet(paint: Paint | dict[str, Paint] = BOARD) -> gs.Surface:
    """A flat sheet of 10,800 triangles, its middle of a second paint if there are two."""
    x, z = np.meshgrid(np.linspace(-0.31, 0.29, 91), np.linspace(-0.2, 0.21, 61))
    flat = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    node = np.arange(len(flat)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    region = None
    if isinstance(paint, dict):
        row, column = np.divmod(np.arange(90 * 60), 90)
        region = ((np.abs(row - 30) < 9) & (np.abs(column - 40) < 17)).astype(np.int32)
    return gs.Surface(flat, faces.reshape(-1, 4), paint, region)


def wave(surface: gs.Surface, phase: float) -> gs.Surface:
    x, _, z = surface.rest.T
    by = 0.01 * np.sin(9.0 * x + 4.0 * z + phase)
    return surface.moved(surface.rest + np.array([0.0, 1.0, 0.0]) * by[:, None])


def found(
    device: Device, monkeypatch: pytest.MonkeyPatch, surface: gs.Surface, camera: gs.Camera
) -> tuple[bool, npt.NDArray[np.float32]]:
    """Whether the device looked at a surface's vertices, to the end, and the picture."""
    of, views = LateSight.of, []

    def noted(*values: object) -> LateSight | None:
        sight = of(*values)  # type: ignore[arg-type]
        views.append(None if sight is None else sight.view)
        return sight

    with monkeypatch.context() as patch:
        patch.setattr(LateSight, "of", staticmethod(noted))
        frame = gs.render([surface], camera, LIGHTS, device=device, background=0.02)
    return views[0] is not None and frame.view is views[0], frame.radiance


def alone(device: Device, surface: gs.Surface, camera: gs.Camera) -> npt.NDArray[np.float32]:
    device.pool.notes.clear()
    return gs.render([surface], camera, LIGHTS, device=device, background=0.02).radiance


@pytest.mark.parametrize("camera", [CAMERA, ABOVE, CLOSE])
@pytest.mark.parametrize("paint", [BOARD, {"edge": Plain(0.6), "middle": BOARD}, Plain(0.3)])
def test_pictures_of_a_series_are_the_same(
    device: Device, monkeypatch: pytest.MonkeyPatch, camera: gs.Camera, paint: Paint
) -> None:
    surface = sheet(paint)
    series = [wave(surface, phase) for phase in (0.0, 0.3, 0.3, 0.7)]
    got = [found(device, monkeypatch, one, camera) for one in series]
    assert [late for late, _ in got] == [False, True, True, True]
    for one, (_, picture) in zip(series, got, strict=True):
        want = alone(device, one, camera)
        assert np.abs(picture - want).max() <= 1e-6 * want.max()
        assert np.ptp(want) > 0.2 * want.max()


@pytest.mark.parametrize("camera", [CAMERA, ABOVE])
def test_what_it_tells_is_what_looking_tells(
    device: Device, monkeypatch: pytest.MonkeyPatch, camera: gs.Camera
) -> None:
    surface = wave(sheet({"edge": Plain(0.6), "middle": BOARD}), 0.4)
    for _ in range(2):
        frame = gs.render([surface], camera, LIGHTS, device=device)
    got, want = frame.view, look([surface], camera, lit=True)
    names = ("vertices", "place", "corner", "paint", "face", "edges", "body", "edge_source")
    for name in names:
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))
    some = np.array([3, 77, 4711, 77])
    for view in (got, want):
        assert isinstance(view, View)
    np.testing.assert_array_equal(got.corners_of(some), want.corners_of(some))
    np.testing.assert_array_equal(got.screen_of(some), want.screen_of(some))
    np.testing.assert_array_equal(got.some(some).vertices, want.some(some).vertices)
    rough = np.array([got.table.some(np.arange(len(got.place))).about, want.place.T])
    assert 0.0 < np.abs(rough[0] - rough[1]).max() < 2e-3
    device.pool.notes.clear()
    exact = gs.render([surface], camera, LIGHTS, device=device).truth()
    np.testing.assert_array_equal(frame.truth().face, exact.face)


def dented(change: Callable[[Array], None]) -> gs.Surface:
    surface = wave(sheet(), 0.2)
    points = surface.points.copy()
    change(points)
    return surface.moved(points)


def spike(points: Array) -> None:
    points[2000, 0] += 0.03


def line(points: Array) -> None:
    points[2001] = points[2000] + 1e-9 * (points[2001] - points[2000])


def crease(points: Array) -> None:
    points[2000, 1] -= 0.006


def behind(points: Array) -> None:
    points[0] = (0.0, -3.0, 0.0)


@pytest.mark.parametrize("change", [spike, line, crease, behind])
def test_what_is_otherwise_is_noticed(
    device: Device, monkeypatch: pytest.MonkeyPatch, change: Callable[[Array], None]
) -> None:
    """Whatever moves a few vertices, of which none is among those that the host looks at."""
    monkeypatch.setattr(late, "SAMPLED", 40)
    odd = dented(change)
    even = odd.moved(wave(sheet(), 0.2).points)
    for _ in range(2):
        told, _ = found(device, monkeypatch, even, CAMERA)
    assert told
    told, picture = found(device, monkeypatch, odd, CAMERA)
    assert not told
    np.testing.assert_array_equal(picture, alone(device, odd, CAMERA))


def test_only_one_surface_in_a_series(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = wave(sheet(), 0.1), wave(sheet(), 0.1)
    bent = gs.Camera.from_lens(
        (36.0, 24.0), 46.0, (361, 242), EYE, (0.0, 0.0, 0.01), distortion=(-0.1, 0.03, 0.0, 0.0)
    )
    # in turns each is new, and nothing is kept for it
    assert not any(found(device, monkeypatch, s, CAMERA)[0] for s in (one, other, one, other))
    assert found(device, monkeypatch, other, CAMERA)[0]
    assert not found(device, monkeypatch, other, bent)[0]
    monkeypatch.setattr(late, "FEWEST", 20_000)
    assert not found(device, monkeypatch, other, CAMERA)[0]


def test_other_paint_on_the_same_faces(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    surface = wave(sheet(), 0.1)
    for _ in range(2):
        found(device, monkeypatch, surface, CAMERA)
    again = gs.Surface(
        surface.points, surface.faces, Checker(0.05, ground=0.2), reference=surface.rest
    )
    again.__dict__["topology"] = surface.topology
    told, picture = found(device, monkeypatch, again, CAMERA)
    assert told
    want = alone(device, again, CAMERA)
    assert np.abs(picture - want).max() <= 1e-6 * want.max()


def test_vertices_moved_in_place(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a surface whose shape at rest is the one that is seen."""
    surface = sheet()
    for _ in range(2):
        found(device, monkeypatch, surface, CAMERA)
    surface.points[:, 0] += 0.007
    told, picture = found(device, monkeypatch, surface, CAMERA)
    assert told
    assert np.abs(picture - alone(device, surface, CAMERA)).max() <= 1e-6 * picture.max()


@pytest.mark.parametrize("what", ["reference", "regions"])
def test_what_a_caller_edits_in_place_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    surface = wave(
        sheet({"board": BOARD, "plain": Plain(0.6)} if what == "regions" else BOARD), 0.1
    )
    for _ in range(2):
        _, before = found(device, monkeypatch, surface, CAMERA)
    wanted = gs.render([surface], CAMERA, LIGHTS, device=device).truth().reference
    frame = gs.render([surface], CAMERA, LIGHTS, device=device)
    if what == "regions":
        surface.regions[:] = np.roll(surface.regions, 7)
    else:
        surface.rest[:, 0] += 0.0133
    _, picture = found(device, monkeypatch, surface, CAMERA)
    assert np.abs(picture - alone(device, surface, CAMERA)).max() <= 1e-6 * picture.max()
    assert np.abs(picture - before).max() > 0.1 * picture.max()
    # a frame tells of what it was made of
    np.testing.assert_array_equal(frame.truth().reference, wanted)


def test_far_from_the_origin_digits_are_kept(device: Device) -> None:
    camera = sheets_setup(layer=True).view.camera
    points = np.random.default_rng(3).normal(size=(130, 3)) * 0.3 + [0.0, 0.0, 4.0]
    steps, _, good = project.project_twin(camera, points, 4.0)
    offset = np.array([2.0**25, -(2.0**24), 2.0**23])
    c, d = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, d, 0.0], [-d * c, c * c, d], [d * d, -c * d, c]])
    T = camera.camera_from_world.copy()
    T[:3, :3] = T[:3, :3] @ turn
    T[:3, 3] -= T[:3, :3] @ offset
    away = dataclasses.replace(camera, camera_from_world=T)
    vertices = device.texels(3 * len(points), "rgba32uint", "far.vertices")
    far = points @ turn + offset
    made = project.Projection.of(away, vertices, 4.0, far[0])
    counts = device.buffer(NONE, "far.counts")
    with device.recording("far") as recording:
        made.record(recording, device.real_buffer(far.reshape(-1), "far.points"), counts)
    words = vertices.read().reshape(len(points), 12)
    rest = np.stack([words[:, 3] & np.uint32(65535), words[:, 3] >> np.uint32(16)], axis=1)
    places = words[:, :2].view(np.int32) + rest / 65536.0
    beside = np.abs(places - steps / 65536.0)[good] / 65536.0
    # a place has digits to 4e-9 there, of which a pixel sees some 1e-6
    assert good.sum() > 100 and beside.max() <= 4e-9 * 2.0 * camera.K[0, 0]


def test_memory_goes_back(device: Device) -> None:
    surface = wave(sheet(), 0.1)
    for _ in range(2):
        gs.render([surface], CAMERA, LIGHTS, device=device).release()
    assert isinstance(device.pool.notes[resident.LABEL], resident.Resident)
    device.pool.free()
    assert not device.pool.notes


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_one_corrupted_place_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch, axis: int
) -> None:
    points = np.random.default_rng(3).normal(size=(130, 3)) * 0.3 + [0.0, 0.0, 4.0]
    camera = sheets_setup(layer=True).view.camera
    project.check_projection(device, camera, points)
    real_buffer = device.real_buffer

    def corrupted(array: Array, label: str) -> object:
        moved = array.copy()
        moved[3 * 71 + axis] += 1e-9
        return real_buffer(moved, label)

    monkeypatch.setattr(device, "real_buffer", corrupted)
    with pytest.raises(TwinMismatch, match="optics/series/project, places"):
        project.check_projection(device, camera, points)


def test_one_corrupted_neighbour_is_seen(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    normals.check_normals(device)
    of = normals.Around.of

    def corrupted(triangles: npt.NDArray[np.int64], vertices: int) -> normals.Around:
        around = of(triangles, vertices)
        around.triangle[501] += 1
        return around

    monkeypatch.setattr(normals.Around, "of", staticmethod(corrupted))
    with pytest.raises(TwinMismatch, match="optics/series/normals"):
        normals.check_normals(device)
