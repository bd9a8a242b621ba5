"""What a newcomer reads: names in place of indices, and what the schema really wants."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.mesh import box
from gpusim.scene import Scene, json_schema, load_scene
from gpusim.scene.faults.schema_places import expected


@pytest.fixture(scope="module")
def crane(checkout: Path) -> Scene:
    return load_scene(checkout / "examples" / "crane.toml")


def told(scene: Scene, path: str, value: Any) -> str:
    """What is told of the scene with one value changed, or removed with ``...``."""
    document = scene.document
    here: Any = document
    *keys, last = [int(key) if key.isdecimal() else key for key in path.split(".")]
    for key in keys:
        here = here[key]
    if value is ...:
        del here[last]
    else:
        here[last] = value
    with pytest.raises(SceneError) as caught:
        Scene.from_document(document)
    return str(caught.value)


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("prop.0.paint.0.albedo", ..., "prop.wall.paint.static.albedo: missing; got neither "
         "albedo nor color; expected a number from 0 to 1, or a colour (of the ground, outside"),
        ("body.0.paint.1.albedo", "#c0a08", 'paint.column.albedo: unknown value; got "#c0a08"; '
         'expected a number from 0 to 1, a list of 3 numbers from 0 to 1 (red, green, blue), '
         'or a text like "#c0a080"'),
        ("body.0.paint.1.color", 0.4, "body.crane.paint.column.color: beside albedo, which is the "
         "same; got 0.4; expected one of them"),
        ("body.0.paint.1.colour", 0.4, "column.colour: unknown key (did you mean color?)"),
        ("body.0.paint.1.albedo", [0.1, 0.2], "column.albedo: wrong length; got 2 items; expected"),
        ("body.0.paint.1.albedo", [0.1, 0.2, 1.5], "albedo: out of range; got [0.1, 0.2, 1.5]"),
        ("body.0.paint.1.albedo", [0.1, 0.2, True], "albedo: wrong type; got [0.1, 0.2, true]"),
        ("light.0.temperature_K", 700.0, "light.lamp-near.temperature_K: out of range; got 700.0; "
         "expected a number from 800 to 40000"),
        ("light.0.temperature", 3000.0, "temperature: unknown key (did you mean temperature_K?)"),
        ("light.0.color", "#000000", "light.lamp-near.color: no light at all; got \"#000000\""),
        ("render.background", [0.1, -0.2, 0.1], "render.background: out of range; got [0.1, -0.2, "
         "0.1]; expected a number >= 0, a list of 3 numbers >= 0 (red, green, blue), or"),
        ("material.0.youngs_modulus_GPa", ..., "material.steel.youngs_modulus_GPa: missing; "
         "expected a number > 0, or a list of 3 numbers > 0 (orthotropic: [E1, E2, E3] along"),
        ("camera.0.name", ..., "camera.0.name: missing; expected a name of letters, digits"),
        ("schema", ..., "schema: missing; expected 1 (version of the scene format)"),
        ("body.0.paint", ..., "body.crane.paint: missing; expected one table or more (a face"),
        ("analysis.type", "dynamic", 'analysis.type: unknown value; got "dynamic"; expected '
         '"static" (equilibrium), or "field" (displacements that are given), or "modal" (natural '
         'frequencies and mode shapes), or "transient" (motion in time), or "harmonic" (steady '
         'vibration under loads that swing, or on a shaker), or "buckling" (critical load '
         "factors); what another program has solved goes into [body.field] file, or `gpusim "
         "render --field FILE`"),
        ("analysis.geometry", "nonlinaer", 'analysis.geometry: unknown value; got "nonlinaer"; '
         'expected one of "auto", "linear", "nonlinear" (did you mean nonlinear?)'),
        ("load", [{"name": "pull"}], "load: unknown key (did you mean body.load?)"),
        ("video", {"format": "mp4"}, "video: no such key yet (pictures are files; `ffmpeg "),
        ("analysis.type", "statik", 'analysis.type: unknown value; got "statik"; expected'),
        ("analysis.type", ["static"], 'analysis.type: unknown value; got ["static"]; expected'),
        ("camera.0.position_mm", 3.0, "camera.front.position_mm: wrong type; got 3.0; expected a "
         "list of 3 numbers"),
        ("camera.0.calibration_camera", 1.5, "calibration_camera: wrong type; got 1.5; expected a "
         "text, or a whole number >= 0"),
        ("camera.0.up", [], "camera.front.up: wrong length; got no items; expected 3 items"),
        ("body.0.load.0.force_N", "3", "force_N: wrong type; got \"3\"; expected a list of 3 "
         "numbers without quotes; its unit is in the key"),
        ("light.0.power_W", ..., "how strong the lamp is must be said once; got neither; expected"),
        ("body.0.support", ..., "body.crane.support: loaded but not held; got no support;"),
        ("material.0.poissons_ratio", [0.3], "wrong length; got 1 items; expected a number, or"),
        ("material.0.poissons_ratio", True, "wrong type; got true; expected a number, or a list"),
        ("name", "", "name: empty; expected a text"),
        ("name", "x" * 300, "name: too long; got 300 letters; expected at most 200"),
        ("camera.0.sensor_mm", None, "camera.front.sensor_mm: needed with focal_mm; got nothing"),
    ],
)  # fmt: skip
def test_a_line_of_the_message(crane: Scene, path: str, value: Any, line: str) -> None:
    assert line in told(crane, path, value)


def test_a_union_is_told_once(crane: Scene) -> None:
    assert told(crane, "camera.0.calibration_camera", 1.5).count("calibration_camera") == 1


def test_names_that_are_not_clear_stay_indices(crane: Scene) -> None:
    document = crane.document
    second = {**document["camera"][0], "focal_mm": -1.0}
    document["camera"].append(second)
    with pytest.raises(SceneError, match=r"camera\.1\.focal_mm: out of range") as caught:
        Scene.from_document(document)
    assert "camera.1.name: name used twice" in str(caught.value)


def test_every_key_has_words_for_what_it_wants() -> None:
    schema = json_schema()
    words = {
        (name, key): expected(value)
        for name, table in {**schema["$defs"], "SceneTable": schema}.items()
        for key, value in table["properties"].items()
    }
    assert len(words) > 200 and all(words.values())
    assert not [text for text in words.values() if re.search(r"None|\$|inf|e\+18|dict", text)]
    assert words["CameraTable", "rotation_matrix"] == "a list of 3 lists of 3 numbers"
    assert words["SupportTable", "fix"] == 'a list of some of "x", "y", "z"'
    assert words["SpeckleTable", "coverage"] == "a number > 0 and < 1"
    assert words["SceneTable", "schema"] == "1"
    shade = (
        "a number from 0 to 1, a list of 3 numbers from 0 to 1 (red, green, blue), "
        'or a text like "#c0a080"'
    )
    assert words["PlainTable", "color"] == words["DotsTable", "dot"] == shade


def test_a_model_takes_one_material() -> None:
    mesh = box((0.3, 0.2, 0.1), (2, 1, 1))
    steel = gs.Isotropic(210e9, 0.3)
    assert gs.Model(mesh, steel).materials == (steel,)  # type: ignore[arg-type]
    for wrong, said in ((gs.Isotropic, "got the class Isotropic"), ([], "got none"), (3, "got int"),
                        ([gs.Isotropic], r"materials\[0\]; got the class Isotropic")):  # fmt: skip
        with pytest.raises(InputError, match=said):
            gs.Model(mesh, wrong)  # type: ignore[arg-type]


def test_a_body_too_thin_to_be_held() -> None:
    mesh = box((0.1, 0.04, 1e-12), (3, 2, 1))
    held = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    model = gs.Model(mesh, [gs.Isotropic(210e9, 0.3)], fixed=held)
    with pytest.raises(InputError, match=r"too thin.*got sides of 0\.1 x 0\.04 x 1e-12; expected"):
        gs.solve(model)
