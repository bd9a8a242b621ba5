"""``type = "speckle"`` in a scene file: values in SI, faults, and the paint that comes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import SceneError
from gpusim.pipeline.scene_objects.surfaces import build_body
from gpusim.scene.description import model

SPECKLE = {
    "name": "spray", "type": "speckle", "where": {"normal": "-y"}, "albedo": 0.8,
    "diameter_mm": 0.9, "coverage": 0.45, "softness_mm": 0.125, "size_law": "lognormal",
    "spread": 0.2, "seed": 17, "dot": 0.06,
}  # fmt: skip


def scene(checkout: Path, **changes: Any) -> gs.Scene:
    loaded = gs.load_scene(
        checkout / "examples" / "cantilever.toml", {"body.bar.mesh.divisions": [12, 2, 2]}
    )
    return loaded.replace("measure", []).replace("body.bar.paint", [{**SPECKLE, **changes}])


def test_values_arrive_in_si_and_the_body_is_painted(checkout: Path) -> None:
    loaded = scene(checkout)
    paint = loaded.bodies[0].paints[0]
    assert isinstance(paint, model.SpeckleTable)
    assert (paint.diameter, paint.softness) == (0.0009, 0.000125)
    assert (paint.albedo, paint.dot, paint.coverage, paint.seed) == (0.8, 0.06, 0.45, 17)
    assert (paint.size_law, paint.spread, paint.arrangement) == ("lognormal", 0.2, "random")
    assert paint.up is None and paint.mapping == "plane"
    surface = build_body(loaded.bodies[0]).surface
    assert surface.paints["spray"] == gs.paint.Speckle(
        0.0009, 0.45, 0.000125, "lognormal", 0.2, "random", 17, 0.06, 0.8
    )
    assert gs.Scene.from_document(loaded.document) == loaded


def test_the_seed_changes_the_picture_and_nothing_else_does(
    checkout: Path, device: gs.Device
) -> None:
    camera = gs.Camera.from_lens((36, 24), 600, (60, 40), (0.1, -0.5, 0.01), (0.1, 0.0, 0.01))
    images = [
        gs.render([build_body(scene(checkout, seed=seed).bodies[0]).surface], camera,
                  device=device).radiance
        for seed in (17, 17, 18)
    ]  # fmt: skip
    assert images[0].tobytes() == images[1].tobytes()
    painted = images[0] > 0
    assert painted.sum() > 200 and np.std(images[0][painted]) > 0.05
    assert np.abs(images[2] - images[0])[painted].mean() > 0.05


@pytest.mark.parametrize(
    ("changes", "key", "said"),
    [
        ({"diameter_mm": 0.0}, "diameter_mm", "out of range"),
        ({"coverage": 1.0}, "coverage", "out of range"),
        ({"softness_mm": 0.5}, "softness_mm", "more than half the diameter"),
        ({"size_law": "normal"}, "size_law", "unknown value"),
        ({"size_law": "fixed"}, "spread", "too much"),
        ({"size_law": "uniform", "spread": 0.7}, "spread", "too much"),
        ({"arrangement": "grid", "coverage": 0.6}, "coverage", "would touch"),
        ({"seed": -1}, "seed", "out of range"),
        ({"diametre_mm": 1.0}, "diametre_mm", "unknown key"),
    ],
)
def test_faults_name_the_key(checkout: Path, changes: dict[str, Any], key: str, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        scene(checkout, **changes)
    (fault,) = caught.value.faults
    assert fault.key.endswith(f"paint.0.{key}") and said in fault.problem


def test_a_grid_as_full_as_the_schema_allows_can_be_built(checkout: Path) -> None:
    for law, spread, coverage in (("fixed", 0.0, 0.9), ("uniform", 0.2, 0.51)):
        full = scene(checkout, arrangement="grid", size_law=law, spread=spread, coverage=coverage)
        assert build_body(full.bodies[0]).surface.paints["spray"]
