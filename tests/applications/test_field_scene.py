"""Scenes of displacement files: where the camera is put, what it sees, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.applications.field_scene import field_scene
from gpusim.errors import InputError, SceneError
from gpusim.export.images import read_image
from gpusim.plan.plan import make_plan

Array = npt.NDArray[np.float64]


def saved(path: Path, mesh: gs.Mesh, u: Array) -> Path:
    """An .npz with one state."""
    cells: dict[str, Any] = {f"cells_{kind}": block for kind, block in mesh.cells.items()}
    np.savez(path, points=mesh.points, displacement=u, **cells)
    return path


def plate(path: Path, size: tuple[float, float, float]) -> Path:
    """A block that is not at the origin; it grows by 1 % and shifts."""
    mesh = gs.mesh.box(size, (6, 5, 4), (30.0, -20.0, 7.0))
    return saved(path, mesh, 0.01 * mesh.points + [0.5, -0.3, 0.2])


def tube(path: Path) -> Path:
    """A piece of 150 degrees of a tube about the x axis, its middle upwards."""
    flat = gs.mesh.box((80.0, 1.0, 1.0), (8, 40, 1))
    angle = np.radians(15.0 + 150.0 * flat.points[:, 1])
    radius = 40.0 + 2.0 * flat.points[:, 2]
    points = np.stack([flat.points[:, 0], -radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return saved(path, gs.Mesh(points, flat.cells), 0.002 * points)


def shown(scene: gs.Scene, camera: gs.Camera) -> tuple[Array, Array]:
    """Pixels of all corners of the skin in all frames, and their depths."""
    points = np.concatenate(
        [surface.points for frame in range(len(scene.analysis.times or ()))
         for surface in scene.surfaces(frame)]
    )  # fmt: skip
    return camera.project(points), camera.to_camera(points)[:, 2]


def filled(scene: gs.Scene, camera: gs.Camera) -> Array:
    """Shares (2,) of the image's width and height that are taken; everything is in it."""
    pixels, depth = shown(scene, camera)
    size = np.array([camera.width, camera.height])
    assert (depth > 0).all() and (pixels > -0.5).all() and (pixels < size - 0.5).all()
    return np.asarray(np.ptp(pixels, axis=0) / size)


@pytest.mark.parametrize(
    ("size", "forward", "down", "portrait"),
    [
        ((60.0, 40.0, 3.0), [0, 0, -1], [0, -1, 0], False),  # lies: from above
        ((60.0, 3.0, 40.0), [0, 1, 0], [0, 0, -1], False),  # stands: from the front
        ((3.0, 60.0, 40.0), [-1, 0, 0], [0, 0, -1], False),  # across: from the right
        ((15.0, 3.0, 90.0), [0, 1, 0], [0, 0, -1], True),  # upright pictures of what is high
    ],
)
def test_a_camera_looks_at_the_largest_side_upright(
    tmp_path: Path, size: tuple[float, float, float], forward: list[int], down: list[int],
    portrait: bool,
) -> None:  # fmt: skip
    scene = field_scene(plate(tmp_path / "p.npz", size))
    camera = scene.cameras()["front"]
    np.testing.assert_allclose(camera.camera_from_world[2, :3], forward, atol=1e-9)
    np.testing.assert_allclose(camera.camera_from_world[1, :3], down, atol=1e-9)
    assert (camera.width, camera.height) == ((2048, 2448) if portrait else (2448, 2048))
    share = filled(scene, camera)
    assert 0.90 < share.max() <= 0.93
    # four pixels a speckle, on the side that is seen
    (paint,) = scene.bodies[0].paints
    away = camera.to_camera(scene.surfaces(0)[0].points)[:, 2].min()
    assert camera.K[0, 0] * paint.diameter / away == pytest.approx(4.0, rel=0.03)
    assert camera.K[0, 0] * paint.softness / away == pytest.approx(1.0, rel=0.03)
    assert paint.where.normal == "+-"[-sum(forward) < 0] + "xyz"[int(np.argmax(np.abs(forward)))]


def test_all_states_stay_in_the_picture(checkout: Path) -> None:
    path = checkout / "examples" / "strip.frd"
    last, whole = field_scene(path), field_scene(path, step="all")
    assert last.analysis.times == (0.0, 1.0)
    assert whole.analysis.times == (0.0, 0.25, 0.5, 0.75, 1.0)
    for scene in (last, whole):
        assert filled(scene, scene.cameras()["front"]).max() > 0.8
    assert field_scene(path, unit="m").cameras()["front"].eye[2] > 500.0


def test_a_curved_body_is_seen_from_its_widest_side(tmp_path: Path) -> None:
    scene = field_scene(tube(tmp_path / "tube.npz"), speckle_mm=1.5)
    (camera,) = scene.cameras().values()
    np.testing.assert_allclose(camera.camera_from_world[2, :3], [0, 0, -1], atol=1e-9)
    assert filled(scene, camera).max() > 0.6
    (paint,) = scene.bodies[0].paints
    assert (paint.mapping, paint.diameter) == ("unfold", 0.0015)
    # where the tube is steepest, speckles are as dense as on its top
    frame = gs.render(scene.surfaces(0), camera.reframed(612, 512, scale=(0.25, 0.25)))
    dark = frame.radiance < 0.3
    truth = frame.truth()
    across = np.abs(truth.reference[:, 1])
    for low, high in ((0.0, 0.01), (0.025, 0.035)):
        band = (across >= low) & (across < high) & (truth.reference[:, 2] > 0.02)
        assert 0.3 < dark[truth.row[band], truth.column[band]].mean() < 0.65


def calibrated(path: Path, format: str) -> list[gs.Camera]:
    """A converging pair in a file; its frame is the first camera's in Kalibr's and MatchID's."""
    eyes = ((-0.12, 0.02, 0.6), (0.14, 0.0, 0.58))
    cameras = []
    for name, eye in zip(("left", "right"), eyes, strict=True):
        pose = gs.Camera.from_lens((1, 1), 1, (10, 10), eye, (0, 0, 0), up=(0, 1, 0))
        K = [[1500, 0, 260.0], [0, 1500, 190.0], [0, 0, 1]]
        lens = [-0.1, 0.03, 1e-3, -5e-4]
        cameras.append(gs.Camera(521, 381, K, lens, pose.camera_from_world, name))
    gs.write_calibration(path, cameras, format)
    return cameras


def test_cameras_with_a_pose_stand_where_their_file_says(tmp_path: Path) -> None:
    written = calibrated(tmp_path / "rig.xml", "dice")
    scene = field_scene(plate(tmp_path / "p.npz", (60, 40, 3)), camera=tmp_path / "rig.xml")
    points = np.random.default_rng(2).uniform(-0.05, 0.05, (50, 3))
    for before, (name, after) in zip(written, scene.cameras().items(), strict=True):
        assert name == before.name
        np.testing.assert_allclose(after.project(points), before.project(points), atol=1e-9)


@pytest.mark.parametrize(("name", "format"), [("rig.caldat", "matchid"), ("rig.yaml", "kalibr")])
@pytest.mark.parametrize("size", [(60.0, 40.0, 3.0), (50.0, 3.0, 40.0)])
def test_a_rig_without_a_place_is_put_before_the_body(
    tmp_path: Path, name: str, format: str, size: tuple[float, float, float]
) -> None:
    written = calibrated(tmp_path / name, format)
    path = plate(tmp_path / "p.npz", size)
    scene = field_scene(path, camera=tmp_path / name, resolution=(521, 381))
    left, right = scene.cameras().values()
    # as they stand to each other
    between = right.camera_from_world @ np.linalg.inv(left.camera_from_world)
    wanted = written[1].camera_from_world @ np.linalg.inv(written[0].camera_from_world)
    np.testing.assert_allclose(between, wanted, atol=1e-9)
    # both look at the middle of the body, from the side where its largest face is
    middle = np.concatenate([scene.surfaces(k)[0].points for k in (0, 1)])
    middle = 0.5 * (middle.min(axis=0) + middle.max(axis=0))
    for camera in (left, right):
        np.testing.assert_allclose(camera.project(middle), [260.0, 190.0], atol=0.5)
    axis = left.camera_from_world[2, :3] + right.camera_from_world[2, :3]
    outward = [0, 0, 1] if size[2] == 3.0 else [0, -1, 0]
    np.testing.assert_allclose(axis / np.linalg.norm(axis), -np.array(outward), atol=1e-9)
    up = np.array([0, 1, 0] if size[2] == 3.0 else [0, 0, 1])
    assert -left.camera_from_world[1, :3] @ up > 0.99


def test_a_single_lens_is_put_where_the_body_fills_its_picture(tmp_path: Path) -> None:
    K = [[1500, 0, 260.0], [0, 1500, 190.0], [0, 0, 1]]
    gs.write_calibration(tmp_path / "lens.yml", [gs.Camera(521, 381, K, [-0.1, 0, 0, 0])], "opencv")
    scene = field_scene(plate(tmp_path / "p.npz", (60, 40, 3)), camera=tmp_path / "lens.yml")
    (camera,) = scene.cameras().values()
    assert np.asarray(camera.distortion)[0] == -0.1
    assert 0.87 < filled(scene, camera).max() < 0.93


def test_parallel_cameras_stand_as_far_away_as_they_need(tmp_path: Path) -> None:
    K = [[1500, 0, 260.0], [0, 1500, 190.0], [0, 0, 1]]
    pose = np.eye(4)
    pose[0, 3] = -0.004
    pair = [gs.Camera(521, 381, K), gs.Camera(521, 381, K, None, pose, "other")]
    gs.write_calibration(tmp_path / "pair.yaml", pair, "kalibr")
    scene = field_scene(plate(tmp_path / "p.npz", (60, 40, 3)), camera=tmp_path / "pair.yaml")
    left, right = scene.cameras().values()
    np.testing.assert_allclose(left.to_camera(right.eye), [0.004, 0, 0], atol=1e-9)
    for camera in (left, right):
        assert shown(scene, camera)[0][:, 0].mean() == pytest.approx(260.0, abs=60.0)
    pixels, _ = shown(scene, left)
    assert 0.87 < (np.ptp(pixels, axis=0) / [521, 381]).max() < 0.93


def test_an_oblique_side_is_looked_at_squarely(tmp_path: Path) -> None:
    turn = cv2.Rodrigues(np.array([0.0, np.radians(47.3), 0.0]))[0]
    block = gs.mesh.box((60.0, 40.0, 3.0), (6, 5, 2))
    mesh = gs.Mesh(block.points @ turn.T, block.cells)
    scene = field_scene(saved(tmp_path / "p.npz", mesh, 0.01 * mesh.points))
    (camera,) = scene.cameras().values()
    np.testing.assert_allclose(camera.camera_from_world[2, :3], -turn[:, 2], atol=1e-7)
    assert scene.bodies[0].paints[0].mapping == "unfold"
    assert filled(scene, camera).max() > 0.85


def test_names_of_files_become_names_of_scenes(tmp_path: Path) -> None:
    assert field_scene(plate(tmp_path / "my part (2).npz", (60, 40, 3))).name == "my-part-2"
    assert field_scene(plate(tmp_path / "3.npz", (60, 40, 3))).name == "body"


def test_files_that_have_nothing_to_show(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=np.eye(3), displacement=np.eye(3))
    with pytest.raises(InputError, match="no array cells_hex8 or the like"):
        field_scene(tmp_path / "a.npz")
    with pytest.raises(InputError, match="not found"):
        field_scene(tmp_path / "none.frd")
    with pytest.raises(InputError, match=r"unit; got 'ft'; expected"):
        field_scene(tmp_path / "a.npz", unit="ft")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"step; got 'first'; expected"):
        field_scene(tmp_path / "a.npz", step="first")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"speckle_mm; got 0\.0; expected a diameter > 0"):
        field_scene(tmp_path / "a.npz", speckle_mm=0.0)


def test_results_are_told_how_to_be_shown(tmp_path: Path) -> None:
    """Where a deck or a scene meets a file of results, or what can't be solved here."""
    way = r"gpusim render --field FILE makes pictures and truth"
    for name in ("a.odb", "a.frd"):
        (tmp_path / name).write_bytes(b"\0")
        with pytest.raises(InputError, match=f"{name}; got a file of results; .*{way}"):
            gs.load_deck(tmp_path / name)
        body = {"name": "a", "material": "m", "mesh": {"file": name}}
        with pytest.raises(SceneError, match=f"mesh.file: unknown kind of mesh file.*{way}"):
            gs.Scene.from_document({"schema": 1, "name": "a", "body": [body]}, folder=tmp_path)
    (tmp_path / "a.odb").write_bytes(b"\0")
    with pytest.raises(InputError, match=f"got '.odb'; .*saved as .vtu, Exodus or .npz: {way}"):
        gs.read_field(tmp_path / "a.odb")
    body = {"name": "a", "field": {"file": "a.odb"}}
    with pytest.raises(SceneError, match=f"unknown kind of result file.*{way}"):
        gs.Scene.from_document(
            {"schema": 1, "name": "a", "body": [body],
             "analysis": {"type": "field", "times": [0.0, 1.0]}}, folder=tmp_path,
        )  # fmt: skip


def test_pictures_and_truth_are_those_of_the_file(checkout: Path, tmp_path: Path) -> None:
    path, out = checkout / "examples" / "strip.frd", tmp_path / "out"
    scene = field_scene(path, resolution=(306, 256), speckle_mm=2.0)
    gs.run(scene, out)
    field = gs.read_field(path, scale=1e-3)
    camera = scene.cameras()["front"]
    with h5py.File(out / "truth.h5") as file:
        for frame, time in enumerate((0.0, 1.0)):
            np.testing.assert_allclose(
                file[f"mesh/displacement/{frame:04d}"][:], field.at(time), atol=1e-12
            )
        group = file["camera/front/frame/0001"]
        X, u = group["reference"][:].astype(float), group["displacement"][:].astype(float)
    row, column = np.nonzero(np.isfinite(X[..., 0]))
    turn, T = cv2.Rodrigues(camera.camera_from_world[:3, :3])[0], camera.camera_from_world[:3, 3]
    seen = cv2.projectPoints((X + u)[row, column], turn, T, camera.K, None)[0].reshape(-1, 2)
    assert len(row) > 3000
    assert np.abs(seen - np.stack([column, row], axis=1)).max() <= 2e-3
    first, last = (read_image(out / f"images/front/{k:04d}.png") for k in (0, 1))
    top = np.isfinite(X[..., 0]) & (X[..., 2] > 0.499e-3)
    assert 0.3 < (last[top] < 100).mean() < 0.7 and np.mean(first != last) > 0.02
    # the way on: the scene of the folder is the run's own
    plan = make_plan(gs.load_scene(out / "scene.toml"), out)
    assert plan["render/front/0001"].state == plan["truth"].state == "reused"
