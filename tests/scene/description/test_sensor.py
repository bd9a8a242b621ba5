"""Cameras of a scene with a sensor, a focal length or a pixel of their own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.export.images import read_image
from gpusim.optics.light.blackbody import blackbody
from gpusim.pipeline.scene_objects.cameras import (
    build_camera,
    build_lens,
    build_sensor,
    build_shutter,
)
from gpusim.plan.plan import make_plan
from gpusim.scene.description.sensor import CameraSensorTable, SensorTable
from tests.support.small_scene import small_scene

HEAD = """schema = 1
name = "sensors"
[[prop]]
name = "wall"
center_mm = [0, 0, 0]
normal = [0, -1, 0]
size_mm = [900, 600]
paint = [{ type = "plain", name = "grey", albedo = 0.5 }]
[analysis]
load_factors = [0]
[sensor]
exposure = 0.8
full_well_e = 8000.0
read_noise_e = 11.0
"""
CAMERA = """[[camera]]
name = "{}"
resolution_px = [57, 33]
pixel_um = 100.0
focal_mm = 16.0
position_mm = [10, -900, 20]
target_mm = [0, 0, 0]
"""
FILE = """%YAML:1.0
image_width: 57
image_height: 33
K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 160., 0., 27.5, 0., 161., 16.25, 0., 0., 1. ]
"""
RIG = """[[camera]]
name = "real"
resolution_px = [57, 33]
calibration = "rig.yml"
position_mm = [10, -900, 20]
target_mm = [0, 0, 0]
"""
BLUR = "f_number = 2.0\nfocus_distance_mm = 850.0\n"


def scene(tmp_path: Path, text: str) -> gs.Scene:
    (tmp_path / "rig.yml").write_text(FILE)
    (tmp_path / "scene.toml").write_text(HEAD + text)
    return gs.load_scene(tmp_path / "scene.toml")


def faults(tmp_path: Path, text: str) -> str:
    with pytest.raises(SceneError) as caught:
        scene(tmp_path, text)
    return str(caught.value)


def test_a_camera_has_its_own_noise_bits_and_exposure(tmp_path: Path) -> None:
    own = "[camera.sensor]\nbits = 12\nexposure = 0.4\nfull_well_e = 30_000.0\n"
    found = scene(tmp_path, CAMERA.format("one") + CAMERA.format("two") + own)
    assert found.cameras[0].electronics is None
    assert found.sensor_of("one") == found.sensor
    sensor = build_sensor(found.sensor_of("two"), found.cameras[1], 1.0 / 0.4)
    assert (sensor.bits, sensor.full_well, sensor.read_noise) == (12, 30_000.0, 11.0)
    again = gs.Scene.from_document(found.document)
    assert again.cameras == found.cameras
    # what a camera doesn't say still follows [sensor], after a round trip too
    louder = again.replace("sensor.read_noise_e", 40.0)
    assert dict(louder.sensor_of("two").values)["read_noise"] == 40.0
    gs.run(found, tmp_path / "out", backend="numpy")
    one, two = (read_image(tmp_path / f"out/images/{name}/0000.png") for name in ("one", "two"))
    assert one.dtype == np.uint8 and two.dtype == np.uint16
    for image, full, level, well in ((one, 255, 0.4, 8000.0), (two, 4095, 0.2, 30_000.0)):
        assert float(image.mean()) == pytest.approx(level * full, rel=5e-3)
        per_electron = full / well
        variance = level * full * per_electron + (11.0 * per_electron) ** 2 + 1 / 12
        assert float(image.var()) == pytest.approx(variance, rel=0.15)


def test_plan_says_which_sensor(tmp_path: Path) -> None:
    own = '[camera.sensor]\npreset = "imx174"\n'
    found = scene(tmp_path, CAMERA.format("one") + CAMERA.format("two") + own)
    plan = make_plan(found)
    assert "noise by EMVA 1288" in plan["render/one/0000"].detail
    assert "imx174" in plan["render/two/0000"].detail
    # a preset replaces the common noise: nothing of [sensor] is mixed into a real camera's values
    values = dict(found.sensor_of("two").values)
    assert "full_well" not in values and "read_noise" not in values
    changed = found.replace("camera.two.sensor.bits", 10)
    keys = [
        [make_plan(each)[f"render/{name}/0000"].key for name in ("one", "two")]
        for each in (found, changed)
    ]
    assert keys[0][0] == keys[1][0] and keys[0][1] != keys[1][1]
    assert gs.Scene.from_document(found.document).with_effects(no=["noise"]).sensor_of(
        "two"
    ).noisy is False  # fmt: skip


def test_keys_of_both_tables_agree() -> None:
    common, own = (
        set(table.model_json_schema()["properties"]) for table in (SensorTable, CameraSensorTable)
    )
    assert common - own == {"drift_percent", "format", "seed", "series"} and not own - common


def test_faults_between_both_sensors_name_the_camera(tmp_path: Path) -> None:
    text = CAMERA.format("one") + "[camera.sensor]\nblack_level_DN = 300.0\n"
    found = faults(tmp_path, text)
    assert "camera.one.sensor.black_level_DN" in found and "below 255" in found
    text = CAMERA.format("one") + "[camera.sensor]\nseed = 3\n"
    assert "camera.one.sensor.seed: unknown key" in faults(tmp_path, text)


def test_pixels_may_be_said_by_their_side(tmp_path: Path) -> None:
    by_pixel = scene(tmp_path, CAMERA.format("one")).cameras[0]
    text = CAMERA.format("one").replace("pixel_um = 100.0", "sensor_mm = [5.7, 3.3]")
    by_size = scene(tmp_path, text).cameras[0]
    np.testing.assert_allclose(build_camera(by_pixel).K, build_camera(by_size).K, rtol=1e-14)
    assert build_camera(by_pixel).K[0, 0] == pytest.approx(160.0)
    both = CAMERA.format("one") + "sensor_mm = [5.7, 3.3]\n"
    assert "camera.one.pixel_um: beside sensor_mm" in faults(tmp_path, both)


@pytest.mark.parametrize(
    ("extra", "lens", "focal"),
    [
        # by the pixel: fx of the file is the image distance, 160 px of 0.1 mm
        ("pixel_um = 100.0\n", "", 1.0 / (1.0 / 0.016 + 1.0 / 0.850)),
        ("", "focal_mm = 15.5\n", 0.0155),
        ("pixel_um = 100.0\n", "focal_mm = 15.5\n", 0.0155),
    ],
)
def test_depth_of_field_beside_a_calibration(
    tmp_path: Path, extra: str, lens: str, focal: float
) -> None:
    camera = scene(tmp_path, RIG + extra + "[camera.lens]\n" + BLUR + lens).cameras[0]
    built = build_lens(camera)
    assert built is not None
    assert built.focal_length == pytest.approx(focal, rel=1e-12)
    assert built.aperture == pytest.approx(focal / 2.0)


def test_the_blur_beside_a_calibration_is_the_thin_lens_one(tmp_path: Path) -> None:
    """A wall at 900.3 mm focused at 850 mm: a disc of diameter fx A |1/d - 1/s|."""
    text = RIG.replace("[10, -900, 20]", "[0, -900, 0]") + "[camera.lens]\nfocal_mm = 15.5\n" + BLUR
    report = gs.run(scene(tmp_path, text), tmp_path / "out", backend="numpy")
    aperture = 0.0155 / 2.0
    blur = 161.0 * aperture * abs(1 / 0.900 - 1 / 0.850)
    facts = json.loads(report.to_json())["facts"]
    assert f"blur up to {blur:.3g} px" in facts["camera real: depth of field"]


def test_faults_of_a_lens_without_lengths(tmp_path: Path) -> None:
    found = faults(tmp_path, RIG + "[camera.lens]\n" + BLUR)
    assert "lens.focus_distance_mm: needs the width of the aperture" in found
    assert "focal_mm as it stands on the lens" in found
    assert "camera.real.lens.focal_mm" in faults(tmp_path, RIG + "[camera.lens]\nfocal_mm = 15.5\n")
    near = RIG + "pixel_um = 100.0\n[camera.lens]\nf_number = 2.0\nfocus_distance_mm = 12.0\n"
    with pytest.raises(InputError, match=r"'real' lens.focus_distance_mm; got 12; .* 16 mm"):
        build_lens(scene(tmp_path, near).cameras[0])


def test_positions_and_samples_reach_the_optics(tmp_path: Path) -> None:
    moving = HEAD.replace("load_factors = [0]", "load_factors = [0, 1]\nframe_rate_Hz = 100.0")
    text = CAMERA.format("one") + "[camera.lens]\npositions = 20\n" + BLUR
    text += "[camera.shutter]\nexposure_ms = 2.0\nsamples = 400\n"
    (tmp_path / "moving.toml").write_text(moving + text)
    camera = gs.load_scene(tmp_path / "moving.toml").cameras[0]
    lens, shutter = build_lens(camera), build_shutter(camera)
    assert lens is not None and lens.positions == 20
    assert shutter == gs.Shutter(2e-3, samples=400)


COLOUR = CAMERA.format("one").rstrip() + '\nchannels = "rgb"\n'


def test_a_camera_in_colour(tmp_path: Path) -> None:
    """A grey wall in an rgb camera: three channels, chips with noise of their own."""
    text = COLOUR + "[camera.sensor]\nbits = 12\n" + CAMERA.format("two")
    found = scene(tmp_path, text)
    assert "in colour" in make_plan(found)["render/one/0000"].detail
    assert "in colour" not in make_plan(found)["render/two/0000"].detail
    gs.run(found, tmp_path / "out", backend="numpy")
    one, two = (read_image(tmp_path / f"out/images/{name}/0000.png") for name in ("one", "two"))
    assert one.shape == (33, 57, 3) and one.dtype == np.uint16 and two.shape == (33, 57)
    assert one.mean(axis=(0, 1)) == pytest.approx(0.4 * 4095, rel=5e-3)
    assert abs(np.corrcoef(one[..., 0].ravel(), one[..., 1].ravel())[0, 1]) <= 0.1


def test_bits_in_the_upper_ones_of_a_file(tmp_path: Path) -> None:
    """Twelve bits times 16, or as counted; what measures gets the same, viewers show it."""
    text = CAMERA.format("one") + "[camera.sensor]\nbits = 12\n"
    found = [scene(tmp_path, text + upper) for upper in ("", "upper_bits = true\n")]
    keys = [make_plan(each)["render/one/0000"].key for each in found]
    assert keys[0] != keys[1]
    for number, each in enumerate(found):
        gs.run(each, tmp_path / f"out{number}", backend="numpy")
    plain, upper = (read_image(tmp_path / f"out{n}/images/one/0000.png") for n in (0, 1))
    assert upper.dtype == np.uint16 and plain.max() < 4096
    np.testing.assert_array_equal(upper, plain * 16)
    noisy = {"bits": 12, "full_well_e": 10_000.0, "read_noise_e": 5.0}
    reports = [
        gs.run(small_scene(tmp_path, sensor=sensor), tmp_path / f"bar{number}", backend="numpy")
        for number, sensor in enumerate((noisy, noisy | {"upper_bits": True}))
    ]
    assert reports[0].measurements[0].error == reports[1].measurements[0].error
    assert [pair.bits for report in reports for pair in report.frames] == [12, 16]
    tables = [(tmp_path / f"bar{n}/measure/tip.csv").read_bytes() for n in (0, 1)]
    assert tables[0] == tables[1]
    eight = scene(tmp_path, CAMERA.format("one") + "[camera.sensor]\nupper_bits = true\n")
    assert eight.sensor_of("one").shift == 0


def test_white_balance_of_a_temperature(tmp_path: Path) -> None:
    """Gains are the inverse of what the channels see of it, the smallest 1."""
    text = COLOUR + "white_balance_K = 3000\n[camera.sensor]\n"
    mixed = "sensitivities = [[0.9, 0.1, 0], [0.1, 0.8, 0.1], [0, 0.2, 0.7]]\n"
    mosaic = 'bayer = "RGGB"\ndemosaic = "malvar"\nbayer_response = [0.5, 1, 0.7]\n'
    mixing = np.array([[0.9, 0.1, 0], [0.1, 0.8, 0.1], [0, 0.2, 0.7]])
    for extra, response in (("", np.eye(3)), (mixed, mixing), (mosaic, np.diag([0.5, 1, 0.7]))):
        found = scene(tmp_path, text + extra)
        assert "white balance for 3000 K" in make_plan(found)["render/one/0000"].detail
        sensor = build_sensor(found.sensor_of("one"), found.cameras[0], 1.0)
        assert sensor.white_balance is not None and sensor.channels == "rgb"
        white = np.array(sensor.white_balance) * (response @ blackbody(3000.0))
        assert white == pytest.approx(white[0]) and min(sensor.white_balance) == 1.0
    found = scene(tmp_path, COLOUR + "white_balance = [1.5, 1, 2]\n")
    assert build_sensor(found.sensor, found.cameras[0], 1.0).white_balance == (1.5, 1.0, 2.0)


def test_a_mosaic_and_the_curve_of_viewers(tmp_path: Path) -> None:
    raw = CAMERA.format("one") + '[camera.sensor]\nbayer = "GBRG"\ngamma = "srgb"\n'
    clear = CAMERA.format("two").rstrip() + '\nchannels = "rgb"\n'
    clear += '[camera.sensor]\nbayer = "GBRG"\ndemosaic = "bilinear"\ngamma = "srgb"\n'
    found = scene(tmp_path, raw + clear)
    gs.run(found, tmp_path / "out", backend="numpy")
    one, two = (read_image(tmp_path / f"out/images/{name}/0000.png") for name in ("one", "two"))
    assert one.shape == (33, 57) and two.shape == (33, 57, 3)
    assert one.mean() == pytest.approx(255 * (1.055 * 0.4 ** (1 / 2.4) - 0.055), abs=1.5)
    assert two.mean() == pytest.approx(one.mean(), abs=1.5)
    assert gs.Scene.from_document(found.document).sensor_of("two") == found.sensor_of("two")
    assert "bayer GBRG, demosaic bilinear, gamma srgb" in make_plan(found)["render/two/0000"].detail


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (COLOUR + '[camera.sensor]\nbayer = "RGGB"\n',
         'camera.one.channels: its sensor makes a raw mosaic'),
        (CAMERA.format("one") + '[camera.sensor]\nbayer = "RGGB"\ndemosaic = "malvar"\n',
         'camera.one.channels: its sensor makes a picture in colour of its mosaic'),
        (COLOUR + 'white_balance_K = 3200\n[camera.sensor]\nbayer = "RGGB"\n'
         'demosaic = "malvar"\nbayer_response = [1, 0, 1]\n',
         "camera.one.white_balance_K: can't lift what has no bayer_response"),
        (COLOUR + '[camera.sensor]\ndemosaic = "malvar"\n',
         "camera.one.sensor.demosaic: no mosaic"),
        (CAMERA.format("one") + "white_balance = [1, 1, 2]\n",
         "camera.one.white_balance: needs pixels behind colour filters"),
        (CAMERA.format("one") + "white_balance_K = 3200\n",
         "camera.one.white_balance_K: needs pixels behind colour filters"),
        (COLOUR + "white_balance_K = 3200\nwhite_balance = [1, 1, 2]\n",
         "camera.one.white_balance: beside white_balance_K"),
        (COLOUR + "white_balance_K = 300\n", "camera.one.white_balance_K"),
        (COLOUR + "[camera.sensor]\nsensitivities = [1, 1, 1]\n",
         "camera.one.channels: doesn't go with the sensor's sensitivities"),
        (CAMERA.format("one") + "[camera.sensor]\nsensitivities = [1, 1]\n",
         "got 2 items; expected a list of 3 numbers >= 0, or a list of 3 lists of 3 numbers >= 0"),
        (CAMERA.format("one") + "[camera.sensor]\nsensitivities = [0, 0, 0]\n",
         "camera.one.sensor.sensitivities: a channel that sees nothing"),
        (CAMERA.format("one") + '[camera.sensor]\ngamma = "log"\n',
         'got "log"; expected "srgb", or a number > 0'),
        (CAMERA.format("one").rstrip() + '\nchannels = "color"\n', "camera.one.channels"),
    ],
)  # fmt: skip
def test_faults_of_colour(tmp_path: Path, text: str, message: str) -> None:
    assert message in faults(tmp_path, text)
