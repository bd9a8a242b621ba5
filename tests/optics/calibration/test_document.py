"""Calibration files as other programs and hands write them, whole and damaged."""

from __future__ import annotations

import json
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.optics.calibration.document import read_document

ROS = """image_width: 640
image_height: 480
camera_name: narrow_stereo/left
camera_matrix:
  rows: 3
  cols: 3
  data: [438.783, 0, 305.593,
         0, 437.302, 243.738, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.361976, 0.110510, 0.001014, 0.000505, 0]}
rectification_matrix:
  rows: 3
  cols: 3
  data: [0.9999, 0.0, 0.0, 0.0, 0.9999, 0.0, 0.0, 0.0, 1.0]
"""
ROS_K = [[438.783, 0, 305.593], [0, 437.302, 243.738], [0, 0, 1]]


@pytest.mark.parametrize("head", ["", "%YAML:1.0\n---\n"])
def test_a_camera_of_ros(tmp_path: Path, head: str) -> None:
    path = tmp_path / "left.yaml"
    path.write_text(head + ROS)
    (camera,) = gs.read_calibration(path)
    np.testing.assert_array_equal(camera.K, ROS_K)
    np.testing.assert_array_equal(camera.distortion, [-0.361976, 0.110510, 0.001014, 0.000505, 0])
    assert (camera.width, camera.height, camera.name) == (640, 480, "narrow_stereo/left")
    rational = ROS.replace("plumb_bob", "rational_polynomial").replace("cols: 5", "cols: 8")
    path.write_text(head + rational.replace("0.000505, 0]", "0.000505, 0, 0.01, 0.02, 0.003]"))
    assert gs.read_calibration(path)[0].distortion[7] == 0.003
    path.write_text(head + ROS.replace("plumb_bob", "equidistant"))
    with pytest.raises(InputError, match="distortion_model; got 'equidistant'; expected plumb_bob"):
        gs.read_calibration(path)


ROI = "roi: {x_offset: 100, y_offset: 50, height: 240, width: 320, do_rectify: false}\n"


@pytest.mark.parametrize(
    ("more", "size", "focal", "centre"),
    [
        (ROI, (320, 240), (438.783, 437.302), (205.593, 193.738)),
        (ROI.replace("240", "0").replace("320", "0"), (540, 430), (438.783, 437.302),
         (205.593, 193.738)),
        ("binning_x: 2\nbinning_y: 4\n", (320, 120), (219.3915, 109.3255), (152.5465, 60.5595)),
        (ROI + "binning_x: 2\nbinning_y: 0\n", (160, 240), (219.3915, 437.302),
         (102.5465, 193.738)),
        ("roi: [3, 4, 600, 400]\nbinning_x: 1\n", (640, 480), (438.783, 437.302),
         (305.593, 243.738)),
    ],
)  # fmt: skip
def test_a_part_of_a_sensor_and_binned_pixels(
    tmp_path: Path,
    more: str,
    size: tuple[int, int],
    focal: tuple[float, float],
    centre: tuple[float, float],
) -> None:
    path = tmp_path / "part.yaml"
    path.write_text(ROS + more)
    (camera,) = gs.read_calibration(path)
    assert (camera.width, camera.height) == size
    np.testing.assert_allclose(np.diag(camera.K)[:2], focal, rtol=1e-12)
    np.testing.assert_allclose(camera.K[:2, 2], centre, rtol=1e-12)


def test_parts_that_are_none_of_the_sensor(tmp_path: Path) -> None:
    path = tmp_path / "part.yaml"
    for old, new, part in (
        ("320", "600", r"part\.yaml: roi\.width; got 600 from x_offset 100; .* 640 pixels"),
        ("50", "-5", r"roi\.y_offset; got -5; expected a whole number"),
        ("240", "many", r"roi\.height; got 'many'; expected a number"),
    ):
        path.write_text(ROS + ROI.replace(old, new))
        with pytest.raises(InputError, match=part):
            gs.read_calibration(path)


MESSAGE = """header:
  seq: 0
  stamp:
    secs: 12
    nsecs: 0
  frame_id: "left_optical"
height: 480
width: 640
distortion_model: "plumb_bob"
D: [-0.361976, 0.110510, 0.001014, 0.000505, 0.0]
K: [438.783, 0.0, 305.593, 0.0, 437.302, 243.738, 0.0, 0.0, 1.0]
R: [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
P: [400.0, 0.0, 300.0, -48.0, 0.0, 400.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: False
---
"""


@pytest.mark.parametrize("small", [False, True])
def test_a_message_of_ros_as_it_is_printed(tmp_path: Path, small: bool) -> None:
    text = MESSAGE
    if small:  # ROS 2: small letters, a number a line
        lines = []
        for line in MESSAGE.splitlines():
            key, _, rest = line.partition(": [")
            rows = [f"- {word}" for word in rest.rstrip("]").split(", ")] if rest else []
            lines += [f"{key.lower()}:", *rows] if rows else [line]
        text = "\n".join(lines)
    path = tmp_path / "info.yaml"
    path.write_text(text)
    (camera,) = gs.read_calibration(path)
    np.testing.assert_array_equal(camera.K, ROS_K)
    np.testing.assert_array_equal(camera.distortion, [-0.361976, 0.110510, 0.001014, 0.000505, 0])
    np.testing.assert_array_equal(camera.camera_from_world, np.eye(4))  # R only rectifies
    assert (camera.width, camera.height, camera.name) == (640, 480, "left_optical")
    path.write_text(text.replace("plumb_bob", "equidistant"))
    with pytest.raises(InputError, match="distortion_model; got 'equidistant'"):
        gs.read_calibration(path)


def test_kalibrs_cameras_stand_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    def camera(number: int) -> str:
        return (
            f"cam{number}:\n  camera_model: pinhole\n  distortion_model: none\n"
            f"  intrinsics: [{500 + number}, 500, 320, 240]\n  resolution: [640, 480]\n"
            f"  T_cn_cnm1: [[1, 0, 0, {-0.01 * number}], [0, 1, 0, 0], [0, 0, 1, 0],"
            " [0, 0, 0, 1]]\n"
        )

    path = tmp_path / "camchain.yaml"
    path.write_text("".join(camera(number) for number in (10, 1, *range(2, 10), 0)))
    cameras = gs.read_calibration(path)
    assert [c.name for c in cameras] == [f"cam{number}" for number in range(11)]
    assert [c.K[0, 0] for c in cameras] == [500.0 + number for number in range(11)]
    x = [c.camera_from_world[0, 3] for c in cameras]
    np.testing.assert_allclose(x, [-0.01 * n * (n + 1) / 2 for n in range(11)], atol=1e-12)
    path.write_text(camera(0) + camera(2))
    with pytest.raises(InputError, match=r"camchain\.yaml: cam1; got nothing; expected it"):
        gs.read_calibration(path)
    path.write_text(camera(0) + camera(1).replace("cam1", "left"))
    with pytest.raises(InputError, match="left; got an unknown key; expected cam0, cam1"):
        gs.read_calibration(path)


def test_json_with_plain_lists_and_our_own_report(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({"camera_matrix": ROS_K, "dist_coeffs": [[0.1, -0.02, 0, 0]]}))
    (camera,) = gs.read_calibration(path, (640, 480))
    np.testing.assert_array_equal(camera.K, ROS_K)
    np.testing.assert_array_equal(camera.distortion, [0.1, -0.02, 0, 0])
    pose = np.eye(4)
    pose[0, 3] = -120.0
    own = {"name": "b", "resolution_px": [640, 480], "K": ROS_K, "distortion": [0.1] + [0.0] * 13,
           "camera_from_first_mm": pose.tolist()}  # fmt: skip
    path.write_text(json.dumps({"schema": 1, "cameras": [own]}))
    (camera,) = gs.read_calibration(path)
    assert camera.distortion[0] == 0.1 and camera.camera_from_world[0, 3] == pytest.approx(-0.12)
    path.write_text(json.dumps({"camera_matrix": ROS_K, "my_distortion": [0.1, 0, 0, 0]}))
    with pytest.raises(InputError, match="my_distortion; got an unknown key"):
        gs.read_calibration(path, (640, 480))


def test_opencvs_pair_of_intrinsics_and_extrinsics(tmp_path: Path) -> None:
    K = np.array([[1200.0, 0, 640], [0, 1201, 480], [0, 0, 1]])
    R = cv2.Rodrigues(np.array([0.02, -0.3, 0.01]))[0]
    for name, values in (
        (
            "intrinsics.yml",
            {"M1": K, "D1": np.full((1, 5), 0.01), "M2": 2 * K, "D2": np.zeros((5, 1))},
        ),
        ("extrinsics.yml", {"R": R, "T": np.array([[-120.0], [1], [9]]), "R1": R, "P1": K}),
    ):
        storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
        for key, value in values.items():
            if key == "M2":
                value[2, 2] = 1.0
            storage.write(key, value)
        storage.release()
    for name in ("intrinsics.yml", "extrinsics.yml"):
        first, second = gs.read_calibration(tmp_path / name, (1281, 961))
        np.testing.assert_array_equal(first.K, K)
        assert second.K[0, 0] == 2400.0
        np.testing.assert_allclose(second.camera_from_world[:3, 3], [-0.12, 0.001, 0.009])
        np.testing.assert_allclose(second.camera_from_world[:3, :3], R, atol=1e-12)
    (tmp_path / "extrinsics.yml").unlink()
    with pytest.raises(InputError, match=r"R, T; got nothing; .*extrinsics beside"):
        gs.read_calibration(tmp_path / "intrinsics.yml", (1281, 961))


def test_kalibr_with_quotes_and_maps_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(
        "cam0: {camera_model: 'pinhole', distortion_model: \"radtan\", intrinsics: [458.6, 457.3,"
        " 367.2, 248.4],\n  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.7e-05], resolution: "
        "[752, 480], rostopic: /cam0/image_raw}\n"
        "cam1:\n  'camera_model': pinhole\n  distortion_model: none\n  intrinsics:\n  - 457.5\n"
        "  - 456.1\n  - 379.9\n  - 255.2\n  T_cn_cnm1:\n    - [1.0, 0, 0, -0.11]\n"
        "    - [0, 1.0, 0, 0.0004]\n    - [0, 0, 1.0, 0]\n    - [0, 0, 0, 1.0]\n"
        "  resolution: [752, 480]  # px\n"
    )
    first, second = gs.read_calibration(path)
    np.testing.assert_array_equal(first.distortion, [-0.28, 0.07, 0.0002, 1.7e-05])
    np.testing.assert_array_equal(second.K[1], [0, 456.1, 255.2])
    np.testing.assert_allclose(second.camera_from_world[:3, 3], [-0.11, 0.0004, 0])


CUT = ("%YAML 1.2\n---\ncameras:\n   -\n      name: a\n      image_width: 160\n      image_height: "
       "120\n      camera_matrix: !!opencv-matrix\n         rows: 3\n         cols: 3\n         "
       "dt: d\n         data: [ 1000., 0., 80., 0., 1000., 60., 0., 0., 1. ]\n")  # fmt: skip


@pytest.mark.parametrize(
    ("name", "text", "part"),
    [
        ("cut.yml", CUT + "      R: !!opencv-matrix\n         rows: 3\n         cols: 3\n    ",
         r"cameras\[0\]: R.data; got nothing; expected 9 numbers"),
        ("cut.yml", CUT + "      T: [0, 0, 1]\n      R: [0, 0, 0]\n   -\n      name: b\n      "
         "K: [[9, 0, 1], [0, 9, 1], [0, 0, 1]]\n", r"cameras\[1\]: R; got nothing; expected it,"),
        ("cut.yml", CUT[:-30], "expected node content at line 13, column 1; expected well-form"),
        ("cut.yml", CUT[:-40] + "\nR: 1", r"sequence at line 12, .* ',' or '\]' at line 13"),
        ("a.yml", CUT.replace("rows: 3", "rows: 100000"), "camera_matrix.rows; got 100000"),
        ("a.yml", CUT.replace("cols: 3", "cols: 4"), "got 9 numbers; expected 12, as rows x cols"),
        ("a.yml", CUT.replace("cols: 3", "cols: many"), "camera_matrix.cols; got 'many'"),
        ("a.yml", CUT.replace("1000., 0., 80.", "*k, 0., 80."), r"line 12; .* no anchors"),
        ("a.json", '{"camera_matrix": [[1, 0, 3], [0, 1]]}', "camera_matrix; got rows of differ"),
        ("a.json", '{"camera_matrix": ' + "[" * 100_000, "expected well-formed JSON"),
        ("a.json", '{"camera_matrix": ' + "9" * 5000 + "}", "camera_matrix; got"),
        ("a.yml", "camera_matrix: " + "[" * 5000 + "]" * 5000, "exceeded maximum nesting depth"),
        ("a.yml", "camera_matrix: " + "[" * 50 + "]" * 50, "line 1; got 21 levels; expected at"),
        ("a.yml", "K: {rows: 3, rows: 4}", "line 1; got 'rows' again; expected it once"),
        ("a.yml", "roi: {x_offset:3}", "got x_offset:3; expected 'key: value', with the blank"),
        ("a.yml", "K: 1\n? [1]\n: 2", "line 2; got no word; expected 'key: value'"),
        ("a.yml", "K: 1\n--- {D: 2}", "line 2; got a second document; expected one"),
        ("a.yml", "K: \x01", "got an error: .* control characters .* position 3; expected well"),
        ("a.yml", "%TAG !a! b:\r" * 100_000 + "K: 1", r"camera_matrix; got shape \(1,\)"),
        ("a.yml", "camera_matrix: [" + "1, " * 200_000 + "1]", "expected a small matrix"),
        ("a.yml", "\n".join(" " * k + f"a{k}:" for k in range(300)), "at most 20 levels"),
        ("a.xml", "<?xml version='1.0'?><!DOCTYPE z [<!ENTITY a 'b'>]><opencv_storage>&a;"
         "</opencv_storage>", "document type"),
        ("a.xml", "<opencv_storage>" + "<a>" * 5000 + "</a>" * 5000 + "</opencv_storage>",
         "more than 20 levels"),
    ],
)  # fmt: skip
def test_damaged_files_name_what_is_wrong(tmp_path: Path, name: str, text: str, part: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    clock = time.process_time()
    with pytest.raises(InputError, match=part) as caught:
        gs.read_calibration(path, (160, 120))
    assert name in str(caught.value) and len(str(caught.value)) < 600
    assert time.process_time() - clock < 1.0


def test_documents() -> None:
    text = (
        'a: "x: y # z"\nb: it\'s # no\nurl: http://a:80\nc:\n- 1\n-\n  d: .inf\n  e: [{f: -1e3}]\n'
        "...\n---\nappended: !!opencv-matrix\n  data: [ 1., .5, +2.e-1,\n010, ]\n---\n"
    )
    assert read_document(text, "f") == {
        "a": "x: y # z", "b": "it's", "url": "http://a:80",
        "c": [1.0, {"d": np.inf, "e": [{"f": -1000.0}]}],
        "appended": {"data": [1.0, 0.5, 0.2, 10.0]},
    }  # fmt: skip
    words = ["yes", "off", "1:30", "0x10", "0o10", "1_000", "2026-11-28", "~", "<<", "nan", "1 2"]
    text = "all:\n" + "".join(f"- !!int {word}\n" for word in words)
    assert read_document(text, "f") == {"all": words}
    for bad in ("a: 1\na: 2\n", "a: 1\n   b: 2\n", "a: [1, 2}\n", "- 1\n", "a\n", "# a: 1\n", ""):
        with pytest.raises(InputError):
            read_document(bad, "f")


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_names_with_signs_are_read_as_they_were_written(tmp_path: Path, suffix: str) -> None:
    names = ["it's", 'a "b" c', "a\\b'", "no", "1:30", "010", "Käse", "# [x: y]"]
    cameras = [gs.Camera(640, 480, np.array(ROS_K), name=name) for name in names]
    gs.write_calibration(tmp_path / f"rig.{suffix}", cameras, "opencv")
    assert [camera.name for camera in gs.read_calibration(tmp_path / f"rig.{suffix}")] == names


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_what_says_that_it_is_no_fisheye(count: int, tmp_path: Path) -> None:
    """OpenCV's own calibration sample writes ``fisheye_model: 0``."""
    coefficients = [-0.1, 0.05, 0.001, -0.002, 0.01, 0.02, 0.03, 0.004, *[1e-4] * 6][:count]
    path = tmp_path / "camera.yml"
    path.write_text(f"""%YAML:1.0
---
calibration_time: "Fri Nov 27 10:00:00 2026"
image_width: 1920
image_height: 1200
flags: 0
fisheye_model: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1133., 0., 960.5, 0., 1128., 600.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: {count}
   cols: 1
   dt: d
   data: {coefficients}
avg_reprojection_error: 0.2
""")
    (camera,) = gs.read_calibration(path)
    assert camera.distortion is not None
    np.testing.assert_array_equal(camera.distortion[:count], coefficients)
    assert (camera.width, camera.height) == (1920, 1200)
    path.write_text(path.read_text().replace("fisheye_model: 0", "fisheye_model: 1"))
    with pytest.raises(InputError, match=r"camera\.yml: fisheye_model; got a fisheye"):
        gs.read_calibration(path)


@pytest.mark.parametrize("inside", [False, True])
def test_a_fisheye_in_plain_json(inside: bool, tmp_path: Path) -> None:
    plain = {"image_width": 640, "image_height": 480, "camera_matrix": ROS_K,
             "distortion_coefficients": [0.1, 0.02, 0.001, 0.002]}  # fmt: skip
    path = tmp_path / "camera.json"

    def read(**more: object) -> list[gs.Camera]:
        path.write_text(json.dumps({"cameras": [plain | more]} if inside else plain | more))
        return gs.read_calibration(path)

    for no in (False, 0, "no"):
        assert len(read(fisheye=no)) == 1
    for key, value in (("fisheye", True), ("is_fisheye", 1), ("xi", 1.2), ("K_fisheye", ROS_K),
                       ("model", "fisheye"), ("lens_model", "Kannala-Brandt")):  # fmt: skip
        with pytest.raises(InputError, match=f"{key}; got a fisheye"):
            read(**{key: value})
