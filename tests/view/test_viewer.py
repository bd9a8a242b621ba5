"""What the preview shows, without a window: content, pictures, keys, the mouse, reload, faults."""

from __future__ import annotations

import copy
import random
from pathlib import Path

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.scene.toml_text import toml_text
from gpusim.surface.color import color
from gpusim.view.content.loading import load_content
from gpusim.view.keys import KEYS
from gpusim.view.picture.moving_picture import moving_picture
from gpusim.view.picture.progressive_picture import coarser, rows_of
from gpusim.view.screenshot import screenshot, wait_for_solution
from gpusim.view.viewer import Viewer
from tests.support.small_scene import DOCUMENT
from tests.support.viewing import LIGHT, SIZE, wait_for


def encoded(radiance: np.ndarray, white: float) -> np.ndarray:
    """8-bit sRGB by its definition (IEC 61966-2-1)."""
    value = np.clip(radiance / white, 0.0, 1.0)
    curve = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * curve)


def test_a_screenshot_is_what_render_shows(viewer: Viewer) -> None:
    """Where nothing is written over it, to a grey level; rows in steps are the picture at once."""
    picture = screenshot(viewer)
    shot = viewer.picture.shot
    assert shot is not None and viewer.picture.complete
    frame = gs.render(shot.surfaces, shot.camera, shot.lights, background=shot.background,
                      device=viewer.device)  # fmt: skip
    wanted = encoded(frame.radiance.astype(np.float64), viewer.white)
    free = np.s_[60:150, :240]
    difference = np.abs(picture[free].astype(float) - wanted[free][..., None])
    assert wanted[free].std() > 20.0
    assert (difference <= 1.0).mean() > 0.999 and difference.max() <= 3.0


def test_a_background_may_be_said_in_hexadecimal_digits(device: Device, tmp_path: Path) -> None:
    path = tmp_path / "bar.toml"
    document = {**DOCUMENT, "light": LIGHT, "render": {"background": "#204060"}}
    path.write_text(toml_text(document), encoding="utf-8")
    viewer = Viewer(device, path, SIZE, solve=False)
    viewer.look_through(0)
    screenshot(viewer)
    shot = viewer.picture.shot
    assert viewer.fault == "" and shot is not None and shot.background == color("#204060")
    viewer.close()


def test_looking_through_a_camera_of_the_scene(viewer: Viewer) -> None:
    viewer.key("7")
    viewer.wheel(3.0, 100, 120)
    free = viewer.view
    viewer.key("0")
    assert viewer.through == 0 and viewer.content is not None
    camera, left, top = viewer.camera()
    assert (camera.width, camera.height, left) == (331, 88, 0) and top == 59
    whole = viewer.content.cameras[0]
    points = viewer.content.outline(0, 1.0)
    share = np.array([331 / 450, 88 / 120])
    np.testing.assert_allclose(
        camera.project(points) + 0.5, share * (whole.project(points) + 0.5), atol=1e-9
    )
    np.testing.assert_allclose(viewer.view.eye, whole.eye, atol=1e-12)
    viewer.key("0")
    assert viewer.through is None and viewer.view == free
    # the mouse goes on from the camera
    viewer.key("0")
    viewer.press(100, 100, 1, ("Shift",))
    viewer.move(120, 100)
    viewer.release(120, 100)
    assert viewer.through is None
    np.testing.assert_allclose(viewer.view.eye[1:], whole.eye[1:], atol=1e-12)


def test_coarser_cameras_and_rows_see_the_same(viewer: Viewer) -> None:
    camera = viewer.view.camera(*SIZE)
    point = np.add(viewer.view.pivot, (0.01, 0.02, 0.005))
    at = camera.project(point)
    np.testing.assert_allclose(coarser(camera, 3).project(point), (at + 0.5) / 3 - 0.5, atol=1e-10)
    np.testing.assert_allclose(rows_of(camera, 40, 20).project(point), at - [0, 40], atol=1e-10)
    assert (coarser(camera, 3).width, coarser(camera, 3).height) == (111, 69)


def test_a_moving_picture_has_the_colours_of_the_scene(device: Device) -> None:
    corners = [[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]]
    wall = gs.Surface(corners, [[0, 1, 2, 3]], paint=gs.paint.Plain("#c04020"))
    camera = gs.Camera.from_lens((36, 24), 50, (60, 40), (0, -4, 0), (0, 0, 0))
    lamp = [gs.PointLight((1, -3, 1), 20.0, shadows=False, color=(1.0, 0.8, 0.5))]
    moving = moving_picture(device, [wall], camera, lamp, (0.0, 0.1, 0.2))
    still = gs.render([wall], camera, lamp, background=(0.0, 0.1, 0.2), device=device)
    assert moving.radiance.shape == (40, 60, 3)
    np.testing.assert_allclose(
        moving.radiance[15:25, 25:35], still.radiance[15:25, 25:35], rtol=1e-5
    )
    np.testing.assert_allclose(moving.radiance[0, 0], (0.0, 0.1, 0.2), rtol=1e-6)


@pytest.mark.parametrize("sensitivities", [None, [0.2, 0.7, 0.1]])
def test_what_a_mono_camera_sees_is_grey(
    device: Device, tmp_path: Path, sensitivities: list[float] | None
) -> None:
    """As its picture will be, through it and beside it; in colour as soon as a camera is."""
    document = copy.deepcopy({**DOCUMENT, "light": LIGHT})
    for paint in document["body"][0]["paint"]:
        paint["albedo"] = "#c02080"
    document["sensor"] = {} if sensitivities is None else {"sensitivities": sensitivities}
    path = tmp_path / "bar.toml"
    path.write_text(toml_text(document), encoding="utf-8")
    viewer = Viewer(device, path, SIZE, solve=False)
    assert viewer.fault == ""
    for through in (None, 0):
        viewer.look_through(through)
        picture = screenshot(viewer)[90:140, :150].astype(int)
        assert picture.std() > 10.0 and not np.ptp(picture, axis=2).any(), through
    shot = viewer.picture.shot
    assert shot is not None
    frame = gs.render(shot.surfaces, shot.camera, shot.lights, background=shot.background,
                      device=device)  # fmt: skip
    _, left, top = viewer.camera()
    grey = frame.radiance.astype(np.float64) @ (sensitivities or [1 / 3, 1 / 3, 1 / 3])
    rows = np.s_[top + 31 : top + 60]
    wanted = encoded(grey, viewer.white)[31:60, :150]
    assert np.ptp(wanted) > 60.0
    assert (np.abs(screenshot(viewer)[rows, left : left + 150, 0] - wanted) <= 1.0).mean() > 0.97
    document["sensor"] = {}
    document["camera"].append({**document["camera"][0], "name": "colour", "channels": "rgb"})
    path.write_text(toml_text(document), encoding="utf-8")
    viewer.load()
    assert viewer.fault == ""
    for through, colours in ((None, True), (0, False), (1, True)):
        viewer.look_through(through)
        picture = screenshot(viewer)[90:140, :150].astype(int)
        assert (np.ptp(picture, axis=2).max() > 40) == colours, through
    viewer.close()


def test_the_white_of_a_window_that_grew(device: Device, viewer: Viewer) -> None:
    """A browser's begins with one pixel, before it says how large it is."""
    wanted = screenshot(viewer)
    other = Viewer(device, viewer.path, SIZE, solve=False)
    for size in ((1, 1), (90, 400)):
        other.draw(device.texture(*size, "rgba8unorm", "view.target"))
        other.picture.took(0.001)  # a quick machine: finer pictures while it moves
    np.testing.assert_array_equal(screenshot(other, SIZE), wanted)
    other.wheel(-20.0, 60, 95)  # once the user has moved it stays as it is
    white = other.white
    screenshot(other, (90, 400))
    assert other.white == white
    other.close()


def test_keys_change_what_is_seen(viewer: Viewer) -> None:
    first = screenshot(viewer)
    viewer.key("7")
    for key in ("Home", "p", "l", "m", "u", "o", "v", "]", "h"):
        if key == "v":
            viewer.wheel(30.0, 165, 103)  # the scene's camera stands off
        before = screenshot(viewer)
        viewer.key(key)
        after = screenshot(viewer)
        assert (before != after).mean() > 5e-4, key
        assert viewer.fault == "", key
    for key in ("p", "l", "m", "u", "o", "v", "h"):
        viewer.key(key)
    viewer.key("r")
    np.testing.assert_array_equal(screenshot(viewer), first)


def test_mouse(viewer: Viewer) -> None:
    screenshot(viewer)
    eye, pivot = viewer.view.eye, viewer.view.pivot
    viewer.press(100, 100, 1)
    viewer.move(140, 110)
    viewer.release(140, 110)
    assert viewer.selected is None and viewer.view.pivot == pivot
    assert np.linalg.norm(viewer.view.eye - eye) > 0.01
    viewer.press(100, 100, 1, ("Shift",))
    viewer.move(120, 90)
    viewer.release(120, 90)
    assert viewer.view.pivot != pivot
    viewer.wheel(-4.0, 165, 103)
    viewer.key("Home")
    screenshot(viewer)
    x, y = viewer.place.window(viewer.camera()[0].project(np.array([0.12, 0.0, 0.005])))
    viewer.press(x, y, 1)
    viewer.release(x, y)
    found = viewer.selected
    assert found is not None and found.name == "bar" and found.paint == "side"
    np.testing.assert_allclose(found.reference, [0.12, 0.0, 0.005], atol=1e-6)
    cell = viewer.content.objects.bodies[0].mesh.cells["hex8"][found.element]  # type: ignore
    low, high = (
        viewer.content.objects.bodies[0].mesh.points[cell].min(0),  # type: ignore
        viewer.content.objects.bodies[0].mesh.points[cell].max(0),
    )  # type: ignore
    assert (found.reference >= low - 1e-9).all() and (found.reference <= high + 1e-9).all()
    viewer.key(".")
    assert viewer.view.distance < 0.2


def test_solving_in_the_background_then_frames_and_fields(device: Device, scene_path: Path) -> None:
    viewer = Viewer(device, scene_path, SIZE)
    assert viewer.content is not None and viewer.content.frames == 1
    screenshot(viewer)  # shown unloaded at once, with progress
    wait_for_solution(viewer)
    assert (viewer.content.frames, viewer.frame) == (2, 1)
    solved = gs.solve(gs.load_scene(scene_path)).u
    np.testing.assert_allclose(viewer.content.displacement(0, 1), solved, rtol=1e-4, atol=1e-9)
    viewer.key("f")
    assert viewer.field == "displacement"
    most = 1e3 * np.linalg.norm(solved, axis=1).max()
    assert viewer.field_values.values[0].max() == pytest.approx(most, rel=1e-4)
    viewer.show_field("von_mises")
    assert (np.ptp(screenshot(viewer).astype(int), axis=2) > 60).mean() > 0.02  # in colour
    viewer.key("+")
    points = viewer.surfaces()[0].points
    skin = viewer.content.skins[0]
    np.testing.assert_allclose(points, skin.at_vertices(skin.mesh.points + 2 * viewer.content
                                                        .displacement(0, 1)), atol=1e-12)  # fmt: skip  # noqa: E501
    viewer.press(3 * 14, SIZE[1] - 18, 1)  # the slider's left end
    viewer.release(3 * 14, SIZE[1] - 18)
    assert viewer.frame == 0
    viewer.key("ArrowRight")
    assert viewer.frame == 1
    # other loads: the field is gone until they are solved
    before = viewer.field_values.values[0].max()
    text = scene_path.read_text(encoding="utf-8")
    scene_path.write_text(text.replace("-50.0]", "-100.0]"), encoding="utf-8")
    wait_for(viewer, "a load")
    assert viewer.solver is not None and not viewer.field_values
    wait_for_solution(viewer)
    assert viewer.field_values.values[0].max() == pytest.approx(2.0 * before, rel=1e-3)
    viewer.close()


def test_a_part(device: Device, tmp_path: Path) -> None:
    """Its size, its edges, its elements and sets; keys that have nothing to show say so."""
    cube = gs.mesh.box(size=(30, 20, 10), divisions=(3, 2, 1))
    gs.export.write_vtu(tmp_path / "part.vtu", cube.points, cube.cells)
    viewer = Viewer(device, tmp_path / "part.vtu", SIZE)
    content = viewer.content
    assert content is not None and len(content.creases[0]) == 2 * (3 * 2 + 2 * 2 + 1 * 2)
    np.testing.assert_allclose(np.ptp(content.outline(0, 1.0), axis=0), [0.03, 0.02, 0.01])
    plain = screenshot(viewer)
    viewer.key("m")
    assert viewer.message == "mesh: on" and (screenshot(viewer) != plain).mean() > 1e-3
    viewer.select(*viewer.place.window(viewer.camera()[0].project(np.array([0.025, 0.0, 0.005]))))
    assert viewer.selected is not None and viewer.selected.element == 2
    viewer.key(".")
    screenshot(viewer)
    for key in "uov0f+":
        viewer.message = ""
        viewer.key(key)
        assert viewer.message, key
    viewer.key("ArrowLeft")
    assert "one frame" in viewer.message
    with pytest.raises(gs.InputError, match="expected a scene or a run"):
        viewer.show_field("von_mises")
    viewer.close()
    assert "it says its own" in Viewer(device, tmp_path / "out.toml", SIZE, unit="in").fault


def test_a_screenshot_lies_beside_the_scene(
    viewer: Viewer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    viewer.save = lambda path: path.write_bytes(b"")
    viewer.key("s")
    viewer.key("s")
    assert {path.name for path in tmp_path.glob("*.png")} == {"bar-001.png", "bar-002.png"}


def test_a_mesh_and_a_run(device: Device, tmp_path: Path, scene_path: Path) -> None:
    cube = gs.mesh.box(size=(2, 1, 0.5), divisions=(2, 1, 1))
    gs.export.write_vtu(tmp_path / "part.vtu", cube.points, cube.cells)
    gs.export.write_stl(tmp_path / "part.stl", cube.points, gs.mesh.boundary_faces(cube).nodes)
    pictures = []
    for name in ("part.vtu", "part.stl"):
        viewer = Viewer(device, tmp_path / name, SIZE, unit="mm" if name == "part.stl" else "m")
        assert viewer.fault == "" and viewer.solver is None
        pictures.append(screenshot(viewer)[60:])
        viewer.close()
    assert len(np.unique(pictures[0])) > 20
    assert (np.abs(pictures[0].astype(int) - pictures[1]) <= 1).mean() > 0.999
    gs.run(gs.load_scene(scene_path), tmp_path / "out")
    content = load_content(tmp_path / "out")
    assert content.frames == 2 and content.stresses is not None
    assert content.displacement(0, 1)[:, 2].min() < -1e-4


@pytest.mark.parametrize("name", ["none.toml", "a.docx", "."])
def test_what_is_no_content_is_a_fault(device: Device, name: str, tmp_path: Path) -> None:
    viewer = Viewer(device, tmp_path / name, SIZE)
    assert viewer.content is None and str(tmp_path) in viewer.fault
    assert screenshot(viewer).std() > 1.0  # it is said in the window
    viewer.close()


def test_whatever_a_user_does(
    device: Device, scene_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is raised and numbers stay finite, whatever comes: keys, buttons, sizes, files."""
    monkeypatch.chdir(tmp_path)
    chance = random.Random(2)
    text = scene_path.read_bytes()
    viewer = Viewer(device, scene_path, SIZE, solve=False)
    sizes = [(1, 1), (2, 90), (90, 1), (131, 87), (320, 200)]
    target = device.texture(*SIZE, "rgba8unorm", "view.target")

    def place() -> tuple[float, float]:
        return chance.uniform(-50.0, 400.0), chance.uniform(-50.0, 300.0)

    def write() -> None:
        kept = text[: chance.randrange(len(text))] if chance.random() < 0.5 else text
        scene_path.write_bytes(kept)
        viewer.load()

    def resize() -> None:
        nonlocal target
        target = device.texture(*chance.choice(sizes), "rgba8unorm", "view.target")

    deeds = [
        lambda: viewer.key(chance.choice([*(key.key for key in KEYS), "Tab", "=", ""])),
        lambda: viewer.press(*place(), chance.randrange(6), chance.choice([(), ("Shift",)])),
        lambda: viewer.move(*place()),
        lambda: viewer.release(*place()),
        lambda: viewer.wheel(chance.choice([-1.0, 1.0, 40.0, -40.0]), *place()),
        resize,
        write,
    ]
    for _ in range(80):
        chance.choices(deeds, (8, 3, 5, 3, 3, 1, 1))[0]()
        viewer.tick()
        viewer.draw(target)
        camera, _, _ = viewer.camera()
        assert np.isfinite(camera.camera_from_world).all()
    scene_path.write_bytes(text)
    viewer.load()
    viewer.key("r")
    assert viewer.fault == "" and screenshot(viewer, SIZE).std() > 10.0
    viewer.close()
