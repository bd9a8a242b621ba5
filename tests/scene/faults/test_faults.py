"""Everything that is wrong with a scene is told at once, with its key, and nothing passes."""

from __future__ import annotations

import copy
import tomllib
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from gpusim.errors import Fault, SceneError
from gpusim.optics.calibration.formats import FORMATS
from gpusim.scene import Scene, load_scene

Document = dict[str, Any]


def repr_short(value: object) -> str:
    return repr(value)[:12]


@pytest.fixture(scope="module")
def crane(checkout: Path) -> Document:
    return tomllib.loads((checkout / "examples" / "crane.toml").read_text(encoding="utf-8"))


def faults(document: Document, **overrides: Any) -> dict[str, Fault]:
    """Faults by key path."""
    with pytest.raises(SceneError) as caught:
        Scene.from_document(document, overrides=overrides)
    found = caught.value.faults
    assert len({fault.key for fault in found}) == len(found), "a fault told twice"
    return {fault.key: fault for fault in found}


def with_value(document: Document, path: str, value: Any) -> Document:
    """A copy with one key set (or deleted with ``...``), without gpusim's own path code."""
    changed = copy.deepcopy(document)
    here: Any = changed
    *keys, last = [int(key) if key.isdecimal() else key for key in path.split(".")]
    for key in keys:
        here = here[key]
    if value is ...:
        del here[last]
    else:
        here[last] = value
    return changed


def test_three_typos_are_all_told_with_line_and_nearest_key(tmp_path: Path, checkout: Path) -> None:
    text = (checkout / "examples" / "crane.toml").read_text(encoding="utf-8")
    for right, wrong in (
        ("focal_mm", "focal_m"),
        ("albedo = 0.55", "albeido = 0.55"),
        ("tolerance = 1e-6", "tolerence = 1e-6"),
    ):
        assert text.count(right) == 1
        text = text.replace(right, wrong)
    path = tmp_path / "typos.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    found = {fault.key: fault for fault in caught.value.faults}
    assert set(found) == {"camera.0.focal_m", "prop.0.paint.0.albeido", "solver.tolerence"}
    assert found["camera.0.focal_m"].hint == "did you mean focal_mm?"
    assert found["prop.0.paint.0.albeido"].hint == "did you mean albedo?"
    assert found["solver.tolerence"].hint == "did you mean tolerance?"
    lines = text.splitlines()
    for key, fault in found.items():
        number = int(fault.problem.split("(line ")[1].rstrip(")"))
        assert lines[number - 1].startswith(key.split(".")[-1]), fault
    assert str(caught.value).startswith(f"{path}: 3 faults\n")


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text('schema = 1\nname = "x\n', encoding="utf-8")
    latin = tmp_path / "latin.toml"
    latin.write_bytes('name = "Größe"'.encode("latin-1"))
    for path, problem in (
        (tmp_path / "none.toml", "not found"),
        (tmp_path, "is a folder"),
        (latin, "not a text"),
    ):
        with pytest.raises(SceneError) as caught:
            load_scene(path)
        assert [fault.problem for fault in caught.value.faults] == [problem]
    with pytest.raises(SceneError, match=r"not TOML.*line 2"):
        load_scene(broken)


@pytest.mark.parametrize(
    ("path", "value", "key", "said"),
    [
        # wrong types: nothing is coerced
        ("camera.0.focal_mm", "30", "camera.0.focal_mm", "wrong type"),
        ("camera.0.focal_mm", True, "camera.0.focal_mm", "wrong type"),
        ("camera.0.resolution_px.1", 3744.5, "camera.0.resolution_px.1", "wrong type"),
        ("camera", {}, "camera", "wrong type"),
        ("solver", [], "solver", "wrong type"),
        ("output.vtu", 1, "output.vtu", "wrong type"),
        ("name", 3, "name", "wrong type"),
        ("body.0.support.0.where", "foot", "body.0.support.0.where", "wrong type"),
        # NaN and infinity
        ("camera.0.focal_mm", float("nan"), "camera.0.focal_mm", "wrong type"),
        ("body.0.load.0.force_N.2", float("inf"), "body.0.load.0.force_N.2", "wrong type"),
        ("analysis.load_factors.1", float("nan"), "analysis.load_factors.1", "wrong type"),
        ("sensor.exposure", float("nan"), "sensor.exposure", "wrong type"),
        ("sensor.exposure", float("inf"), "sensor.exposure", "wrong type"),
        # sizes whose products overflow
        ("body.0.load.0.force_N.2", 1e200, "body.0.load.0.force_N", "out of any range"),
        ("body.0.load.0.force_N.1", -1e-200, "body.0.load.0.force_N", "out of any range"),
        ("material.0.youngs_modulus_GPa", 1e100, "material.0.youngs_modulus_GPa", "out of any"),
        # ranges
        ("camera.0.focal_mm", 0.0, "camera.0.focal_mm", "out of range"),
        ("camera.0.sensor_mm.0", -36.0, "camera.0.sensor_mm.0", "out of range"),
        ("material.0.poissons_ratio", 0.5, "material.0.poissons_ratio", "out of range"),
        ("material.0.youngs_modulus_GPa", 0, "material.0.youngs_modulus_GPa", "out of range"),
        ("material.0.youngs_modulus_GPa", "210", "material.0.youngs_modulus_GPa", "wrong type"),
        ("body.0.paint.0.albedo", 1.01, "body.0.paint.0.albedo", "out of range"),
        ("solver.tolerance", 0.0, "solver.tolerance", "out of range"),
        ("light.0.power_W", 0.0, "light.0.power_W", "out of range"),
        ("prop.0.size_mm.1", 0.0, "prop.0.size_mm.1", "out of range"),
        ("body.0.mesh.through", 0, "body.0.mesh.through", "out of range"),
        ("sensor.exposure", 0, "sensor.exposure", "out of range"),
        ("sensor.bits", 11, "sensor.bits", "unknown value"),
        ("camera.0.up", [0.0, 1.0], "camera.0.up", "wrong length"),
        ("analysis.load_factors", [], "analysis.load_factors", "wrong length"),
        # missing
        ("camera.0.position_mm", ..., "camera.0.position_mm", "missing"),
        ("schema", ..., "schema", "missing"),
        ("body.0.load.0.type", ..., "body.0.load.0.type", "missing"),
        ("body.0.mesh.builder", ..., "body.0.mesh.builder", "missing"),
        ("body.0.paint", [], "body.0.paint", "wrong length"),
        # unknown
        ("schema", 2, "schema", "unknown value"),
        ("body.0.mesh.builder", "cran", "body.0.mesh.builder", "unknown value"),
        ("light.1.type", "laser", "light.1.type", "unknown value"),
        ("output.truth.2", "dept", "output.truth.2", "unknown value"),
        ("body.0.load.0.where.normal", "z", "body.0.load.0.where.normal", "unknown value"),
        ("light.0.power_lm", 3.0, "light.0.power_W", "how strong"),
        ("camera.0.name", "a/b", "camera.0.name", "not a usable name"),
        ("camera.0.name", "../b", "camera.0.name", "not a usable name"),
        # between the keys of a table
        ("camera.0.resolution_px.0", 5000, "camera.0.resolution_px", "aren't square"),
        ("camera.0.target_mm", [300.0, -1020.0, 290.0], "camera.0.target_mm", "is where"),
        ("camera.0.up", [0.0, -3.0, 0.0], "camera.0.up", "along the view"),
        ("camera.0.up", [0.0, 0.0, 0.0], "camera.0.up", "no direction"),
        ("light.0.target_mm", [-500.0, -2000.0, 100.0], "light.0.target_mm", "is where"),
        ("prop.0.up", [0.0, 2.0, 0.0], "prop.0.up", "along the normal"),
        ("prop.0.normal", [0.0, 0.0, 0.0], "prop.0.normal", "no direction"),
        ("prop.0.paint.0.where", {"normal": "-y"}, "prop.0.paint.0.where", "one face"),
        ("prop.0.paint.0.positions_mm.3.1", 149.0, "prop.0.paint.0.positions_mm.3", "off the"),
        ("prop.0.paint.0.positions_mm.4.0", 1198.0, "prop.0.paint.0.positions_mm.4", "edge"),
        ("prop.0.paint.0.positions_mm.4.2", -358.0, "prop.0.paint.0.positions_mm.4", "edge"),
        ("body.0.paint.1.positions_mm", [[3.0, -20.0, 9.0]], "body.0.paint.1.positions_mm", "both"),
        ("body.0.paint.1.line", ..., "body.0.paint.1.positions_mm", "neither"),
        ("body.0.paint.1.line.count", 100, "body.0.paint.1.line", "overlap"),
        ("body.0.paint.1.up", [0.0, 1.0, 0.0], "body.0.paint.1.up", "along the normal"),
        ("body.0.support.0.where", {}, "body.0.support.0.where", "whole body"),
        ("body.0.support.0.fix", ["x", "x"], "body.0.support.0.fix", "twice"),
        ("body.0.load.0.where.x_max_mm", 4.0, "body.0.load.0.where.x_min_mm", "empty range"),
        ("body.0.mesh.length_mm", 110.0, "body.0.mesh.length_mm", "too short"),
        ("measure.0.subset_px", 20, "measure.0.subset_px", "even"),
        ("measure.0.groups", ["beam", "beam"], "measure.0.groups", "twice"),
        ("output.truth", ["flow", "flow"], "output.truth", "twice"),
        # between tables
        ("body.0.material", "stel", "body.0.material", "no such material"),
        ("body.0.support.0.where.set", "fot", "body.0.support.0.where.set", "no such set"),
        ("measure.0.camera", "back", "measure.0.camera", "no such camera"),
        ("measure.0.groups.1", "steel", "measure.0.groups.1", "no such markers"),
        ("measure.0.static.0", "beam", "measure.0.static.0", "no such markers"),
        ("measure.0.direction", "+y", "measure.0.direction", "along the camera's view"),
        ("light.1.name", "Lamp-Near", "light.1.name", "name used twice"),
        ("body.0.paint.2.name", "steel", "body.0.paint.2.name", "name used twice"),
        ("prop.0.paint.0.name", "beam", "prop.0.paint.0.name", "name used twice"),
        ("prop.0.name", "crane", "prop.0.name", "name used twice"),
        ("body.0.support", [], "body.0.support", "not held"),
        ("analysis.load_factors", [1.0], "analysis.load_factors", "too few frames to measure in"),
    ],
)  # fmt: skip
def test_each_fault_is_found(crane: Document, path: str, value: Any, key: str, said: str) -> None:
    found = faults(with_value(crane, path, value))
    assert key in found, list(found)
    fault = found[key]
    assert said in f"{fault.problem} {fault.got}", fault


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("body.0.material", ["stel"]),
        ("body.0.support.0.where.set", ["fot"]),
        ("measure.0.groups", [["beam"]]),
    ],
)
def test_a_list_too_many_is_one_fault(crane: Document, path: str, value: Any) -> None:
    (fault,) = faults(with_value(crane, path, value)).values()
    assert "wrong type" in fault.problem


def test_no_measure_is_called_as_files_of_another_one(crane: Document) -> None:
    """measure/field-statistics.csv was written twice."""
    places = {"camera": "front", "points_px": [[100.0, 80.0]], "type": "point"}
    names = "Field-Statistics", "field2-statistics"
    measures = [{"name": "field", "type": "dic", "camera": "front"},
                *({"name": name, **places} for name in names)]  # fmt: skip
    (fault,) = faults({**crane, "measure": [*crane["measure"], *measures]}).values()
    assert 'files of measure "field" are called so' in fault.problem and "Field-S" in fault.got


@pytest.mark.parametrize(
    ("path", "value", "hint"),
    [
        ("light.0.type", "aera", "did you mean area?"),
        ("body.0.load.0.type", "presure", "did you mean pressure?"),
        ("output.truth.0", "refrence", "did you mean reference?"),
        ("body.0.material", "steal", "did you mean steel?"),
        ("measure.0.camera", "frnt", "did you mean front?"),
        ("body.0.support.0.where.set", "fot", "did you mean foot?"),
    ],
)
def test_hints(crane: Document, path: str, value: str, hint: str) -> None:
    assert [fault.hint for fault in faults(with_value(crane, path, value)).values()][:1] == [hint]


def test_a_variant_reports_only_its_own_faults(crane: Document) -> None:
    changed = with_value(crane, "body.0.load.0", {"name": "p", "type": "pressure", "where": {}})
    found = faults(changed)
    assert set(found) == {"body.0.load.0.pressure_MPa"}
    changed = with_value(crane, "light.0.type", "point")
    assert set(faults(changed)) == {"light.0.target_mm", "light.0.size_mm"}


def test_the_wrong_unit_is_told_once_with_the_right_one(crane: Document) -> None:
    changed = with_value(crane, "material.0.youngs_modulus_GPa", ...)
    changed["material"][0]["youngs_modulus_MPa"] = 210000.0
    found = faults(changed)
    assert set(found) == {"material.0.youngs_modulus_MPa"}
    assert found["material.0.youngs_modulus_MPa"].hint == "did you mean youngs_modulus_GPa?"


def test_schema_and_reference_faults_come_together(crane: Document) -> None:
    changed = with_value(crane, "sensor.bits", 9)
    changed["measure"][0]["camera"] = "nobody"
    changed["light"][1]["name"] = "lamp-near"
    assert set(faults(changed)) == {"sensor.bits", "measure.0.camera", "light.1.name"}


def test_lamps_that_cast_shadows_are_counted(crane: Document) -> None:
    lamp = {"type": "point", "position_mm": [0.0, -900.0, 500.0], "power_W": 3.0}
    plain = [lamp | {"name": f"plain-{k}", "shadows": False} for k in range(40)]
    casting = [lamp | {"name": f"led-{k}"} for k in range(33)]
    sky = {"name": "sky", "type": "ambient", "radiance_W_m2_sr": 1.0}
    Scene.from_document(with_value(crane, "light", [sky, *plain, *casting[:32]]))
    ((key, fault),) = faults(with_value(crane, "light", [sky, *plain, *casting])).items()
    assert (key, fault.got, fault.expected) == ("light.73", "33", "at most 32")
    assert "shadows = false" in fault.hint


def test_gravity_needs_density(crane: Document) -> None:
    gravity = {"name": "own", "type": "gravity"}
    changed = with_value(crane, "body.0.load.0", gravity)
    Scene.from_document(changed)
    del changed["material"][0]["density_kg_m3"]
    assert set(faults(changed)) == {"body.0.load.0"}


def test_support_moves_only_what_it_holds(crane: Document) -> None:
    changed = with_value(crane, "body.0.support.0.fix", ["z"])
    changed["body"][0]["support"][0]["displacement_mm"] = [0.0, 0.0, -5.0]
    assert Scene.from_document(changed).bodies[0].supports[0].fix == ("z",)
    changed["body"][0]["support"][0]["displacement_mm"] = [1.0, 0.0, -5.0]
    assert set(faults(changed)) == {"body.0.support.0.displacement_mm"}


def test_a_support_holds_all_directions_unless_it_says_which(crane: Document) -> None:
    changed = with_value(crane, "body.0.support.0.fix", ...)
    assert Scene.from_document(changed).bodies[0].supports[0].fix == ("x", "y", "z")


def test_cameras_beyond_what_a_calibration_file_takes(crane: Document) -> None:
    most = FORMATS["dice"].most
    camera = crane["camera"][0]
    changed = with_value(crane, "output.calibration", ["opencv", "dice"])
    changed["camera"] += [{**camera, "name": f"more-{k}"} for k in range(most - 1)]
    assert len(Scene.from_document(changed).cameras) == most
    changed["camera"].append({**camera, "name": "last"})
    ((key, fault),) = faults(changed).items()
    assert key == "output.calibration" and fault.got == f"{most + 1} cameras"
    assert fault.expected == f"at most {most}"


def test_pixels_that_are_not_square_can_be_stated(crane: Document) -> None:
    changed = with_value(crane, "camera.0.resolution_px", [5616, 3000])
    changed["camera"][0]["square_pixels"] = False
    assert Scene.from_document(changed).cameras[0].resolution == (5616, 3000)


def test_an_empty_scene_and_a_wrong_root() -> None:
    assert set(faults({"schema": 1, "name": "empty"})) == {"body"}
    assert set(faults({})) == {"schema", "name", "body"}


def test_overrides_that_lead_nowhere(crane: Document) -> None:
    with pytest.raises(SceneError) as caught:
        Scene.from_document(
            crane,
            overrides={
                "camera.frnt.focal_mm": 31,
                "name.first": "x",
                "solver..tolerance": 1,
                "body.3.name": "x",
                "solver.tolerence": 1e-7,
            },
        )
    found = {fault.key: fault for fault in caught.value.faults}
    assert set(found) == {
        "camera.frnt",
        "name",
        "solver..tolerance",
        "body.3",
        "solver.tolerence",
    }
    assert found["camera.frnt"].hint == "did you mean front?"
    assert found["solver.tolerence"].hint == "did you mean tolerance?"


def test_an_overridden_value_is_not_blamed_on_a_line(checkout: Path) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(
            checkout / "examples" / "crane.toml",
            {"camera.front.focal_mm": -1, "body.crane.paint.beam.line": {"start_mm": [0, 0, "x"]}},
        )
    problems = {fault.key: fault.problem for fault in caught.value.faults}
    assert problems["camera.0.focal_mm"] == "out of range (overridden)"
    assert problems["body.0.paint.2.line.start_mm.2"] == "wrong type (overridden)"
    assert len(problems) == 4


@pytest.mark.parametrize(
    "junk",
    [None, 3, "x", [], {}, [1], [[]], [{}], {"a": 1}, True, -1e300, 10**400, date(2021, 9, 9)],
    ids=repr_short,
)
def test_junk_anywhere_ends_in_a_scene_error_or_a_scene(crane: Document, junk: Any) -> None:
    def paths(node: Any, prefix: str = "") -> list[str]:
        pairs = node.items() if isinstance(node, dict) else enumerate(node)
        found = []
        for key, value in pairs:
            found.append(f"{prefix}{key}")
            if isinstance(value, dict | list):
                found += paths(value, f"{prefix}{key}.")
        return found

    for path in paths(crane):
        try:
            scene = Scene.from_document(with_value(crane, path, junk))
        except SceneError as error:
            assert error.faults, path
        else:
            assert "nan" not in scene.content.lower(), path


@pytest.mark.parametrize("size", [1e21, float("inf")])
def test_a_prop_too_large_for_what_is_on_it_is_a_fault(crane: Document, size: float) -> None:
    found = faults(with_value(crane, "prop.0.size_mm", [size, 400.0]))
    (fault,) = (one for key, one in found.items() if key.startswith("prop.0.size_mm"))
    assert repr(size)[:3] in fault.got
