"""Scenes that share tables with others are what they are without, in all that stages depend on."""

from __future__ import annotations

from typing import Any

import pytest

from gpusim.errors import SceneError
from gpusim.graph.graph import Graph
from gpusim.plan.scene_stages import scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from gpusim.scene.shared_tables import SharedTables
from tests.support.every_table import everything, write_inputs

CHANGES: tuple[dict[str, Any], ...] = (
    {"sensor.seed": 4},
    {"sensor.full_well_e": 9e3, "camera.left.focal_mm": 51.0},
    {"camera.left.sensor.bits": 10},
    {"analysis.load_factors": [0.0, 0.4, 1.0]},
    {"material.0.youngs_modulus_GPa": 60.0, "light.lamp.power_W": 30.0},
    {"body.bar.load.side.force_N": [0.0, 6, 0.0]},
    {"body.block.paint.dark.albedo": 0.2, "prop.wall.size_mm": [410.0, 200.0]},
    {"measure.field.subset_px": 17, "render.error": 0.5, "solver.tolerance": 1e-5},
    {"calibration.pose.0.position_mm": [111.0, -20.0, 20.0], "camera.right.name": "other",
     "measure.space.cameras": ["left", "other"]},
    {"video": {"frame_rate_Hz": 50.0, "exposure_us": 100.0}},
    {"body": [], "measure": [], "output.labels": False},
)  # fmt: skip


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("inputs")
    write_inputs(folder)
    return Scene.from_document(everything(), folder=folder)


def made(base: Scene, overrides: dict[str, Any], known: SharedTables | None) -> Scene:
    return Scene.from_document(
        base.document, overrides=overrides, files=base.files, resolved=True, known=known
    )


def keys(scene: Scene, known: SharedTables | None = None) -> dict[str, list[str]]:
    graph = Graph()
    graph.add(scene_stages(scene, RunOptions("numpy"), known).stages)
    return graph.records[""]


def test_scenes_with_shared_tables_have_the_keys_of_others(base: Scene) -> None:
    known = SharedTables()
    alone = [made(base, change, None) for change in CHANGES]
    shared = [made(base, change, known) for change in CHANGES]
    again = [made(base, change, known) for change in CHANGES]
    assert len({str(keys(scene)) for scene in alone}) == len(CHANGES)
    # after all are made: none may have changed what another one holds
    for one, two, three in zip(alone, shared, again, strict=True):
        assert one == two == three
        assert keys(one) == keys(two) == keys(two, known) == keys(three, known)


def test_what_says_the_same_is_one_object(base: Scene) -> None:
    known = SharedTables()
    first, seed, focal = (
        made(base, change, known)
        for change in ({}, {"sensor.seed": 4}, {"camera.left.focal_mm": 51.0})
    )
    assert seed.render is focal.render is first.render and seed.props[0] is first.props[0]
    assert seed.sensor is not first.sensor and focal.sensor is first.sensor
    # a camera holds what its own sensor and that of all make together
    assert seed.cameras[0] is not first.cameras[0]
    assert seed.sensor_of("left").seed == 4 and first.sensor_of("left").seed == 3


@pytest.mark.parametrize(
    "wrong",
    [
        {"camera.left.focal_mm": -1.0, "light.lamp.power_W": "x"},
        {"sensor.bits": True},
        {"camera.left.focal_mm": float("nan")},
        {"body.bar.material": "cheese"},
        {"sensor.bayer": "rggb", "camera.left.channels": "rgb"},
        {"render": {"error": object()}},
        {"camera.left.sensr": {"bits": 8}},
    ],
)
def test_faults_are_those_of_the_scene_alone(base: Scene, wrong: dict[str, Any]) -> None:
    known = SharedTables()
    made(base, {"sensor.bits": 10}, known)
    with pytest.raises(SceneError) as alone:
        made(base, wrong, None)
    for _ in range(2):  # what is wrong isn't known afterwards
        with pytest.raises(SceneError) as shared:
            made(base, wrong, known)
        assert str(shared.value) == str(alone.value)
