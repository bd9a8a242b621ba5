"""Props of every shape, in a pose per frame; images of a calibration target."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.export import write_stl
from gpusim.export.images import read_image
from gpusim.mesh import read_surface
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.pipeline.scene_objects.surfaces import build_prop, posed, rotation
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene

CAMERA: dict[str, Any] = {
    "name": "left", "sensor_mm": [7.2, 4.8], "resolution_px": [480, 320], "focal_mm": 9.0,
    "position_mm": [-120.0, -900.0, 40.0], "target_mm": [10.0, 20.0, 20.0],
}  # fmt: skip
COLUMNS, ROWS, CELL = 8, 9, 40.0
BOARD: dict[str, Any] = {
    "name": "board", "type": "plate", "center_mm": [0.0, 0.0, 0.0], "normal": [0.0, -1.0, 0.0],
    "size_mm": [400.0, 440.0],
    "paint": [{"name": "chess", "type": "checker", "albedo": 0.9, "cell_mm": CELL,
               "columns": COLUMNS, "rows": ROWS, "origin_mm": [-160.0, 0.0, -180.0]}],
}  # fmt: skip
POSES: list[dict[str, Any]] = [
    {"position_mm": [-7.0, 310.0, 5.0], "rotation_deg": [4.0, 0.0, 0.0]},
    {"position_mm": [25.0, 330.0, 12.0], "rotation_deg": [20.0, -15.0, 12.0]},
    {"position_mm": [-40.0, 280.0, 20.0], "rotation_deg": [-18.0, 3.0, 25.0]},
]


def scene(**tables: Any) -> Scene:
    document = {
        "schema": 1, "name": "props", "camera": [CAMERA], "render": {"background": 0.5}, **tables,
    }  # fmt: skip
    return Scene.from_document(document)


def block(**more: Any) -> dict[str, Any]:
    return {
        "name": "block", "type": "box", "center_mm": [10.0, 20.0, 30.0],
        "size_mm": [100.0, 60.0, 40.0],
        "paint": [
            {"name": "grey", "type": "plain", "albedo": 0.3},
            {"name": "front", "type": "dots", "where": {"normal": "-y"}, "albedo": 0.8,
             "diameter_mm": 6.0, "pitch_mm": 20.0, "columns": 4, "rows": 2,
             "origin_mm": [-20.0, -10.0, 20.0]},
        ],
        **more,
    }  # fmt: skip


def test_rotations_are_about_fixed_axes_in_turn() -> None:
    angles = (0.3, -0.7, 1.1)
    np.testing.assert_allclose(
        rotation(angles), Rotation.from_euler("xyz", angles).as_matrix(), atol=1e-15
    )


def test_a_box_is_painted_as_described_and_then_turned() -> None:
    (prop,) = scene(prop=[block(rotation_deg=[0.0, 0.0, 90.0])]).props
    surface = build_prop(prop)
    dots = [k for k, name in enumerate(surface.paints) if name == "front"]
    (face,) = surface.faces[surface.regions == dots[0]]
    np.testing.assert_allclose(surface.rest[face][:, 1], -0.01, atol=1e-12)
    turned = posed(surface, prop)
    np.testing.assert_allclose(turned.points.mean(axis=0), [0.01, 0.02, 0.03], atol=1e-12)
    np.testing.assert_allclose(np.ptp(turned.points, axis=0), [0.06, 0.1, 0.04], atol=1e-12)
    # what looked along -y looks along +x now
    np.testing.assert_allclose(turned.points[face][:, 0], 0.04, atol=1e-12)


def stl(path: Path) -> Path:
    """A tetrahedron, wound outwards."""
    corners = np.array([[0.0, 0, 0], [0.03, 0, 0], [0, 0.02, 0], [0, 0, 0.05]])  # m; in mm

    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    write_stl(path, corners, faces)
    return path


def test_a_shape_from_a_file_of_faces(tmp_path: Path) -> None:
    points, faces = read_surface(stl(tmp_path / "thing.stl"))
    assert points.shape == (4, 3) and faces.shape == (4, 4)  # corners are shared again
    table = {
        "name": "thing", "type": "mesh", "file": str(tmp_path / "thing.stl"), "unit": "cm",
        "position_mm": [1.0, 2.0, 3.0], "rotation_deg": [0.0, 90.0, 0.0],
        "paint": [{"name": "all", "type": "plain", "albedo": 0.2},
                  {"name": "base", "type": "plain", "albedo": 0.9, "where": {"normal": "-z"}}],
    }  # fmt: skip
    (prop,) = scene(prop=[table]).props
    surface = build_prop(prop)
    assert np.bincount(surface.regions, minlength=3).tolist() == [0, 3, 1]
    turned = posed(surface, prop).points
    np.testing.assert_allclose(turned.max(axis=0), [0.501, 0.202, 0.003], atol=1e-7)
    np.testing.assert_allclose(turned.min(axis=0), [0.001, 0.002, -0.297], atol=1e-7)
    bad = {**table, "paint": [{"name": "all", "type": "plain", "albedo": 0.2,
                               "where": {"z_min_mm": 900.0}}]}  # fmt: skip
    with pytest.raises(InputError, match="prop 'thing', paint 'all': where: no faces found"):
        build_prop(scene(prop=[bad]).props[0])
    (tmp_path / "thing.stl").write_text("solid nothing\nendsolid\n")
    with pytest.raises(InputError, match=r"thing\.stl: "):
        build_prop(prop)


def test_a_prop_moves_from_frame_to_frame_and_nothing_is_solved(tmp_path: Path) -> None:
    poses = [{"position_mm": [10.0 + 30.0 * k, 20.0, 30.0]} for k in range(3)]
    given = scene(prop=[block(poses=poses)], analysis={"load_factors": [0.0, 0.5, 1.0]})
    assert make_plan(given)["solve"].state == "skipped"
    gs.run(given, tmp_path / "out")
    images = [read_image(tmp_path / f"out/images/left/{k:04d}.png").astype(float) for k in range(3)]
    # dark block on a grey background: its middle moves by the projected 30 mm
    middles = []
    for image in images:
        weight = np.abs(image - image[0, 0])
        middles.append((weight.sum(axis=0) @ np.arange(480)) / weight.sum())
    camera = build_camera(given.cameras[0])
    step = np.diff(camera.project([[0.01, 0.02, 0.03], [0.04, 0.02, 0.03]])[:, 0])[0]
    assert np.abs(np.diff(middles) - step).max() <= 0.03 * step


def corners(pose: dict[str, Any]) -> npt.NDArray[np.float64]:
    """The board's inner corners (m) in a pose, by SciPy's rotation."""
    x = np.arange(1, COLUMNS) * CELL - 160.0
    z = np.arange(1, ROWS) * CELL - 180.0
    grid = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    turn = Rotation.from_euler("xyz", pose["rotation_deg"], degrees=True)
    return (turn.apply(grid) + pose["position_mm"]) * 1e-3


@pytest.fixture(scope="module")
def rig() -> Scene:
    right = {**CAMERA, "name": "right", "position_mm": [160.0, -880.0, 30.0]}
    wall = {"name": "wall", "center_mm": [0.0, 600.0, 0.0], "normal": [0.0, -1.0, 0.0],
            "size_mm": [5000.0, 5000.0],
            "paint": [{"name": "wall", "type": "plain", "albedo": 0.5}]}  # fmt: skip
    return scene(
        camera=[CAMERA, right], prop=[BOARD, wall, block()],
        calibration={"board": "board", "show": ["wall"], "pose": POSES},
    )  # fmt: skip


def test_images_of_a_calibration_target(rig: Scene, tmp_path: Path) -> None:
    out = tmp_path / "out"
    report = gs.run(rig, out)
    names = [stage.name for stage in report.stages]
    assert "render/left/calib-0002" in names and "render/right/calib-0000" in names
    for camera in rig.cameras:
        frame = read_image(out / f"images/{camera.name}/0000.png")
        assert frame.std() > 5 and not cv2.findChessboardCornersSB(frame, (7, 8))[0]
        for k, pose in enumerate(POSES):
            image = read_image(out / f"images/{camera.name}/calib-{k:04d}.png")
            assert cv2.findChessboardCornersSB(image, (COLUMNS - 1, ROWS - 1))[0]
            want = build_camera(camera).project(corners(pose))
            pixels = np.ascontiguousarray(want[:, None], np.float32)
            pixels = cv2.cornerSubPix(image, pixels, (4, 4), (-1, -1), (3, 100, 1e-5))
            # OpenCV's own corners are off by up to 0.1 px on perfect images, either way
            away = pixels.reshape(-1, 2) - want
            assert np.abs(away).max() <= 0.15 and np.abs(away.mean(axis=0)).max() <= 0.03
    again = make_plan(rig, out)
    assert {stage.state for stage in again.stages if stage.name.startswith("render")} == {"reused"}
    moved = rig.replace("calibration.pose.1.position_mm", [25.0, 331.0, 12.0])
    states = {stage.name: stage.state for stage in make_plan(moved, out).stages}
    assert states["render/left/0001"] == "reused"
    assert states["render/left/calib-0001"] == "run"


def test_faults(rig: Scene) -> None:
    for path, value, match in (
        (
            "calibration.board",
            "bord",
            "calibration.board: no such prop of type plate.*one of board",
        ),
        ("calibration.board", "block", "no such prop of type plate"),
        ("calibration.cameras", ["left", "rigt"], r"cameras\.1: no such camera"),
        ("calibration.show", ["board"], "names the board"),
        ("prop.block.poses", POSES, r"not one pose per frame.*3 poses; expected 2"),
        ("prop.block.type", "bx", 'type: unknown value.*got "bx"; expected one of "plate", "box"'),
        ("prop.block.center_m", [0.0, 0.0, 0.0], "unknown key"),
    ):
        with pytest.raises(SceneError, match=match):
            rig.replace(path, value)
    with pytest.raises(SceneError, match="calibration: needs a camera"):
        scene(prop=[BOARD], camera=[], calibration={"board": "board", "pose": POSES})


def test_the_resolved_scene_reads_back(rig: Scene, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(rig.to_toml())
    again = gs.load_scene(path)
    assert again.props == rig.props and again.calibration == rig.calibration
    assert json.loads(again.content) == json.loads(rig.content)


def test_truth_says_which_cameras_see_a_point(tmp_path: Path) -> None:
    """A screen hides the strip's far half from the left camera."""
    right = {**CAMERA, "name": "right", "position_mm": [160.0, -880.0, 30.0]}
    steel = {"name": "steel", "type": "isotropic", "youngs_modulus_GPa": 210.0,
             "poissons_ratio": 0.3}  # fmt: skip
    bar = {"name": "bar", "material": "steel",
           "mesh": {"builder": "box", "size_mm": [200.0, 10.0, 60.0], "divisions": [4, 1, 1],
                    "origin_mm": [-100.0, 0.0, -30.0]},
           "paint": [{"name": "grey", "type": "plain", "albedo": 0.4}]}  # fmt: skip
    screen = {"name": "screen", "center_mm": [-70.0, -400.0, 0.0], "normal": [0.0, -1.0, 0.0],
              "size_mm": [60.0, 600.0],
              "paint": [{"name": "black", "type": "plain", "albedo": 0.1}]}  # fmt: skip
    given = scene(material=[steel], body=[bar], prop=[screen], camera=[CAMERA, right],
                  output={"truth": ["reference", "cameras", "element"]})  # fmt: skip
    gs.run(given, tmp_path / "out")
    with h5py.File(tmp_path / "out/truth.h5") as file:
        assert file.attrs["cameras"] == "left, right"
        layer = file["camera/right/frame/0001/cameras"]
        bits, X = layer[:], file["camera/right/frame/0001/reference"][:]
        assert layer.attrs["convention"] == "Eulerian"
    seen = bits >= 0
    assert set(np.unique(bits[seen])) == {2, 3} and seen.sum() > 2000
    # the left camera's line of sight through the screen's borders, at y = 0
    eye = np.array([-120.0, -900.0])
    edges = [eye[0] + (x - eye[0]) * 900.0 / 500.0 for x in (-100.0, -40.0)]
    x = 1e3 * X[..., 0][seen]
    front = np.abs(X[..., 1][seen]) <= 1e-6
    hidden = (x > edges[0] + 1) & (x < edges[1] - 1) & front
    beside = ((x < edges[0] - 1) | (x > edges[1] + 1)) & front
    assert hidden.sum() > 500 and beside.sum() > 500
    assert (bits[seen][hidden] == 2).all() and (bits[seen][beside] == 3).all()
