"""A scene's supports, loads and measurements as the models and images get them."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import gpusim as gs
from gpusim.scene import Scene
from tests.support.scene_models import scene_model


@pytest.fixture
def scene(checkout: Path) -> gs.Scene:
    return gs.load_scene(
        checkout / "examples" / "cantilever.toml", {"body.bar.mesh.divisions": [12, 2, 2]}
    )


def model_of(scene: gs.Scene, **changes: Any) -> gs.Model:
    for path, value in changes.items():
        scene = scene.replace(path.replace("__", "."), value)
    return scene_model(scene)


def test_a_support_by_normal_holds_the_nodes_of_those_faces_only(scene: gs.Scene) -> None:
    by_set = model_of(scene)
    by_normal = model_of(scene, body__bar__support__clamp__where={"normal": "-x"})
    assert by_set.fixed is not None and by_normal.fixed is not None
    assert by_set.fixed.any(axis=1).sum() == 9
    np.testing.assert_array_equal(by_normal.fixed, by_set.fixed)


def test_a_nodal_force_by_normal_and_bounds(scene: gs.Scene) -> None:
    push = {"name": "push", "type": "nodal_force", "force_N": [0.0, 0.0, -2.0],
            "where": {"normal": "+x", "z_max_mm": 5.0}}  # fmt: skip
    model = model_of(scene, body__bar__load=[push])
    loaded = np.flatnonzero(model.load_cases[0, :, 2])
    np.testing.assert_array_equal(model.mesh.points[loaded, 0], 0.24)
    assert len(loaded) == 6 and model.load_cases.sum() == pytest.approx(-12.0)


def test_supports_that_disagree_are_refused(scene: gs.Scene) -> None:
    clamp = {"name": "clamp", "where": {"set": "x_min"}, "fix": ["x", "y", "z"]}
    push = {"name": "push", "where": {"normal": "-z"}, "fix": ["z"],
            "displacement_mm": [0.0, 0.0, -1.0]}  # fmt: skip
    with pytest.raises(gs.InputError, match="'push': 3 of its nodes are held at another z"):
        model_of(scene, body__bar__support=[clamp, push])
    push["displacement_mm"] = [0.0, 0.0, 0.0]  # the same place twice is no contradiction
    model_of(scene, body__bar__support=[clamp, push])


def test_small_markers_are_measured_and_too_small_ones_refused(
    scene: gs.Scene, tmp_path: Path
) -> None:
    low = scene.replace("camera.side.resolution_px", [600, 240])
    report = gs.run(low, tmp_path)
    tip = report.measurements[0]
    assert abs(tip.error) <= 2e-3 * abs(tip.truth)
    with pytest.raises(gs.InputError, match=r"marker 'side-0\d' is too small .* width of 8.0 px"):
        gs.run(scene.replace("camera.side.resolution_px", [300, 120]), tmp_path)


def two_bodies(scene: gs.Scene) -> gs.Scene:
    document = scene.document
    second = copy.deepcopy(document["body"][0])
    second |= {"name": "second", "paint": [{"name": "dull", "type": "plain", "albedo": 0.2}]}
    second["mesh"] |= {"origin_mm": [0.0, 0.0, -40.0], "divisions": [6, 2, 2]}
    document["body"].append(second)
    document["camera"][0]["resolution_px"] = [150, 60]
    document["output"] = {"truth": ["element", "displacement"], "vtu": True}
    del document["measure"]
    return Scene.from_document(document)


def test_truth_holds_the_nodes_of_every_body(scene: gs.Scene, tmp_path: Path) -> None:
    gs.run(two_bodies(scene), tmp_path, backend="numpy")
    with h5py.File(tmp_path / "truth.h5") as file:
        points, cells = file["mesh/points"][:], file["mesh/cells/hex8"][:]
        u = file["mesh/displacement/0001"][:]
        frame = file["camera/side/frame/0001"]
        element, seen = frame["element"][:], frame["displacement"][:]
    assert len(points) == len(u) == 9 * (13 + 7) and cells.max() == len(points) - 1
    assert set(np.unique(element[element >= 0])) & set(range(48, 72))  # the second body's cells
    for row, column in np.argwhere(element >= 0)[::37]:
        nodal = u[cells[element[row, column]]]
        assert (nodal.min(axis=0) - 1e-8 <= seen[row, column]).all()
        assert (seen[row, column] <= nodal.max(axis=0) + 1e-8).all()


def test_a_report_speaks_only_for_its_own_run(
    scene: gs.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = two_bodies(scene)
    first = gs.run(both, tmp_path, backend="numpy")
    assert {link.path.name for link in first.links} >= {"truth.h5", "bar.pvd", "second.pvd"}
    less = both.replace("output.truth", []).replace("output.vtu", False)
    second = gs.run(less, tmp_path, backend="numpy")
    assert {link.path.name for link in second.links} == {"scene.toml", "report.json"}

    def broken(self: object, *arguments: object) -> None:
        assert not (tmp_path / "report.json").exists()
        raise ZeroDivisionError("by accident")

    monkeypatch.setattr("gpusim.pipeline.stages.images.picture", broken)
    with pytest.raises(ZeroDivisionError):
        gs.run(less.replace("light.bulb.power_W", 41.0), tmp_path, backend="numpy")
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["status"] == "failed"
    assert any("ZeroDivisionError: by accident" in stage["reason"] for stage in report["stages"])


def test_device_seconds_are_those_of_the_run(
    scene: gs.Scene, device: gs.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gpusim.graph.session.default_device", lambda: device)
    monkeypatch.setattr(device.timer, "seconds", lambda: {"fem.cg": 5.0, "elsewhere": 7.0})
    facts = gs.run(scene.replace("measure", []), tmp_path).facts
    assert not [name for name in facts if name.startswith("device:")]


def test_wrong_arguments_of_run_are_refused_before_the_folder_is_touched(
    scene: gs.Scene, tmp_path: Path
) -> None:
    with pytest.raises(gs.InputError, match="cuda"):
        gs.run(scene, tmp_path / "out", backend="cuda")
    with pytest.raises(gs.InputError, match="load_scene"):
        gs.run("scene.toml", tmp_path / "out")  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()
