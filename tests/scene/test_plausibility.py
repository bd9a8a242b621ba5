"""Numbers that nothing has are told in the plan, each where it stands; what people have is not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gpusim.mesh import box
from gpusim.pipeline.scene_objects.meshing import size_warnings_of
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene, load_scene
from gpusim.scene.description import model as m
from gpusim.scene.plausibility import warnings
from tests.support.example_scenes import example_scenes


@pytest.fixture(scope="module")
def crane(checkout: Path) -> Scene:
    return load_scene(checkout / "examples" / "crane.toml")


@pytest.fixture(scope="module")
def cantilever(checkout: Path) -> Scene:
    return load_scene(checkout / "examples" / "cantilever.toml")


def test_no_example_is_implausible(checkout: Path) -> None:
    for path in example_scenes(checkout):
        assert make_plan(load_scene(path)).warnings == (), path


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("material.0.youngs_modulus_GPa", 70e9, "modulus of 7e+10 GPa"),
        ("material.0.youngs_modulus_GPa", 1e-5, "modulus of 1e-05 GPa"),
        ("material.0.density_kg_m3", 7.85, "density of 7.85 kg/m3"),
        ("material.0.density_kg_m3", 7.85e6, "density of 7.85e+06 kg/m3"),
        ("material.0.expansion_per_K", 12.0, "expands by 12 per K"),
        ("body.0.load.0.force_N", [0.0, 0.0, -3e12], "strain of about"),
        ("body.0.mesh.width_mm", 1e-9, "smaller than a camera sees"),
        ("camera.0.focal_mm", 0.03, "focal length of 0.03 mm"),
        ("camera.0.focal_mm", 30e3, "focal length of 30000 mm"),
        ("camera.0.sensor_mm", [0.036, 0.024], "a sensor of 0.036 x 0.024 mm"),
        ("camera.0.position_mm", [300.0, -20.4, 290.0], "stands 0.4 mm away"),
        ("camera.0.position_mm", [300.0, -40.0, 290.0], "nearer than its focal length of 30 mm"),
        ("camera.0.position_mm", [300.0, -1.02e9, 290.0], "stands 1.02e+09 mm away"),
        ("camera.0.position_mm", [0.3, -1.02, 0.29], "stands at (0.3, -1.02, 0.29) mm"),
    ],
)
def test_one_implausible_number(crane: Scene, key: str, value: Any, said: str) -> None:
    found = warnings(Scene.from_document(crane.document, overrides={key: value}))
    assert any(said in text for text in found), found


def test_a_body_of_another_unit(cantilever: Scene) -> None:
    document = cantilever.document
    mesh = document["body"][0]["mesh"]
    mesh["size_mm"] = [1e6 * value for value in mesh["size_mm"]]
    assert "larger than 10 km" in warnings(Scene.from_document(document))[0]


def test_elements_that_are_needles(cantilever: Scene) -> None:
    document = cantilever.document
    document["body"][0]["mesh"] |= {"divisions": [1, 50, 1], "size_mm": [5e4, 40.0, 60.0]}
    assert any("elements of" in text for text in warnings(Scene.from_document(document)))


def test_loads_of_every_kind(cantilever: Scene) -> None:
    document = cantilever.document
    document["material"][0] |= {"density_kg_m3": 7800.0, "expansion_per_K": 1.2e-5}
    document["body"][0]["load"] = [
        {"name": "weight", "type": "gravity", "acceleration_m_s2": [0.0, 0.0, -9810.0]},
        {"name": "heat", "type": "thermal", "temperature_change_K": 2e4},
        {"name": "spin", "type": "centrifugal", "speed_rpm": 1e9, "axis_point_mm": [0.0] * 3,
         "axis": [0.0, 0.0, 1.0]},
        {"name": "push", "type": "pressure", "pressure_MPa": 3e6, "where": {"set": "x_max"}},
        {"name": "pull", "type": "traction", "traction_MPa": [0.0, 3e6, 4e6],
         "where": {"set": "x_max"}},
    ]  # fmt: skip
    document["body"][0]["support"].append(
        {"name": "far", "where": {"set": "x_max"}, "fix": ["x"], "displacement_mm": [1e6, 0, 0]}
    )
    document["measure"], document["analysis"]["load_factors"] = [], [0.0, 1.0]
    text = "\n".join(warnings(Scene.from_document(document)))
    for said in ("weight: an acceleration of 9810 m/s2", "heat: a temperature change of 20000 K",
                 "spin: 1.05e+08 rad/s", "push: 3e+06 MPa", "pull: 5e+06 MPa",
                 "far: moves by 1e+06 mm"):  # fmt: skip
        assert said in text


def test_a_variant_is_named(checkout: Path) -> None:
    scene = load_scene(checkout / "examples" / "damaged_beam.toml")
    document = scene.document
    document["variant"][-1]["set"]["material.0.youngs_modulus_GPa"] = 7e10
    name = document["variant"][-1]["name"]
    plan = make_plan(Scene.from_document(document))
    assert any(text.startswith(f"variant {name}: material") for text in plan.warnings)
    assert not any("variant undamaged" in text for text in plan.warnings)
    assert json.loads(json.dumps(plan.to_dict()))["warnings"] == list(plan.warnings)


def test_a_mesh_file_of_another_unit() -> None:
    recipe = m.FileMeshTable(file="part.msh")
    for scale, said in ((1e-6, "smaller than a camera sees"), (1e6, "larger than 10 km")):
        grid = box((0.7 * scale, 0.2 * scale, 0.1 * scale), (2, 1, 1))
        (text,) = size_warnings_of("part", recipe, grid)
        assert said in text
    assert size_warnings_of("part", recipe, box((0.7, 0.2, 0.1), (2, 1, 1))) == []
