"""A target photographed in its own window is the one in the whole image."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import gpusim as gs
from gpusim.export.images import read_image
from gpusim.graph.session import Session
from gpusim.pipeline.pictures.image_window import window_of
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.pipeline.scene_objects.surfaces import build_prop, posed
from gpusim.pipeline.stages.truth import sight
from gpusim.plan.stages import RunOptions
from gpusim.scene.frames import frame_table

CAMERA = {
    "name": "one", "sensor_mm": [36.0, 24.0], "resolution_px": [300, 200], "focal_mm": 50.0,
    "position_mm": [20.0, -470.0, 40.0], "target_mm": [90.0, 0.0, 25.0],
}  # fmt: skip
DOCUMENT = {
    "schema": 1, "name": "board", "camera": [CAMERA],
    "prop": [{
        "name": "board", "center_mm": [50.0, 0.0, 5.0], "normal": [0.0, -1.0, 0.0],
        "size_mm": [90.0, 70.0],
        "paint": [{"name": "fields", "type": "checker", "albedo": 0.9, "cell_mm": 10.0,
                   "columns": 7, "rows": 5, "origin_mm": [15.0, 0.0, -20.0]}],
    }, {
        "name": "wall", "center_mm": [50.0, 90.0, 5.0], "normal": [0.0, -1.0, 0.0],
        "size_mm": [900.0, 700.0], "paint": [{"name": "grey", "type": "plain", "albedo": 0.5}],
    }],
    "light": [{"name": "lamp", "type": "area", "position_mm": [300.0, -900.0, 200.0],
               "target_mm": [50.0, 0.0, 0.0], "size_mm": [100.0, 50.0], "power_W": 40.0}],
    "calibration": {"board": "board", "cameras": ["one"], "pose": [
        {"position_mm": [50.0, 0.0, 5.0], "rotation_deg": [0.0, 0.0, 0.0]},
        {"position_mm": [60.0, 10.0, -5.0], "rotation_deg": [20.0, 0.0, -25.0]},
    ]},
}  # fmt: skip


def photographs(scene: gs.Scene, folder: Path, skip: bool) -> list[np.ndarray]:
    gs.run(scene, folder, backend="numpy", skip=skip)
    return [read_image(folder / f"images/one/calib-{pose:04d}.png") for pose in range(2)]


@pytest.mark.parametrize("distortion", [[], [-0.2, 0.05, 0.001, -0.002]])
def test_a_window_changes_nothing(tmp_path: Path, distortion: list[float]) -> None:
    scene = gs.Scene.from_document(
        {**DOCUMENT, "camera": [
            {**CAMERA, "resolution_px": [150, 100], "distortion": distortion}
        ]}, source="test",
    )  # fmt: skip
    part, whole = (photographs(scene, tmp_path / str(skip), skip) for skip in (True, False))
    for one, other in zip(part, whole, strict=True):
        assert one.shape == other.shape == (100, 150)
        assert np.ptp(other) > 100
        off = np.abs(one.astype(int) - other.astype(int))
        assert off.max() <= 1 and np.count_nonzero(off) <= 3  # a rounding that just tips over


def test_windows_hold_all_that_is_seen() -> None:
    scene = gs.Scene.from_document(DOCUMENT, source="test")
    prop = build_prop(scene.props[0])
    viewer = build_camera(scene.cameras[0])
    window = window_of([prop], viewer)
    assert window is not None
    x, y = viewer.project(prop.points).T
    assert window.left <= x.min() and x.max() <= window.left + window.width - 1
    assert window.top <= y.min() and y.max() <= window.top + window.height - 1
    assert window.width <= np.ptp(x) + 8 and window.height <= np.ptp(y) + 8
    # one pixel of the window is the same pixel of the image
    inside = window.camera(viewer).project(prop.points)
    corner = np.array([window.left, window.top])
    assert np.allclose(inside + corner, viewer.project(prop.points))
    near = dataclasses.replace(viewer, K=viewer.K * np.array([[9.0], [9.0], [1.0]]))
    assert window_of([prop], near) is None  # fills the image, or is beside it


def test_the_truth_of_a_window_is_that_of_the_whole() -> None:
    camera = {**CAMERA, "distortion": [-0.2, 0.05, 0.001, -0.002]}
    document = {key: value for key, value in DOCUMENT.items() if key != "calibration"}
    board = DOCUMENT["prop"][0]  # type: ignore[index]
    wall = DOCUMENT["prop"][1]  # type: ignore[index]
    scene = gs.Scene.from_document(
        {**document, "camera": [camera], "prop": [board, wall]}, source="test"
    )
    props = [build_prop(prop) for prop in scene.props]
    found = []
    frames = frame_table(scene)
    for skip in (True, False):
        objects = SceneObjects(scene, [one.shown for one in frames], props=props)
        session = Session(RunOptions("numpy", skip=skip))
        frame, window, _ = sight(objects, scene.cameras[0], frames, None, session, bodies=1)
        truth = frame.truth(faces=(0, len(props[0].faces)))
        found.append((truth, truth.row + window.top, truth.column + window.left))
        assert (frame.width * frame.height < 0.7 * 300 * 200) == skip
    (part, *place), (whole, *whole_place) = found
    assert len(whole.row) > 4000
    assert np.array_equal(place, whole_place)
    for layer in ("depth", "reference", "flow", "normal"):
        assert np.abs(getattr(part, layer) - getattr(whole, layer)).max() <= 1e-9


def test_the_board_is_found_in_its_window_as_in_the_whole(tmp_path: Path) -> None:
    camera = {**CAMERA, "resolution_px": [900, 600]}
    scene = gs.Scene.from_document({**DOCUMENT, "camera": [camera]}, source="test")
    image = photographs(scene, tmp_path, skip=True)[1]
    pose = scene.calibration.poses[1]  # type: ignore[union-attr]
    seen = posed(build_prop(scene.props[0]), scene.props[0], pose)
    window = window_of([seen], build_camera(scene.cameras[0]))
    assert window is not None
    board = gs.measure.Chessboard(7, 5, 10.0)
    left, top, right, bottom = window.box
    part = gs.measure.find_chessboard(image, board, window.box)
    whole = gs.measure.find_chessboard(image, board)
    assert len(part.image) == len(whole.image) == 24
    assert np.abs(part.image - whole.image).max() <= 1e-3
    assert (part.image > [left, top]).all() and (part.image < [right, bottom]).all()
    nothing = gs.measure.find_chessboard(image, board, (0, 0, left, top))
    assert not len(nothing.image) and nothing.resolution == (900, 600)
    with pytest.raises(gs.errors.InputError, match="find_chessboard region"):
        gs.measure.find_chessboard(image, board, (0, 0, 901, 600))
