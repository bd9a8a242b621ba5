"""What a scene file becomes: SI, names resolved, and back to the same text."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import SceneError
from gpusim.export.layers import LAYERS
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.linear.solve_plan import METHODS
from gpusim.mesh.builders import grids
from gpusim.scene import Scene, json_schema, load_scene, parse_value
from gpusim.scene.cost import element_counts
from gpusim.scene.description import model
from gpusim.scene.description.mesh import SETS
from gpusim.scene.faults.key_paths import key_lines
from tests.support.example_scenes import example_scenes


@pytest.fixture(scope="module")
def crane(checkout: Path) -> Scene:
    return load_scene(checkout / "examples" / "crane.toml")


def test_the_crane_in_si(crane: Scene) -> None:
    body = crane.bodies[0]
    steel = body.material
    assert steel is not None and (steel.name, steel.type) == ("steel", "isotropic")
    assert (steel.youngs_modulus, steel.poissons_ratio) == (210e9, 0.3)
    assert (steel.density, steel.expansion) == (7850.0, 0.0)
    mesh = body.mesh
    assert isinstance(mesh, model.CraneMeshTable)
    assert (mesh.height, mesh.foot, mesh.length, mesh.width) == (0.562, 0.070, 0.597, 0.040)
    assert (mesh.column_thickness, mesh.beam_thickness) == (0.006, 0.004)
    assert (mesh.load_length, mesh.element, mesh.through, mesh.across) == (0.108, 0.003, 2, 6)
    load = body.loads[0]
    assert isinstance(load, model.ForceTable)
    assert load.force == (0.0, 0.0, -13.0)
    assert load.where.lower == (0.489, float("-inf"), 0.566)
    assert load.where.upper == (float("inf"),) * 3
    assert load.where.normal == "+z"
    camera = crane.cameras[0]
    assert camera.sensor == (0.036, 0.024)
    assert camera.resolution == (5616, 3744)
    assert camera.focal == 0.03
    assert camera.position == (0.3, -1.02, 0.29)
    # the field of view at the markers is 1200 mm wide, as in the paper
    distance = camera.target[1] - camera.position[1]
    assert camera.sensor[0] / camera.focal * distance == pytest.approx(1.2, rel=1e-12)
    assert crane.sensor.exposure is None
    assert crane.analysis.load_factors == (0.0, 1.0)


def test_every_example_is_valid(checkout: Path) -> None:
    paths = example_scenes(checkout)
    assert {"crane.toml", "cantilever.toml"} <= {path.name for path in paths}
    for path in paths:
        scene = load_scene(path)
        assert Scene.from_document(tomllib.loads(scene.to_toml())) == scene


def test_a_step_part_with_stereo_correlation_takes_60_lines(checkout: Path) -> None:
    text = (checkout / "examples" / "plate_hole_stereo.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.strip() and line.strip()[0] != "#"]
    assert len(lines) <= 60 and any(".step" in line for line in lines)


def test_lines_of_markers_hit_both_ends(crane: Scene) -> None:
    column, beam = crane.bodies[0].paints[1:]
    assert isinstance(column, model.MarkersTable)
    assert isinstance(beam, model.MarkersTable)
    assert [marker.name for marker in beam.markers][::9] == ["beam-01", "beam-10"]
    assert column.markers[0].position == (0.003, -0.02, 0.025)
    assert column.markers[-1].position == (0.003, -0.02, 0.556)
    steps = [
        b.position[0] - a.position[0]
        for a, b in zip(beam.markers[:-1], beam.markers[1:], strict=True)
    ]
    assert steps == pytest.approx([0.062] * 9, abs=1e-15)
    assert beam.size == 0.004


def test_static_markers_are_never_behind_the_crane(crane: Scene) -> None:
    """Seen from the camera, no static marker comes near the column or the (falling) beam."""
    paint, eye = crane.props[0].paint, crane.cameras[0].position
    assert isinstance(paint, model.MarkersTable)
    assert 4 <= len(paint.markers) <= 6
    for marker in paint.markers:
        for depth in (-0.02, 0.02):  # front and back of the crane
            part = (depth - eye[1]) / (marker.position[1] - eye[1])
            x = eye[0] + part * (marker.position[0] - eye[0])
            z = eye[2] + part * (marker.position[2] - eye[2])
            clear = 0.020  # more than a marker, beside 33 mm of deflection
            assert not -clear <= x <= 0.006 + 0.030 + clear, marker
            assert not 0.562 - 0.033 - clear <= z <= 0.566 + clear, marker
            assert abs(x - 0.3) < 0.6 - clear, marker
            assert abs(z - 0.29) < 0.4 - clear, marker


def test_toml_round_trip(crane: Scene) -> None:
    text = crane.to_toml()
    again = Scene.from_document(tomllib.loads(text))
    assert again == crane
    assert again.to_toml() == text
    assert again.digest() == crane.digest()


def test_replace(crane: Scene) -> None:
    changed = crane.replace("camera.front.focal_mm", 35)
    assert changed.cameras[0].focal == 0.035
    assert crane.cameras[0].focal == 0.03
    assert changed == crane.replace("camera.0.focal_mm", 35.0)
    assert crane.replace("solver.tolerance", 1e-9).solver.tolerance == 1e-9
    weight = crane.bodies[0].loads[0]
    heavy = crane.replace("body.crane.load.weight.force_N", (1.0, 2.0, 3.0)).bodies[0].loads[0]
    assert isinstance(weight, model.ForceTable) and isinstance(heavy, model.ForceTable)
    assert heavy == weight.model_copy(update={"force_N": (1.0, 2.0, 3.0)})
    assert heavy.force == (1.0, 2.0, 3.0)
    assert crane.replace("body.crane.load.weight.force_N.1", 192.0) != crane
    with pytest.raises(SceneError, match=r"solver.tolerance: out of range .*got -1"):
        crane.replace("solver.tolerance", -1)
    with pytest.raises(SceneError, match="did you mean focal_mm"):
        crane.replace("camera.front.focal", 35)


def test_overrides_win_over_the_file(checkout: Path) -> None:
    path = checkout / "examples" / "crane.toml"
    scene = load_scene(path, {"render.error": 1, "output.truth": [], "sensor.exposure": 0.5})
    assert scene.render.error == 1.0
    assert scene.output.truth == ()
    assert scene.sensor.exposure == 0.5


def test_what_python_gives_for_a_key_may_be_tuples_and_arrays(checkout: Path) -> None:
    path = checkout / "examples" / "crane.toml"
    factors = np.array([0.0, 2.0])
    given = {"camera.front.resolution_px": (900, 600), "analysis.load_factors": factors,
             "camera.front.focal_mm": np.float64(35.0)}  # fmt: skip
    scene = load_scene(path, given)
    assert scene.cameras[0].resolution == (900, 600) and scene.analysis.load_factors == (0.0, 2.0)
    assert scene.replace("analysis.load_factors", factors / 2).analysis.load_factors == (0.0, 1.0)
    with pytest.raises(SceneError, match="load_factors"):
        load_scene(path, {"analysis.load_factors": np.array([0.0, np.nan])})


def test_values_of_set() -> None:
    assert parse_value("3") == 3
    assert parse_value("1e-9") == 1e-9
    assert parse_value("[1, 2.5]") == [1, 2.5]
    assert parse_value("true") is True
    assert parse_value("front") == "front"
    assert parse_value('"3"') == "3"


def test_other_paints_lights_and_loads() -> None:
    where = {"normal": "+z"}
    board = {
        "name": "board", "type": "checker", "albedo": 0.5, "cell_mm": 7.0, "columns": 9, "rows": 6,
        "origin_mm": [1.0, 2.0, 30.0], "up": [0.0, 1.0, 0.0], "where": where,
    }  # fmt: skip
    dots = {
        "name": "dots", "type": "dots", "albedo": 0.8, "diameter_mm": 2.0, "pitch_mm": 5.0,
        "columns": 3, "rows": 4, "origin_mm": [0.0, 0.0, 0.0],
    }  # fmt: skip
    loads = [
        {"name": "a", "type": "pressure", "where": where, "pressure_MPa": 0.25},
        {"name": "b", "type": "traction", "where": where, "traction_MPa": [1.0, 0.0, -2.0]},
        {"name": "c", "type": "nodal_force", "where": where, "force_N": [0.0, 4.0, 0.0]},
        {"name": "d", "type": "gravity", "acceleration_m_s2": [0.0, -9.81, 0.0]},
    ]
    scene = Scene.from_document(
        {
            "schema": 1,
            "name": "box",
            "material": [
                {"name": "m", "youngs_modulus_GPa": 70, "poissons_ratio": 0, "density_kg_m3": 2700}
            ],
            "body": [
                {
                    "name": "block",
                    "material": "m",
                    "mesh": {"builder": "box", "size_mm": [10, 20, 30], "divisions": [1, 2, 3]},
                    "support": [
                        {
                            "name": "s",
                            "where": {"set": "z_min", "tolerance_mm": 0.5},
                            "fix": ["z", "x"],
                            "displacement_mm": [0.0, 0.0, 2.0],
                        }
                    ],
                    "load": loads,
                    "paint": [board, dots],
                }
            ],
            "light": [{"name": "bulb", "type": "point", "position_mm": [0, 0, 500], "power_W": 3}],
        }
    )
    body = scene.bodies[0]
    assert isinstance(body.mesh, model.BoxMeshTable)
    assert (body.mesh.size, body.mesh.divisions) == ((0.01, 0.02, 0.03), (1, 2, 3))
    assert body.mesh.origin == (0.0, 0.0, 0.0)
    assert body.supports[0].fix == ("z", "x")
    assert body.supports[0].displacement == (0.0, 0.0, 0.002)
    assert body.supports[0].where.tolerance == 0.0005
    pressure, traction, nodal, gravity = body.loads
    assert isinstance(pressure, model.PressureTable)
    assert pressure.pressure == 0.25e6
    assert isinstance(traction, model.TractionTable)
    assert traction.traction == (1e6, 0.0, -2e6)
    assert isinstance(nodal, model.NodalForceTable)
    assert nodal.force == (0.0, 4.0, 0.0)
    assert isinstance(gravity, model.GravityTable)
    assert (gravity.name, gravity.acceleration) == ("d", (0.0, -9.81, 0.0))
    assert gravity.amplitude == (0.0, 1.0)
    checker, grid = body.paints
    assert isinstance(checker, model.CheckerTable)
    assert (checker.cell, checker.columns, checker.rows) == (0.007, 9, 6)
    assert checker.origin == (0.001, 0.002, 0.03)
    assert isinstance(grid, model.DotsTable)
    assert (grid.diameter, grid.pitch, grid.dot) == (0.002, 0.005, 0.04)
    assert isinstance(scene.lights[0], model.PointTable) and scene.lights[0].shadows
    assert Scene.from_document(tomllib.loads(scene.to_toml())) == scene


def test_digest_depends_on_content_alone(crane: Scene, checkout: Path, tmp_path: Path) -> None:
    solve = ("material", "body.*.mesh", "body.*.support", "body.*.load")
    base = crane.digest(*solve)
    assert len(base) == 64
    assert crane.replace("camera.front.focal_mm", 35).digest(*solve) == base
    assert crane.replace("body.crane.paint.beam.albedo", 0.2).digest(*solve) == base
    assert crane.replace("body.crane.mesh.width_mm", 41).digest(*solve) != base
    assert crane.replace("material.steel.poissons_ratio", 0.29).digest(*solve) != base
    assert crane.digest("camera.front") != crane.digest("camera")
    assert crane.digest("light.lamp-far") == (
        crane.replace("light.lamp-near.power_W", 61).digest("light.lamp-far")
    )
    # the way it is written doesn't matter
    text = (checkout / "examples" / "crane.toml").read_text(encoding="utf-8")
    other = tmp_path / "other.toml"
    other.write_text("# more words\n" + text.replace("= 562.0 ", "= 5.62e2 "), encoding="utf-8")
    assert load_scene(other) == crane
    assert load_scene(other).digest() == crane.digest()


def test_tables_agree_with_the_modules_behind_them(crane: Scene) -> None:
    """The scene is read without loading meshes or writers; what it knows of them must be true."""
    crane_mesh = grids.crane()
    box_mesh = grids.box((1.0, 2.0, 3.0), (2, 3, 4))
    for name, mesh in (("crane", crane_mesh), ("box", box_mesh)):
        assert set(SETS[name]) == {*mesh.node_sets, *mesh.face_sets}
    schema = json_schema()["$defs"]["OutputTable"]["properties"]["truth"]["items"]
    assert set(schema["enum"]) == set(LAYERS)
    defs = json_schema()["$defs"]
    names = defs["SolverTable"]["properties"]["method"]["enum"]
    assert set(names) == set(METHODS)
    formulations = defs["BodyTable"]["properties"]["formulation"]["enum"]
    known = dict.fromkeys(name for e in ELEMENTS.values() for name in e.formulations)
    assert formulations[0] == ELEMENTS["hex8"].formulations[0] and set(formulations) == set(known)
    recipe = crane.bodies[0].mesh
    _, elements = element_counts(recipe)
    assert elements == pytest.approx(len(crane_mesh.cells["hex8"]), rel=0.01)
    box = model.BoxMeshTable(builder="box", size_mm=[1e3, 2e3, 3e3], divisions=[2, 3, 4])
    assert element_counts(box)[1] == len(box_mesh.cells["hex8"])


def test_json_schema_describes_every_key() -> None:
    schema = json_schema()
    json.dumps(schema)
    camera = schema["$defs"]["CameraTable"]
    assert camera["additionalProperties"] is False
    assert "optical axis" in camera["properties"]["target_mm"]["description"]
    assert schema["required"] == ["schema", "name"]


def test_key_lines() -> None:
    text = (
        'a = 1\n[[b]]\nx = 1\n[[b.c]]\ny = """\n[no]\nz = 1\n"""\n'
        "[[b]]\n[b.d] # note\n[[b.c]]\ny.k = 2\n"
    )
    lines = key_lines(text)
    assert lines[("a",)] == "line 1"
    assert lines[("b", 0, "x")] == "line 3"
    assert lines[("b", 0, "c", 0, "y")] == "line 5"
    assert lines[("b", 1)] == "line 9"
    assert lines[("b", 1, "d")] == "line 10"
    assert lines[("b", 1, "c", 0, "y", "k")] == "line 12"
    assert ("no",) not in lines
