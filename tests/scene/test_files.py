"""Files that a scene names are opened before any work: calibrations, fields, pictures."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner, Result

import gpusim as gs
from gpusim.cli import app
from gpusim.errors import InputError, SceneError
from gpusim.optics.light.lights import EnvironmentLight
from gpusim.optics.light.panorama import PANORAMA_SUFFIXES, read_panorama
from gpusim.pipeline.checks.resources import check_files
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.scene.description import lights as light_tables

FIELD = """schema = 1
name = "given"
[analysis]
type = "field"
times = [0.0, 0.4, 1.0]
[[body]]
name = "bar"
field = { file = "bar.npz", unit = "m" }
  [[body.paint]]
  name = "grey"
  type = "plain"
  albedo = 0.5
[[camera]]
name = "left"
resolution_px = [61, 43]
calibration = "rig.yml"
position_mm = [500, -2000, 300]
target_mm = [500, 0, 300]
"""
RIG = """%YAML:1.0
image_width: {}
image_height: 43
K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 80., 0., 30., 0., 81., 21., 0., 0., {} ]
"""
LIT = """schema = 1
name = "lit"
[analysis]
load_factors = [0]
[[prop]]
name = "plate"
center_mm = [0, 0, 0]
normal = [0, 0, 1]
up = [0, 1, 0]
size_mm = [200, 100]
paint = [{ type = "plain", name = "grey", albedo = 0.6 }]
[[camera]]
name = "above"
sensor_mm = [9, 6]
resolution_px = [45, 30]
focal_mm = 60
position_mm = [0, 0, 1000]
target_mm = [0, 0, 0]
up = [0, 1, 0]
[[light]]
name = "room"
type = "environment"
file = "room.hdr"
scale_W_m2_sr = 2.5
"""


def given_field(folder: Path, **changes: Any) -> Path:
    points = np.array(list(itertools.product((0, 0.5, 1), (0, 0.2), (0, 0.6))), float)
    first = np.array([0, 4, 6, 2, 1, 5, 7, 3])
    u = np.zeros((3, 12, 3))
    u[1:, 8:, 2] = [[0.01], [0.02]]
    values: dict[str, Any] = {
        "points": points, "cells_hex8": np.stack([first, first + 4]), "times": [0.0, 0.5, 1.0],
        "displacement": u, **changes,
    }  # fmt: skip
    np.savez(folder / "bar.npz", **values)
    (folder / "rig.yml").write_text(RIG.format(61, "1."))
    (folder / "scene.toml").write_text(FIELD)
    return folder / "scene.toml"


def plan(path: Path) -> Result:
    return CliRunner().invoke(app, ["plan", str(path)])


def test_a_good_field_and_calibration_pass(tmp_path: Path) -> None:
    check_files(gs.load_scene(given_field(tmp_path)))


def test_plan_tells_of_every_file_at_once(tmp_path: Path) -> None:
    u = np.zeros((3, 12, 3))
    u[2, 5, 1] = np.nan
    path = given_field(tmp_path, displacement=u)
    (tmp_path / "rig.yml").write_text(RIG.format(64, "1."))
    done = plan(path)
    text = " ".join(done.stderr.split())
    assert done.exit_code == 2
    assert "bar.npz: displacement at time 1: 1 nodes without a finite value" in text
    assert "got 64 x 43 px there; expected resolution_px [61, 43]" in text
    assert "render/left" not in done.stdout


def test_a_run_refuses_a_late_nan_before_it_writes(tmp_path: Path) -> None:
    u = np.zeros((3, 12, 3))
    u[2, 5, 1] = np.nan
    scene = gs.load_scene(given_field(tmp_path, displacement=u))
    with pytest.raises(InputError, match="displacement at time 1: 1 nodes without a finite"):
        gs.run(scene, tmp_path / "out", backend="numpy")
    assert not (tmp_path / "out").exists()
    # a step that no frame needs isn't read
    check_files(scene.replace("analysis.times", [0.0, 0.5]))


def test_a_run_refuses_a_calibration_before_it_writes(tmp_path: Path) -> None:
    path = given_field(tmp_path)
    (tmp_path / "rig.yml").write_text(RIG.format(61, "0."))
    with pytest.raises(InputError, match=r"rig\.yml: Camera .* K; got"):
        gs.run(gs.load_scene(path), tmp_path / "out", backend="numpy")
    assert not (tmp_path / "out").exists()


def test_scenes_without_files_need_no_numerics(checkout: Path) -> None:
    assert not gs.load_scene(checkout / "examples" / "crane.toml").reads_files
    assert gs.load_scene(checkout / "examples" / "strip.toml").reads_files


# -- surroundings from a picture ----------------------------------------------------------------


def panorama(folder: Path) -> np.ndarray:
    """A bright window to the right of the middle, above the horizon; bluish ground."""
    picture = np.full((24, 48, 3), 0.125, np.float32)
    picture[4:9, 28:33] = (3.0, 2.0, 1.0)
    picture[12:, :, 0] = 0.5
    cv2.imwrite(str(folder / "room.hdr"), picture)
    return np.asarray(picture.astype(float) @ [0.0722, 0.7152, 0.2126])


def lit(folder: Path, text: str = LIT) -> gs.Scene:
    (folder / "scene.toml").write_text(text)
    return gs.load_scene(folder / "scene.toml")


def test_a_picture_of_the_surroundings_lights_as_its_integral(tmp_path: Path) -> None:
    grey = panorama(tmp_path)
    scene = lit(tmp_path, LIT.replace('room.hdr"', 'room.hdr"\nchannels = "grey"'))
    (light,) = build_lights(scene) or []
    assert isinstance(light, EnvironmentLight) and light.image is not None
    np.testing.assert_allclose(light.image, 2.5 * grey, rtol=1e-2)  # 8 bits of mantissa
    # E of a face that looks up: the sum of radiance times cosine times solid angle, by hand; nine
    # harmonics come near it (Ramamoorthi and Hanrahan 2001: 1 % on average)
    edge = np.linspace(0.0, np.pi, 25)
    share = np.maximum(np.sin(edge[1:]) ** 2 - np.sin(edge[:-1]) ** 2, 0.0) * np.pi / 48
    irradiance = float((share[:12, None] * light.image[:12]).sum())
    gs.run(scene.replace("sensor.exposure", 0.25), tmp_path / "out", backend="numpy")
    image = cv2.imread(str(tmp_path / "out/images/above/0000.png"), cv2.IMREAD_UNCHANGED)
    want = 0.6 * irradiance / np.pi * 0.25 * 255
    assert float(image[15, 22]) == pytest.approx(want, rel=0.03)


def test_the_same_picture_in_other_files(tmp_path: Path) -> None:
    grey = panorama(tmp_path)
    exact = cv2.imread(str(tmp_path / "room.hdr"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(tmp_path / "room.tif"), exact)
    np.save(tmp_path / "room.npy", exact[..., ::-1])
    np.save(tmp_path / "grey.npy", grey)
    np.save(tmp_path / "thrice.npy", np.repeat(grey[..., None], 3, axis=2))
    want = read_panorama(tmp_path / "room.hdr")
    np.testing.assert_array_equal(want, exact[..., ::-1])  # red, green, blue
    for name in ("room.hdr", "room.tif", "room.npy"):
        np.testing.assert_allclose(read_panorama(tmp_path / name), want, rtol=1e-12)
        luminance = read_panorama(tmp_path / name, "grey")
        np.testing.assert_allclose(luminance, want @ [0.2126, 0.7152, 0.0722], rtol=1e-12)
    for channels in ("rgb", "grey"):
        np.testing.assert_array_equal(read_panorama(tmp_path / "grey.npy", channels), grey)
        thrice = read_panorama(tmp_path / "thrice.npy", channels)
        np.testing.assert_allclose(thrice, grey, rtol=1e-15)
    with pytest.raises(InputError, match="channels; got 'mono'; expected 'rgb' or 'grey'"):
        read_panorama(tmp_path / "room.hdr", "mono")
    assert PANORAMA_SUFFIXES == light_tables.PANORAMA_SUFFIXES


def test_what_is_no_picture_of_radiances(tmp_path: Path) -> None:
    panorama(tmp_path)
    np.save(tmp_path / "dark.npy", np.array([[0.5, -0.1]]))
    np.save(tmp_path / "whole.npy", np.array([[5, 1]]))
    (tmp_path / "bad.hdr").write_text("#?RADIANCE\nnothing")
    (tmp_path / "room.jpg").write_text("")
    for name, words in (("dark.npy", "below 0"), ("whole.npy", "no radiances"),
                        ("bad.hdr", "damaged"), ("room.jpg", "unknown kind"),
                        ("none.hdr", "no such file")):  # fmt: skip
        with pytest.raises(InputError, match=words):
            EnvironmentLight.read(tmp_path / name)
    with pytest.raises(InputError, match="scale; got 0"):
        EnvironmentLight.read(tmp_path / "room.hdr", scale=0.0)
    with pytest.raises(InputError, match=r"bad\.hdr: damaged"):
        check_files(lit(tmp_path, LIT.replace("room.hdr", "bad.hdr")))
    with pytest.raises(InputError, match=r"bad\.hdr: damaged"):
        gs.run(lit(tmp_path, LIT.replace("room.hdr", "bad.hdr")), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    for text, key in (
        (LIT.replace("room.hdr", "none.hdr"), "light.room.file: not found"),
        (LIT.replace("room.hdr", "room.jpg"), "light.room.file: unknown kind"),
        (LIT + "sky_W_m2_sr = 1.0\n", "light.room.sky_W_m2_sr: beside file"),
        (LIT + "forward = [0, 0, -2]\n", "light.room.forward: is along up"),
        (
            LIT.replace('file = "room.hdr"', "sky_W_m2_sr = 1.0"),
            "light.room.ground_W_m2_sr: missing",
        ),
    ):
        with pytest.raises(SceneError) as caught:
            lit(tmp_path, text)
        assert key in str(caught.value)


def test_another_picture_is_another_image(tmp_path: Path) -> None:
    """The content counts: an edited file renders again."""
    from gpusim.plan.plan import make_plan

    panorama(tmp_path)
    before = make_plan(lit(tmp_path))["render/above/0000"].key
    assert make_plan(lit(tmp_path))["render/above/0000"].key == before
    cv2.imwrite(str(tmp_path / "room.hdr"), np.full((4, 8, 3), 0.3, np.float32))
    assert make_plan(lit(tmp_path))["render/above/0000"].key != before
