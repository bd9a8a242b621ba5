"""Parts of a body's mesh that ties join, from a scene's text to the report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from tests.support.scene_models import scene_model
from tests.support.small_scene import small_scene
from tests.support.tied_blocks import blocks

SIDE = {"name": "side", "where": {"x_max_mm": 0.0}, "fix": ["x", "y", "z"]}
JOINT = {"z_min_mm": 1.0, "z_max_mm": 1.0}
TIE = {"name": "joint", "faces": {**JOINT, "normal": "+z"}, "nodes": {**JOINT, "normal": "-z"}}


def tied_scene(folder: Path, tie: dict[str, Any] | None = TIE) -> Scene:
    """Two blocks on each other, 2 x 3 x 1 mm each, whose meshes don't match; held along both."""
    mesh = blocks((2, 3, 1), (3, 5, 2))
    lines = ["*NODE"]
    lines += [f"{n + 1}, {x}, {y}, {z}" for n, (x, y, z) in enumerate(mesh.points.tolist())]
    lines.append("*ELEMENT, TYPE=C3D8")
    for number, cell in enumerate(mesh.cells["hex8"].tolist(), start=1):
        lines.append(", ".join(map(str, [number, *(node + 1 for node in cell)])))
    (folder / "two.inp").write_text("\n".join(lines))
    body = {
        "name": "pair", "material": "steel", "mesh": {"file": "two.inp"},
        "support": [SIDE], "tie": [] if tie is None else [tie],
        "load": [{"name": "push", "type": "force", "where": {"z_min_mm": 2.0},
                  "force_N": [3.0, -2.0, -5.0]}],
        "paint": [{"name": "grey", "type": "plain", "albedo": 0.4}],
    }  # fmt: skip
    camera = {"name": "front", "sensor_mm": [15.0, 4.0], "resolution_px": [90, 24],
              "focal_mm": 50.0, "position_mm": [1.0, -40.0, 1.0],
              "target_mm": [1.0, 0.0, 1.0]}  # fmt: skip
    return small_scene(folder, body=[body], camera=[camera], measure=[], output={})


def test_a_tie_of_a_scene_is_that_of_the_model(tmp_path: Path) -> None:
    model = scene_model(tied_scene(tmp_path))
    (made,) = model.constraints
    assert len(made.right) == 3 * 4 * 6
    u = model.mesh.points @ np.array([[1.0, 2.0, 3.0], [-2.0, 0.5, 1.0], [0.3, -1.0, 2.0]])
    assert np.abs(made.matrix @ u.ravel()).max() <= 1e-15
    following = np.unique(made.matrix.indices[made.matrix.data == 1.0]) // 3
    assert following.min() >= 24


def test_supports_have_forces_of_their_own_where_ties_meet_them(tmp_path: Path) -> None:
    """Nodes of the joint are held, too: what the tie does to them isn't the support's force."""
    scene = tied_scene(tmp_path)
    gs.run(scene, tmp_path / "out", backend="numpy")
    content = json.loads((tmp_path / "out" / "report.json").read_text())["mechanics"]
    (reaction,) = content["reactions"]
    assert reaction["force_N"] == pytest.approx([-3.0, 2.0, 5.0], abs=1e-5)
    assert 0.0 <= content["energy_balance"] <= 1e-5
    model = scene_model(scene)
    solution = gs.solve(model, backend="numpy")
    both = np.where(model.fixed, solution.reactions, 0.0).sum(axis=0)
    assert np.abs(both - [-3.0, 2.0, 5.0]).max() > 0.05


def test_what_is_wrong_with_a_tie_names_it(tmp_path: Path) -> None:
    nothing = {**TIE, "faces": {**JOINT, "normal": "+x"}}
    with pytest.raises(gs.InputError, match="body 'pair', tie 'joint'"):
        scene_model(tied_scene(tmp_path, nothing))
    beside = {**TIE, "nodes": {"z_min_mm": 3.0}}
    with pytest.raises(gs.InputError, match="tie 'joint'"):
        scene_model(tied_scene(tmp_path, beside))
    below = {**TIE, "nodes": {"z_max_mm": 0.0}}
    with pytest.raises(gs.InputError, match=r"tie .joint.: .* lie off the faces; got node 0 at"):
        scene_model(tied_scene(tmp_path, below))
    scene_model(tied_scene(tmp_path, {**below, "tolerance_mm": 1.5}))


def test_a_tie_is_in_the_key_of_the_solve(tmp_path: Path) -> None:
    ties = (TIE, {**TIE, "tolerance_mm": 0.5}, None)
    plans = [make_plan(tied_scene(tmp_path, tie)) for tie in ties]
    assert len({plan["solve"].key for plan in plans}) == 3
    assert plans[0]["solve"].key == make_plan(tied_scene(tmp_path))["solve"].key
