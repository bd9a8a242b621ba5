"""What each camera sees is found once, and lies in one file with what the others see."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import gpusim as gs
from gpusim.graph.folder import INNER
from gpusim.pipeline.stages import truth
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from tests.support.small_scene import DOCUMENT, small_scene

LAYERS = ["reference", "displacement", "depth", "visibility"]


def camera(name: str, x: float, y: float = -900.0) -> dict[str, Any]:
    return {**DOCUMENT["camera"][0], "name": name, "resolution_px": [300, 80],
            "position_mm": [x, y, 5.0]}  # fmt: skip


SIDE, LEFT, BACK = camera("side", 120.0), camera("left", 70.0), camera("back", 90.0, 800.0)


def scene(*cameras: dict[str, Any], layers: list[str] = LAYERS, **changes: Any) -> Scene:
    return small_scene(camera=list(cameras), measure=[], output={"truth": layers}, **changes)


@pytest.fixture
def looked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int | None]]:
    """Cameras and frames that truth was looked for in, None unloaded."""
    found: list[tuple[str, int | None]] = []
    original = truth.sight

    def sight(objects: Any, spec: Any, frames: Any, frame: int | None, *rest: Any) -> Any:
        found.append((spec.name, frame))
        return original(objects, spec, frames, frame, *rest)

    monkeypatch.setattr(truth, "sight", sight)
    return found


def states(given: Scene, out: Path) -> dict[str, str]:
    return {
        one.name: one.state for one in make_plan(given, out, "numpy").stages
        if one.name.startswith("truth")
    }  # fmt: skip


def run(given: Scene, out: Path) -> bytes:
    gs.run(given, out, backend="numpy")
    return (out / "truth.h5").read_bytes()


def test_a_new_camera_and_a_changed_one_leave_the_others_truth(
    tmp_path: Path, looked: list[tuple[str, int | None]]
) -> None:
    out = tmp_path / "out"
    run(scene(SIDE), out)
    both = scene(SIDE, LEFT)
    assert states(both, out) == {"truth/side": "reused", "truth/left": "run", "truth": "run"}
    looked.clear()
    data = run(both, out)
    assert looked == [("left", None), ("left", 1)]
    assert data == run(both, tmp_path / "afresh")  # whoever has found it, and when
    looked.clear()
    moved = scene(SIDE, BACK | {"name": "left"})
    assert states(moved, out) == {"truth/side": "reused", "truth/left": "run", "truth": "run"}
    assert run(moved, out) == run(moved, tmp_path / "moved")
    assert looked[:2] == [("left", None), ("left", 1)] and len(looked) == 6
    assert states(scene(LEFT, SIDE), out)["truth/side"] == "reused"  # in whichever order
    assert set(states(moved, out).values()) == {"reused"}


def test_what_no_camera_sees_makes_the_file_alone(
    tmp_path: Path, looked: list[tuple[str, int | None]]
) -> None:
    run(scene(SIDE, LEFT), tmp_path)
    looked.clear()
    renamed = scene(SIDE, LEFT, name="another")
    assert states(renamed, tmp_path) == {
        "truth/side": "reused", "truth/left": "reused", "truth": "run"
    }  # fmt: skip
    run(renamed, tmp_path)
    with h5py.File(tmp_path / "truth.h5") as file:
        assert file.attrs["scene"] == "another" and list(file["camera"]) == ["left", "side"]
    assert looked == []


def test_truth_is_kept_once_and_under_one_name(tmp_path: Path) -> None:
    """Seen before: a file of each camera beside the whole, twice the room on the disk."""
    out, store = tmp_path / "out", tmp_path / "out" / INNER
    large = {"camera": [SIDE | {"resolution_px": [900, 240]}, LEFT], "output": {"truth": LAYERS}}
    run(small_scene(**{**large, "measure": []}), out)
    blobs = [path.stat() for path in (store / "blobs").rglob("*") if path.is_file()]
    whole = (out / "truth.h5").stat()
    assert whole.st_ino in {blob.st_ino for blob in blobs}
    assert sum(blob.st_size > whole.st_size // 4 for blob in blobs) == 1
    assert [path.name for path in out.rglob("*truth*")] == ["truth.h5"]
    less = run(scene(SIDE | {"resolution_px": [900, 240]}), out)
    assert less == run(scene(SIDE | {"resolution_px": [900, 240]}), tmp_path / "afresh")


def test_who_else_sees_a_point_depends_on_all_cameras(
    tmp_path: Path, looked: list[tuple[str, int | None]]
) -> None:
    layers = [*LAYERS, "cameras"]
    run(scene(SIDE, LEFT, layers=layers), tmp_path)
    # each is looked through once in a frame, for itself and for the others
    assert looked == [("side", None), ("left", None), ("side", 1), ("left", 1)]
    three = scene(SIDE, LEFT, BACK, layers=layers)
    assert states(three, tmp_path) == {"truth/side+left+back": "run", "truth": "run"}
    run(three, tmp_path)
    with h5py.File(tmp_path / "truth.h5") as file:
        assert file.attrs["cameras"] == "side, left, back"
        bits = {name: file[f"camera/{name}/frame/0000/cameras"][()] for name in file["camera"]}
    seen = {name: values[values >= 0] for name, values in bits.items()}
    assert all(len(values) for values in seen.values())
    assert (seen["side"] & 1 == 1).all() and (seen["back"] == 4).all()
    # beside a rim, where the camera behind has the background in its pixels, it counts as seen
    assert (seen["left"] & 3 == 3).all() and np.mean(seen["left"] & 4 > 0) < 0.2


def test_variants_share_the_truth_of_a_camera(
    tmp_path: Path, looked: list[tuple[str, int | None]]
) -> None:
    variants = [{"name": name, "set": {"camera.left.target_mm": [120.0, 0.0, height]}}
                for name, height in (("low", 4.0), ("high", 7.0))]  # fmt: skip
    gs.run(scene(SIDE, LEFT, variant=variants), tmp_path, backend="numpy")
    assert sorted(looked, key=str) == [("left", 1)] * 2 + [("left", None)] * 2 + [
        ("side", 1), ("side", None)
    ]  # fmt: skip
    seen = []
    for name, _ in (("low", 4.0), ("high", 7.0)):
        with h5py.File(tmp_path / "variants" / name / "truth.h5") as file:
            seen.append([file[f"camera/{camera}/frame/0001/depth"][()]
                         for camera in ("side", "left")])  # fmt: skip
    np.testing.assert_array_equal(seen[0][0], seen[1][0])
    assert not np.array_equal(seen[0][1], seen[1][1], equal_nan=True)


def test_a_scene_without_bodies_is_told_that_its_truth_is_empty(tmp_path: Path) -> None:
    paint = {"name": "grey", "type": "plain", "albedo": 0.5}
    wall = {"name": "wall", "type": "box", "center_mm": [120.0, 0.0, 5.0],
            "size_mm": [50.0, 10.0, 20.0], "paint": [paint]}  # fmt: skip
    given = scene(SIDE, body=[], material=[], prop=[wall])
    assert gs.run(given, tmp_path / "out", backend="numpy").warnings == (truth.EMPTY,)
