"""labels.json against cameras and motions that are computed here from their formulas."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.pipeline.stages.labels import rigid_motion
from gpusim.scene import Scene
from tests.support.small_scene import small_scene
from tests.support.stretched_bar import DOCUMENT, NU, PlainCamera, stretch


def labels_of(scene: Scene, out: Path) -> dict[str, Any]:
    gs.run(scene, out, backend="numpy")
    found: dict[str, Any] = json.loads((out / "labels.json").read_text(encoding="utf-8"))
    return found


def board(name: str, paint: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A plate of 40 x 30 mm in the plane y = 0, its lower left corner in the origin."""
    return {"name": name, "center_mm": [20.0, 0.0, 15.0], "normal": [0.0, -1.0, 0.0],
            "size_mm": [40.0, 30.0], "paint": [{"name": name, "albedo": 0.9, **paint}],
            **more}  # fmt: skip


@pytest.mark.parametrize(
    ("paint", "wanted"),
    [
        ({"type": "checker", "cell_mm": 5.0, "columns": 4, "rows": 3,
          "origin_mm": [10.0, 0.0, 10.0]},
         [(x, 0.0, z) for z in (15.0, 20.0) for x in (15.0, 20.0, 25.0)]),
        ({"type": "charuco", "square_mm": 5.0, "marker_mm": 3.0, "columns": 3, "rows": 3,
          "origin_mm": [10.0, 0.0, 10.0]},
         [(x, 0.0, z) for z in (15.0, 20.0) for x in (15.0, 20.0)]),
        ({"type": "dots", "diameter_mm": 2.0, "pitch_mm": 4.0, "columns": 3, "rows": 2,
          "origin_mm": [10.0, 0.0, 10.0]},
         [(x, 0.0, z) for z in (10.0, 14.0) for x in (10.0, 14.0, 18.0)]),
        ({"type": "circles", "diameters_mm": [4.0, 2.0],
          "positions_mm": [[10.0, 0.0, 10.0], [30.0, 0.0, 20.0]]},
         [(10.0, 0.0, 10.0), (30.0, 0.0, 20.0)]),
        ({"type": "plain"}, []),
    ],
)  # fmt: skip
def test_points_of_each_paint_move_with_their_prop(
    paint: dict[str, Any], wanted: list[tuple[float, ...]], tmp_path: Path
) -> None:
    poses = [{"position_mm": [20.0, 0.0, 15.0]},
             {"position_mm": [22.0, 3.0, 14.0], "rotation_deg": [10.0, -5.0, 30.0]}]  # fmt: skip
    scene = Scene.from_document({
        **DOCUMENT, "body": [], "prop": [board("target", paint, poses=poses)],
        "output": {"labels": True}, "sensor": {"exposure": 0.5},
    })  # fmt: skip
    labels = labels_of(scene, tmp_path)
    (target,) = labels["objects"]
    assert (target["name"], target["kind"], len(target["points"])) == (
        "target",
        "prop",
        len(wanted),
    )
    camera, places = PlainCamera(), np.array(wanted).reshape(-1, 3)
    x, y, z = (np.radians(angle) for angle in poses[1]["rotation_deg"])
    turn = cv2.Rodrigues(np.array([0.0, 0.0, z]))[0] @ cv2.Rodrigues(np.array([0.0, y, 0.0]))[0]
    turn = turn @ cv2.Rodrigues(np.array([x, 0.0, 0.0]))[0]
    moved = (places - [20.0, 0.0, 15.0]) @ turn.T + poses[1]["position_mm"]
    for state, place in zip(labels["frames"], (places, moved), strict=True):
        found = np.array(state["keypoints"]["front"]).reshape(-1, 3)
        np.testing.assert_allclose(found[:, :2], camera.pixels(place), atol=1e-9)
        assert (found[:, 2] == 2.0).all()
    pose = np.array(labels["frames"][1]["poses"][0])
    np.testing.assert_allclose(pose[:3, :3], turn, atol=1e-12)
    np.testing.assert_allclose(
        1e3 * pose[:3, 3], poses[1]["position_mm"] - turn @ [20.0, 0.0, 15.0], atol=1e-9
    )


def test_markers_of_a_body_go_with_its_solution(tmp_path: Path) -> None:
    document = json.loads(json.dumps(DOCUMENT))
    middles = [[10.0, 0.0, 8.0], [33.0, 0.0, 15.0], [51.0, 0.0, 21.0]]
    document["body"][0]["paint"] = [{
        "name": "cross", "type": "markers", "where": {"normal": "-y"}, "albedo": 0.4,
        "size_mm": 5.0, "positions_mm": middles}]  # fmt: skip
    scene = Scene.from_document({**document, "prop": [], "output": {"labels": True}})
    labels, camera = labels_of(scene, tmp_path), PlainCamera()
    assert labels["objects"][0]["points"] == ["cross-01", "cross-02", "cross-03"]
    for state, stress in zip(labels["frames"], (0.0, 10.0), strict=True):
        found = np.array(state["keypoints"]["front"])[:, :2]
        wanted = camera.pixels(np.array(middles) * stretch(stress))
        np.testing.assert_allclose(found, wanted, atol=1e-6)
    # nearest to a stretch without rotation is a shift of the vertices' mean
    pose = np.array(labels["frames"][1]["poses"][0])
    np.testing.assert_allclose(pose[:3, :3], np.eye(3), atol=1e-9)
    np.testing.assert_allclose(1e3 * pose[2, 3], -15.0 * NU * 0.01, atol=0.02)


def test_points_are_told_hidden_or_outside(tmp_path: Path) -> None:
    dots = {"type": "dots", "diameter_mm": 2.0, "pitch_mm": 10.0, "columns": 4, "rows": 1,
            "origin_mm": [5.0, 0.0, 15.0]}  # fmt: skip
    cover = {
        "name": "cover",
        "center_mm": [16.0, -20.0, 15.0],
        "normal": [0.0, -1.0, 0.0],
        "size_mm": [4.0, 40.0],
        "paint": [{"name": "c", "type": "plain", "albedo": 0.5}],
    }
    scene = Scene.from_document({
        **DOCUMENT, "body": [], "prop": [board("target", dots), cover], "output": {"labels": True},
        "sensor": {"exposure": 0.5},
        "camera": [{**DOCUMENT["camera"][0], "position_mm": [43.0, -300.0, 15.0],
                    "target_mm": [43.0, 0.0, 15.0]}],
    })  # fmt: skip
    rows = labels_of(scene, tmp_path)["frames"][0]["keypoints"]["front"]
    # the first one is 38 mm to the left: 51 px of 48
    assert [row[2] for row in rows] == [0.0, 1.0, 2.0, 2.0]
    assert rows[0][:2] == [0.0, 0.0]


def test_rigid_motion_is_that_of_rigid_points_and_proper() -> None:
    generator = np.random.default_rng(2)
    points = generator.normal(size=(30, 3)) * [1.0, 1.0, 1e-9]  # flat: reflections fit as well
    turn = cv2.Rodrigues(np.array([0.3, -2.0, 0.7]))[0]
    pose = rigid_motion(points, points @ turn.T + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(pose[:3, :3], turn, atol=1e-8)
    np.testing.assert_allclose(pose[:3, 3], [1.0, 2.0, 3.0], atol=1e-8)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


def test_a_run_without_labels_has_none(tmp_path: Path) -> None:
    gs.run(small_scene(output={}, measure=[]), tmp_path, backend="numpy")
    assert not (tmp_path / "labels.json").exists()
