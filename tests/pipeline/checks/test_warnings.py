"""What is doubtful about a scene or a run is said, with its number."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from typer.testing import CliRunner

import gpusim as gs
from gpusim.cli import app
from gpusim.errors import InputError
from gpusim.export.images import read_image
from gpusim.mesh import boundary_faces, box
from gpusim.optics.sensor.emva1288 import emva_twin
from gpusim.pipeline import run
from gpusim.pipeline.checks.measurability import pixels_per_metre
from gpusim.pipeline.checks.warnings import scene_warnings
from gpusim.pipeline.measurements.deflection import DeflectionResult
from gpusim.pipeline.measurements.deflection.projection_error import projection_error
from gpusim.pipeline.pictures.visibility import winding_numbers
from gpusim.pipeline.stages.images import level_warnings
from gpusim.scene import Scene

Float = npt.NDArray[np.float64]
TOWARDS = {"body.crane.load.weight.force_N": [0.0, -8000.0, -2000.0]}


def markers(name: str, place: dict[str, Any], **where: Any) -> dict[str, Any]:
    return {"name": name, "type": "markers", "albedo": 0.56, "size_mm": 40.0, **place, **where}


def line(start: list[float], end: list[float]) -> dict[str, Any]:
    return {"line": {"start_mm": start, "end_mm": end, "count": 4}}


WALL = [[-120.0, 150.0, 80.0], [-120.0, 150.0, 470.0], [170.0, 150.0, 110.0], [480.0, 150.0, 410.0]]
MINI: dict[str, Any] = {
    "schema": 1, "name": "Mini crane",
    "material": [{"name": "steel", "youngs_modulus_GPa": 210.0, "poissons_ratio": 0.3,
                  "density_kg_m3": 7850.0}],
    "body": [{
        "name": "crane", "material": "steel", "formulation": "incompatible",
        "mesh": {"builder": "crane", "height_mm": 562.0, "foot_mm": 70.0, "length_mm": 597.0,
                 "column_thickness_mm": 40.0, "beam_thickness_mm": 40.0, "width_mm": 40.0,
                 "load_length_mm": 108.0, "element_mm": 20.0, "through": 1, "across": 2},
        "support": [{"name": "clamp", "where": {"set": "foot"}, "fix": ["x", "y", "z"]}],
        "load": [{"name": "weight", "type": "force", "force_N": [0.0, 0.0, -13000.0],
                  "where": {"normal": "+z", "x_min_mm": 489.0, "z_min_mm": 600.0}}],
        "paint": [
            markers("column", line([20.0, -20.0, 60.0], [20.0, -20.0, 500.0]),
                    where={"normal": "-y", "z_max_mm": 562.0, "x_max_mm": 40.0}),
            markers("beam", line([100.0, -20.0, 582.0], [560.0, -20.0, 582.0]),
                    where={"normal": "-y", "z_min_mm": 562.0}),
        ],
    }],
    "prop": [{"name": "wall", "center_mm": [300.0, 150.0, 290.0], "normal": [0.0, -1.0, 0.0],
              "size_mm": [1800.0, 1300.0], "paint": [markers("static", {"positions_mm": WALL})]}],
    "camera": [{"name": "front", "sensor_mm": [36.0, 27.0], "resolution_px": [400, 300],
                "focal_mm": 30.0, "position_mm": [300.0, -1020.0, 290.0],
                "target_mm": [300.0, -20.0, 290.0], "up": [0.0, 0.0, 1.0]}],
    "measure": [{"name": "deflection", "type": "deflection", "camera": "front",
                 "groups": ["column", "beam"], "static": ["static"], "direction": "-z"}],
}  # fmt: skip


def mini(changes: dict[str, Any] | None = None, **sections: Any) -> Scene:
    """A small crane seen in 400 x 300 px without lights."""
    return Scene.from_document({**MINI, **sections}, overrides=changes or {})


def test_motion_towards_the_camera_explains_the_error(tmp_path: Path) -> None:
    scene = mini(TOWARDS)
    report = run(scene, tmp_path / "toward", backend="numpy")
    tip = report.measurements[0]
    assert tip.error < -0.5 * tip.truth
    (warning,) = [w for w in report.warnings if "motion along the camera's axis" in w]
    # by hand: with the depth d less by v, what is at height h over the axis reads h d / (d - v)
    found = DeflectionResult.read(tmp_path / "toward" / "measure", "deflection")
    z = found.position_mm[-1, 2] - scene.cameras[0].target[2] * 1e3  # type: ignore[index]
    depth = 1e3 * (-0.02 - scene.cameras[0].position[1])  # type: ignore[index]
    come, fall = found.table["towards_mm"][0, -1], found.true_mm[-1, 1]
    along_axis = found.table["axis_error_z_mm"][0, -1]
    by_hand = (z + fall) * depth / (depth - come) - z - fall
    assert abs(along_axis - by_hand) <= 2e-3 * abs(by_hand)
    assert f"moves {come:.3g} mm towards the camera" in warning
    # what is left unexplained is what markers are measured to
    assert abs(-tip.error - along_axis) <= 0.1
    assert any("load 'weight' acts along the axis" in w for w in report.warnings)


@pytest.mark.parametrize(
    ("where", "share"),
    [
        ({"set": "y_max"}, 100),
        ({"normal": "+y"}, 100),
        ({"y_min_mm": 20.0}, 100),
        ({"set": "z_max"}, None),
        ({"x_min_mm": 0.0}, None),  # all round: it pushes nowhere
        ({"x_min_mm": 240.0}, None),
    ],
)
def test_a_pressure_along_the_axis(
    checkout: Path, where: dict[str, Any], share: int | None
) -> None:
    load = {"name": "push", "type": "pressure", "pressure_MPa": 0.1, "where": where}
    changes = {"body.bar.load": [load], "body.bar.mesh.divisions": [12, 2, 2]}
    texts = scene_warnings(gs.load_scene(checkout / "examples" / "cantilever.toml", changes))
    told = [text for text in texts if "acts along the axis" in text]
    assert len(told) == (share is not None)
    assert all(
        f"load 'push' acts along the axis of camera 'side' with {share} %" in t for t in told
    )


def test_parts_of_a_projection_error_add_up() -> None:
    camera = gs.Camera.from_lens(
        (36.0, 24.0),
        30.0,
        (360, 240),
        (0.1, -1.0, 0.2),
        (0.0, 0.0, 0.1),
        distortion=[-0.1, 0.02, 0, 0],
    )
    place = np.array([[0.0, 0.0, 0.0], [0.2, 0.01, 0.1], [0.1, 0.0, 0.3], [-0.1, 0.02, 0.2]])
    moved = np.array([[0.0, 0.0, 0.0], [1e-3, 2e-3, -3e-3], [0.0, -5e-3, 1e-3], [2e-3, 0.0, 0.0]])
    plane = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    scale = gs.measure.scale_coefficient(camera.project(place), 1e3 * place @ plane.T)
    every = np.ones(4, bool)
    right = projection_error(camera, place, moved, plane, scale=scale, used=every)
    assert np.abs(right["scale"]).max() <= 1e-12
    # 2 % wrong and turned by 0.01: all of what that changes is the scale's part, nothing else's
    wrong = 1.02 * np.array([[1.0, -0.01], [0.01, 1.0]]) @ scale.rotation
    scale = dataclasses.replace(scale, rotation=wrong)
    found = projection_error(camera, place, moved, plane, scale=scale, used=every)
    for part in ("axis", "plane", "lens"):
        assert np.array_equal(found[part], right[part])
    whole = scale.vectors(camera.project(place + moved) - camera.project(place))
    error = whole - 1e3 * moved @ plane.T
    assert np.abs(sum(found.values()) - error).max() <= 1e-12
    assert (found["axis"][0] == 0.0).all() and np.abs(found["axis"][2]).max() > 0.5
    assert np.abs(found["lens"][3]).max() > 3e-3 and np.abs(found["plane"][3]).max() > 3e-3


def test_the_examples_raise_no_doubts(checkout: Path) -> None:
    for name in ("crane", "crane_stereo", "strip", "bimetal"):
        assert scene_warnings(gs.load_scene(checkout / "examples" / f"{name}.toml")) == []


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("camera.front.target_mm", [300.0, -9000.0, 290.0], "sees no surface: everything is beh"),
        ("camera.front.target_mm", [9000.0, -20.0, 290.0], "lies left of its image"),
        ("camera.front.position_mm", [20.0, 0.0, 300.0], "'front' is inside 'crane': move it out"),
        ("camera.front.position_mm", [300.0, -2e12, 290.0], "sees all surfaces within"),
        ("camera.front.position_mm", [300.0, 2000.0, 290.0], "(hidden by 'wall')"),
        ("camera.front.resolution_px", [80, 60], "is too small for camera 'front'"),
    ],
)  # fmt: skip
def test_a_camera_that_sees_no_marker(tmp_path: Path, key: str, value: Any, said: str) -> None:
    scene = mini({key: value})
    with pytest.raises(InputError) as error:
        scene_warnings(scene)
    assert said in str(error.value) and "'front'" in str(error.value)
    with pytest.raises(InputError):
        run(scene, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    if "small" not in said:  # without a measure it is a warning, of the wall none
        texts = scene_warnings(mini({key: value}, measure=[]))
        assert [said in text for text in texts] == ([] if "hidden" in said else [True])


def lamp(place: list[float]) -> dict[str, Any]:
    return {"name": "lamp", "type": "point", "position_mm": place, "power_W": 5.0}


def test_a_lamp_inside_a_body() -> None:
    (text,) = scene_warnings(mini(light=[lamp([20.0, 1.0, 300.0])]))
    assert text == "light 'lamp' is inside 'crane': nothing outside is lit by it"
    assert scene_warnings(mini(light=[lamp([20.0, -21.0, 300.0])])) == []


def test_more_lamps_than_a_picture_takes(tmp_path: Path) -> None:
    def lamps(count: int) -> list[dict[str, Any]]:
        return [
            lamp([10.0 * k, -900.0, 300.0]) | {"name": f"bulb-{k}", "shadows": False}
            for k in range(count)
        ]

    small = {"camera.front.resolution_px": [40, 30]}
    assert scene_warnings(mini(small, light=lamps(256), measure=[])) == []
    large = {"name": "panel", "type": "area", "position_mm": [300.0, -320.0, 300.0], "power_W": 9.0,
             "target_mm": [300.0, -20.0, 300.0], "size_mm": [300.0, 300.0]}  # fmt: skip
    for lights, told in (
        (lamps(257), "got 257 lamps, which are 257 emitting points for camera 'front'; expected"),
        ([*lamps(255), large], "got 256 lamps"),
    ):
        scene = mini(small, light=lights, measure=[])
        with pytest.raises(InputError, match=told):
            run(scene, tmp_path / "out", backend="numpy")
        assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match=r"count as several points: 'panel' as \d+\)"):
        scene_warnings(scene)


def test_winding_numbers() -> None:
    mesh = box((0.3, 0.2, 0.1), (3, 2, 1), origin=(5e5, 5.2e6, 300.0))
    faces = boundary_faces(mesh)
    surface = gs.Surface(mesh.points, faces.nodes[:, :4], gs.paint.Plain(0.5))
    inside = np.array([5e5 + 0.299, 5.2e6 + 0.1, 300.05])
    outside = np.array([5e5 + 0.301, 5.2e6 + 0.1, 300.05])
    turned = gs.Surface(mesh.points, faces.nodes[:, 3::-1], gs.paint.Plain(0.5))
    places = np.stack([inside, outside])
    assert np.allclose(winding_numbers(surface, places), [1.0, 0.0], atol=1e-6)
    assert np.allclose(winding_numbers(turned, places), [-1.0, 0.0], atol=1e-6)


def speckled(diameter: float) -> Scene:
    """A square plate of 40 mm in 800 px at 400 mm: 0.5 mm per 10 px."""
    speckle = {
        "name": "speckle",
        "type": "speckle",
        "albedo": 0.9,
        "diameter_mm": diameter,
        "coverage": 0.5,
    }
    return Scene.from_document({
        "schema": 1, "name": "plate",
        "prop": [{"name": "plate", "center_mm": [0.0, 0.0, 0.0], "normal": [0.0, -1.0, 0.0],
                  "size_mm": [60.0, 60.0], "paint": [speckle]}],
        "camera": [{"name": "front", "sensor_mm": [8.0, 6.0], "resolution_px": [800, 600],
                    "focal_mm": 80.0, "position_mm": [0.0, -400.0, 0.0],
                    "target_mm": [0.0, 0.0, 0.0], "up": [0.0, 0.0, 1.0]}],
    })  # fmt: skip


def test_speckle_that_is_too_fine_or_too_coarse() -> None:
    (fine,) = scene_warnings(speckled(0.05))
    assert "discs of speckle 'speckle' on 'plate' are 1 px wide (0.05 mm); below 2 px" in fine
    (coarse,) = scene_warnings(speckled(0.8))
    assert "are 16 px wide (0.8 mm); above 15 px a subset needs 48 px to hold 3 of them" in coarse
    assert scene_warnings(speckled(0.2)) == []


def test_speckle_behind_a_screen_is_not_told() -> None:
    document = speckled(0.05).document
    grey = {"name": "grey", "type": "plain", "albedo": 0.4}
    screen = {"name": "screen", "center_mm": [0.0, -50.0, 0.0], "normal": [0.0, -1.0, 0.0],
              "size_mm": [60.0, 60.0], "paint": [grey]}  # fmt: skip
    for size, told in ((60.0, 0), (20.0, 1)):  # all, and a part that is in the image's middle
        props = [*document["prop"], screen | {"size_mm": [size, size]}]
        texts = scene_warnings(Scene.from_document({**document, "prop": props}))
        assert len([text for text in texts if "discs of speckle" in text]) == told


def test_scale_of_a_plane_that_is_seen_at_an_angle() -> None:
    turn = np.array([[0.5, np.sqrt(0.75), 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    square = 1e-3 * np.array([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    tilted = square @ turn.T + square @ np.array([[0, 0, 0], [np.sqrt(0.75), 0, 0], [0, 0, 0.0]]).T
    surface = gs.Surface(tilted, np.array([[0, 1, 2, 3]]), gs.paint.Speckle(1e-4))
    camera = gs.Camera.from_lens((8.0, 6.0), 80.0, (800, 600), (0.0, -0.4, 0.0), (0.0, 0.0, 0.0))
    # 20 px per mm from the front; turned by 60 degrees half the area
    assert abs(pixels_per_metre(surface, 0, camera) - 2e4 * np.sqrt(0.5)) <= 2.0


def test_grey_levels() -> None:
    image = np.full((33, 57), 120, np.uint8)
    image[3] = 200
    eight = gs.Sensor(8)
    assert level_warnings(image, eight) == []
    assert level_warnings(0 * image, eight) == ["shows nothing: every pixel is black, 0 of 255"]
    white = level_warnings(0 * image + 255, eight)
    assert white == ["shows nothing: every pixel is white, 255 of 255"]
    assert "grey values reach 20 of 255" in level_warnings(image // 10, eight)[0]
    image[:, 5] = 255
    assert level_warnings(image, eight)[0].startswith("has 1.8 % of its pixels saturated")
    twelve = np.minimum(image, 200).astype(np.uint16)
    assert "200 of 4095" in level_warnings(twelve, gs.Sensor(12))[0]


def test_levels_of_colours() -> None:
    """Each channel by itself: what white balance lifts is saturated at full scale, what it lowers
    below."""
    sensor = gs.Sensor(8, channels="rgb", white_balance=(0.5, 1.0, 1.5))
    image = np.full((33, 57, 3), [60, 120, 180], np.uint8)
    assert level_warnings(image, sensor)[0].startswith(
        "shows nothing: every pixel is of one colour"
    )
    assert "is grey" in level_warnings(np.full((33, 57, 3), 90, np.uint8), sensor)[0]
    image[3] += 20
    assert level_warnings(image, sensor) == []
    image[:, 5, 0] = 128  # half of full scale
    assert level_warnings(image, sensor)[0].startswith("has 1.8 % of its red pixels saturated")
    assert "grey values reach 20 of 255" in level_warnings(image // 10, sensor)[0]


@pytest.mark.parametrize(
    ("changes", "most"),
    [
        ({}, 204),  # 10 000 e x 0.02 DN/e + 4
        ({"gamma": 2.0}, 228),  # 255 sqrt(204 / 255)
        ({"gain": 0.1}, 255),  # the largest number comes first
        ({"gain": None}, 255),  # the full well is put there
        ({"full_well": None}, 255),
    ],
)
def test_a_full_well_below_the_largest_number_saturates(changes: dict[str, Any], most: int) -> None:
    values: dict[str, Any] = {"gain": 0.02, "full_well": 1e4, "black_level": 4.0} | changes
    sensor = gs.Sensor(8, **values)
    assert sensor.saturation == most
    # what a picture that is far too bright shows, through the sensor itself
    signal = sensor.signal(3)
    assert signal is not None
    radiance = np.full((20, 30), 5.0, np.float32)
    radiance[:, :29] = 0.2
    image = emva_twin(signal, radiance).astype(np.uint8)
    assert (image[:, 29] == most).all() and image[:, :29].max() < most
    (text,) = level_warnings(image, sensor)
    assert text.startswith("has 3.3 % of its pixels saturated")
    assert (f"(at {most} of 255: the full well)" in text) == (most < 255)


def test_saturation_at_the_full_well_is_told(tmp_path: Path) -> None:
    scene = mini({"sensor.full_well_e": 10_000.0, "sensor.gain_DN_per_e": 0.02,
                  "sensor.exposure": 2.4})  # fmt: skip
    report = run(scene, tmp_path / "bright", backend="numpy")
    found = DeflectionResult.read(tmp_path / "bright" / "measure", "deflection")
    columns = found.table.columns
    # of those it could find
    assert found.named("saturated") == "column-02, column-03, column-04"
    assert any("saturated (at 200 of 255: the full well)" in text for text in report.warnings)
    assert any("saturated pixels on column-02" in text for text in report.warnings)
    # a plane that is square to the axis is blamed for nothing, whatever the scale
    share = found.mm_per_px / found.mm_per_px_true - 1
    assert found.tilt_deg == 0.0 and abs(share) > 1e-3
    assert np.abs(found.table.vectors("plane_error")).max() <= 1e-3
    assert not any("seen in perspective" in text for text in report.warnings)
    # largest at a marker that wasn't measured, and told of one that was
    scaled = {name: 20.0 * one for name, one in columns.items() if name.startswith("scale_error")}
    table = dataclasses.replace(found.table, columns={**columns, **scaled})
    worse = dataclasses.replace(found, table=table)
    errors = table.vectors("scale_error")[-1]
    assert np.linalg.norm(errors, axis=1).argmax() == 7 and worse.status[7] != "OK"
    (text,) = [text for text in worse.warnings if "the scale is wrong" in text]
    assert "(3.0036 mm/px; 3 at their depth)" in text and "at column-04" in text
    # one factor for all that moves in the image
    by_scale = share * found.true_mm
    assert np.abs(errors / 20.0 - by_scale).max() <= 0.3 * np.abs(by_scale).max()


def test_auto_exposure_stays_below_the_full_well(tmp_path: Path) -> None:
    scene = mini({"sensor.full_well_e": 10_000.0, "sensor.gain_DN_per_e": 0.02}, measure=[])
    assert not any("satur" in t for t in run(scene, tmp_path / "o", backend="numpy").warnings)
    image = read_image(tmp_path / "o" / "images" / "front" / "0000.png")
    assert 180 <= image.max() < 200  # 95 % of 200, and shot noise


def test_a_picture_that_is_black(tmp_path: Path) -> None:
    sun = {"name": "sun", "type": "sun", "direction": [0.0, -1.0, 0.0], "irradiance_W_m2": 900.0}
    small = {"camera.front.resolution_px": [40, 30]}
    with pytest.raises(InputError, match="none of the lights 'sun' reaches what it sees") as error:
        run(mini(small, light=[sun], prop=[], measure=[]), tmp_path / "dark", backend="numpy")
    assert "camera 'front': image 0000 is black" in str(error.value)


def test_a_mesh_beyond_the_memory_is_not_built(tmp_path: Path) -> None:
    path = tmp_path / "fine.toml"
    fine = {"body.crane.mesh.element_mm": 0.01, "body.crane.mesh.through": 400,
            "body.crane.mesh.across": 400}  # fmt: skip
    path.write_text(mini(fine).to_toml(), encoding="utf-8")
    printed = CliRunner().invoke(app, ["plan", str(path), "--json"])
    assert printed.exit_code == 0
    looked, solved = json.loads(printed.stdout)["warnings"][-2:]
    # 118 900 fields along, 400 through, 400 across
    assert "geometry was not looked at: meshes of 19,1" in looked
    assert "GB of memory" in solved and "expected a smaller scene" in solved
    with pytest.raises(InputError, match="expected a smaller scene"):
        run(mini(fine), tmp_path / "out", backend="numpy")


def test_plan_prints_warnings_and_one_line_per_calibration(checkout: Path, tmp_path: Path) -> None:
    toward = tmp_path / "toward.toml"
    toward.write_text(mini(TOWARDS).to_toml(), encoding="utf-8")
    runner = CliRunner()
    printed = runner.invoke(app, ["plan", str(toward)])
    assert printed.exit_code == 0 and "warning: measure 'deflection': load 'weight'" in (
        printed.stdout
    )
    found = json.loads(runner.invoke(app, ["plan", str(toward), "--json"]).stdout)
    assert len(found["warnings"]) == 1 and "load 'weight' acts along" in found["warnings"][0]
    stereo = str(checkout / "examples" / "crane_stereo.toml")
    lines = runner.invoke(app, ["plan", stereo]).stdout.splitlines()
    (left,) = [line for line in lines if line.startswith("render/left/calib")]
    assert left.startswith("render/left/calib-0000..0020") and "21 pictures" in left
