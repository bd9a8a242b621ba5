"""Parts of a scene: what a stage gets, and digests of all that it can read there."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from gpusim.pipeline.scene_objects.meshing import build_mesh
from gpusim.scene import Scene
from gpusim.scene.part import SceneParts
from tests.support.every_table import everything, write_inputs

WHOLE = {
    "name": "name", "analysis": "analysis", "solver": "solver", "light": "lights",
    "render": "render", "sensor": "sensor", "camera": "cameras", "prop": "props", "body": "bodies",
    "calibration": "calibration", "output": "output", "measure": "measures", "variant": "variants",
}  # fmt: skip
SECTIONS = (
    *WHOLE, "camera.left", "camera.right", "camera.blurred", "body.bar", "body.bar.mesh",
    "body.bar.paint", "body.bar.solid", "body.bar.formulation", "body.bar.name", "body.block",
    "body.block.mesh",
    "body.block.paint", "body.block.solid", "body.*.mesh", "body.*.name", "prop.still",
    "body.*.mechanics", "sensor.response", "output.truth", "output.meshes",
    "output.calibration", "measure.tip",
    "measure.space", "light.lamp",
)  # fmt: skip
"""All that stages name, each by itself."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("inputs")
    write_inputs(place)
    return place


def scene_of(folder: Path, change: Callable[[dict[str, Any]], object] | None = None) -> Scene:
    document = everything()
    if change is not None:
        change(document)
    return Scene.from_document(document, folder=folder)


def digests(scene: Scene) -> dict[str, str]:
    parts = SceneParts(scene)
    return {section: parts.of(section).digests[section] for section in SECTIONS}


def changed(before: Scene, after: Scene) -> set[str]:
    one, two = digests(before), digests(after)
    return {section for section in SECTIONS if one[section] != two[section]}


@pytest.mark.parametrize("section", WHOLE)
def test_a_part_has_nothing_else(folder: Path, section: str) -> None:
    scene = scene_of(folder)
    part = SceneParts(scene).of(section).scene
    if section != "camera":  # which are without their own sensors
        assert getattr(part, WHOLE[section]) == getattr(scene, WHOLE[section])
    for name in {*WHOLE.values()} - {WHOLE[section]}:
        with pytest.raises(AttributeError):
            getattr(part, name)
    for name in ("document", "tables"):
        with pytest.raises(AttributeError):
            getattr(part, name)


def test_what_is_made_of_several_sections_needs_them(folder: Path) -> None:
    parts = SceneParts(scene_of(folder))
    with pytest.raises(AttributeError):
        _ = parts.of("camera", "sensor").scene.measures_space
    with pytest.raises(AttributeError):
        parts.of("camera.right").scene.sensor_of("right")
    both = parts.of("camera.right", "sensor").scene
    assert both.sensor_of("right").bits == 10


@pytest.mark.parametrize(
    ("section", "known"),
    [("mesh", {"mesh"}), ("paint", {"paints"}), ("name", set()), ("formulation", {"formulation"}),
     ("solid", {"material", "parts", "formulation", "supports", "ties", "loads"})],
)  # fmt: skip
def test_a_body_has_one_section_alone(folder: Path, section: str, known: set[str]) -> None:
    scene = scene_of(folder)
    (body,) = SceneParts(scene).of(f"body.bar.{section}").scene.bodies
    whole = scene.bodies[0]
    assert body.name == "bar"
    for name in ("mesh", "paints", "material", "parts", "formulation", "supports", "ties", "loads"):
        if name in known:
            assert section == "solid" or getattr(body, name) == getattr(whole, name)
        else:
            with pytest.raises(AttributeError):
                getattr(body, name)


def test_sections_of_bodies_come_together(folder: Path) -> None:
    part = SceneParts(scene_of(folder)).of("body.*.mesh", "body.*.paint").scene
    assert [body.name for body in part.bodies] == ["bar", "block"]
    assert all(body.mesh and body.paints for body in part.bodies)


def test_names_that_there_are_not(folder: Path) -> None:
    parts = SceneParts(scene_of(folder))
    for section in ("camera.unknown", "body.unknown.mesh", "unknown", "body.bar.unknown"):
        with pytest.raises(KeyError):
            parts.of(section)


def set_at(*path: Any) -> Callable[[dict[str, Any]], None]:
    """Changes one place of a document; the value comes last."""
    *above, last, value = path

    def change(document: dict[str, Any]) -> None:
        table: Any = document
        for name in above:
            table = table[name]
        table[last] = value

    return change


BAR, MESHES = {"body", "body.bar"}, {"body.*.mesh"}
MOVING = BAR | {"body.*.mechanics"}
SOLID = MOVING | {"body.bar.solid"}
CHANGES: Mapping[str, tuple[Callable[[dict[str, Any]], None], set[str]]] = {
    "name": (set_at("name", "other"), {"name"}),
    "description": (set_at("description", "other"), set()),
    "factor": (set_at("analysis", "load_factors", [0.0, 0.5, 2.0]),
               {"analysis", *MOVING, "body.block"}),
    "rate": (set_at("analysis", "frame_rate_Hz", 60.0), {"analysis"}),
    "tolerance": (set_at("solver", "tolerance", 1e-7), {"solver"}),
    "lamp": (set_at("light", 0, "power_W", 61.0), {"light", "light.lamp"}),
    "sky": (set_at("light", 1, "sky_W_m2_sr", 2.0), {"light"}),
    "error": (set_at("render", "error", 0.5), {"render"}),
    "background": (set_at("render", "background", 0.1), {"render"}),
    "seed": (set_at("sensor", "seed", 4), {"sensor"}),
    "series": (set_at("sensor", "series", 4), {"sensor"}),
    "noise": (set_at("sensor", "read_noise_e", 6.0), {"sensor", "sensor.response"}),
    "exposure": (set_at("sensor", "exposure", 0.1), {"sensor", "sensor.response"}),
    "preset": (set_at("sensor", "preset", "imx174"), {"sensor", "sensor.response"}),
    "format": (set_at("sensor", "format", "tiff"), {"sensor", "sensor.response"}),
    "focal": (set_at("camera", 0, "focal_mm", 51.0), {"camera", "camera.left"}),
    "place": (set_at("camera", 1, "position_mm", [231.0, -480.0, 30.0]), {"camera",
                                                                          "camera.right"}),
    "distortion": (set_at("camera", 1, "distortion", [-0.03, 0.01, 0.0, 0.0]), {"camera",
                                                                                "camera.right"}),
    "shutter": (set_at("camera", 1, "shutter", "exposure_ms", 3.0), {"camera", "camera.right"}),
    "lens": (set_at("camera", 2, "lens", "f_number", 4.0), {"camera", "camera.blurred"}),
    "prop": (set_at("prop", 0, "size_mm", [410.0, 200.0]), {"prop", "prop.still"}),
    "prop's paint": (set_at("prop", 2, "paint", 0, "cell_mm", 14.0), {"prop", "prop.still"}),
    "prop's pose": (set_at("prop", 1, "poses", 1, "rotation_deg", [1.0, 0.0, 0.0]), {"prop"}),
    "board's pose": (set_at("calibration", "pose", 0, "rotation_deg", [1.0, 0.0, 0.0]),
                     {"calibration"}),
    "mesh": (set_at("body", 0, "mesh", "divisions", [10, 2, 1]), BAR | MESHES | {"body.bar.mesh"}),
    "paint": (set_at("body", 0, "paint", 0, "albedo", 0.5), BAR | {"body.bar.paint"}),
    "marker": (set_at("body", 0, "paint", 1, "size_mm", 6.5), BAR | {"body.bar.paint"}),
    "force": (set_at("body", 0, "load", 0, "force_N", [0.0, 0.0, -51.0]), SOLID),
    "amplitude": (set_at("body", 0, "load", 1, "amplitude", [0.0, 0.5, 1.0]), MOVING),
    "support": (set_at("body", 0, "support", 0, "fix", ["x", "z"]), SOLID),
    "formulation": (set_at("body", 0, "formulation", "full"),
                    SOLID | {"body.bar.formulation"}),
    "material": (set_at("material", 0, "youngs_modulus_GPa", 71.0),
                 SOLID | {"body.block", "body.block.solid"}),
    "other body": (set_at("body", 1, "mesh", "size_mm", [21.0, 20.0, 20.0]),
                   {"body", "body.block", "body.block.mesh"} | MESHES),
    "measure": (set_at("measure", 1, "direction", "-x"), {"measure", "measure.tip"}),
    "stereo": (set_at("measure", 0, "lens", "radial"), {"measure", "measure.space"}),
    "vtu": (set_at("output", "vtu", False), {"output", "output.meshes"}),
    "calibration files": (set_at("output", "calibration", ["dice"]),
                          {"output", "output.calibration"}),
    "truth": (set_at("output", "truth", ["depth"]), {"output", "output.truth"}),
    "own sensor": (set_at("camera", 0, "sensor", "bits", 14), set()),  # the next test
}  # fmt: skip


@pytest.mark.parametrize("what", CHANGES)
def test_digests_tell_what_is_changed(folder: Path, what: str) -> None:
    change, sections = CHANGES[what]
    assert changed(scene_of(folder), scene_of(folder, change)) == sections


def of_left(scene: Scene, *sections: str) -> str:
    return SceneParts(scene).of("camera.left", *sections).digests["camera.left"]


@pytest.mark.parametrize(
    ("change", "alone", "response", "whole"),
    [
        (set_at("camera", 0, "sensor", "bits", 14), False, True, True),
        (set_at("sensor", "read_noise_e", 6.0), False, True, True),  # merged into its own
        (set_at("sensor", "seed", 4), False, False, True),
        (set_at("sensor", "series", 4), False, False, True),
        (set_at("camera", 0, "focal_mm", 51.0), True, True, True),
    ],
)
def test_a_camera_s_own_sensor_counts_where_sensors_are_named(
    folder: Path, change: Callable[[dict[str, Any]], None], alone: bool, response: bool, whole: bool
) -> None:
    """The merged sensor is a private value of the camera."""
    before, after = scene_of(folder), scene_of(folder, change)
    assert (of_left(before) != of_left(after)) == alone
    assert (of_left(before, "sensor.response") != of_left(after, "sensor.response")) == response
    assert (of_left(before, "sensor") != of_left(after, "sensor")) == whole
    part = SceneParts(after).of("camera.left", "sensor").scene
    assert part.sensor_of("left") == after.sensor_of("left")
    response_of = SceneParts(after).of("camera.left", "sensor.response").scene.sensor_of("left")
    assert (response_of.seed, response_of.series) == (0, 0)
    assert SceneParts(after).of("camera.left").scene.cameras[0].electronics is None
    assert after.cameras[0].electronics is not None  # the scene itself stays


def test_files_count_by_what_they_hold(folder: Path, tmp_path: Path) -> None:
    before, moved = scene_of(folder), tmp_path / "elsewhere"
    write_inputs(moved)
    assert changed(before, scene_of(moved)) == set()
    (moved / "wall.png").rename(moved / "other.png")
    renamed = scene_of(moved, set_at("prop", 0, "paint", 0, "file", "other.png"))
    assert changed(before, renamed) == set()
    data = bytearray((moved / "other.png").read_bytes())
    data += b"\0"
    (moved / "other.png").write_bytes(data)
    touched = scene_of(moved, set_at("prop", 0, "paint", 0, "file", "other.png"))
    assert changed(before, touched) == {"prop", "prop.still"}


def test_a_mesh_and_the_files_that_it_includes(tmp_path: Path) -> None:
    """A part reads them as the scene was loaded, and no other files."""
    nodes = "\n".join(f"{1 + x + 2 * y + 4 * z}, {x}, {y}, {z}"
                      for z in (0, 1) for y in (0, 1) for x in (0, 1))  # fmt: skip
    (tmp_path / "nodes.inp").write_text(nodes)
    (tmp_path / "bar.inp").write_text(
        "*NODE, INPUT=nodes.inp\n*INCLUDE, INPUT=cells.inp\n".replace(
            "*NODE, INPUT=nodes.inp\n", f"*NODE\n{nodes}\n"
        )
    )
    cells = tmp_path / "cells.inp"
    cells.write_text("*ELEMENT, TYPE=C3D8\n1, 1, 2, 4, 3, 5, 6, 8, 7\n")
    write_inputs(tmp_path)

    def with_file(document: dict[str, Any]) -> None:
        document["body"][1]["mesh"] = {"file": "bar.inp", "unit": "mm"}

    before = scene_of(tmp_path, with_file)
    part = SceneParts(before).of("body.block.mesh").scene
    (body,) = part.bodies
    assert build_mesh(body.mesh, part.input).cell_count == 1
    assert SceneParts(before).of("light").scene.files == ()
    cells.write_text("*ELEMENT, TYPE=C3D8\n** the same\n1, 1, 2, 4, 3, 5, 6, 8, 7\n")
    after = scene_of(tmp_path, with_file)
    assert "body.block.mesh" in changed(before, after)
    assert "body.bar.mesh" not in changed(before, after)


def test_files_that_a_file_names_are_told_apart(tmp_path: Path) -> None:
    """Two of them that are exchanged are other ones."""
    write_inputs(tmp_path)
    (tmp_path / "bar.inp").write_text("*INCLUDE, INPUT=a.inp\n*INCLUDE, INPUT=b.inp\n")
    texts = "** one\n", "** another\n"

    def with_file(document: dict[str, Any]) -> None:
        document["body"][1]["mesh"] = {"file": "bar.inp", "unit": "mm"}

    scenes = []
    for first, second in (texts, texts[::-1]):
        (tmp_path / "a.inp").write_text(first)
        (tmp_path / "b.inp").write_text(second)
        scenes.append(scene_of(tmp_path, with_file))
    assert "body.block.mesh" in changed(*scenes)


def test_a_part_leaves_the_scene_as_it_is(folder: Path) -> None:
    scene = scene_of(folder)
    before = copy.deepcopy(scene.document), digests(scene), scene.to_toml()
    parts = SceneParts(scene)
    for section in SECTIONS:
        parts.of(section)
        parts.of(section, *(["sensor"] if section != "sensor" else []))
    assert (scene.document, digests(scene), scene.to_toml()) == before
    assert scene.props[1].poses and scene.bodies[0].loads
