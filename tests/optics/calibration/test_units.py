"""Calibration files state their unit of length, and are read in metres whatever it is."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.choices import LengthUnit
from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.optics.calibration.formats import UNITS
from tests.cli.test_dic_cameras import BASELINE, DISTANCE, HEIGHT, WIDTH, K, picture, run

ENDINGS = [
    ("opencv", "a.yml"), ("opencv", "a.xml"), ("opencv", "a.json"), ("kalibr", "a.yaml"),
    ("matchid", "a.caldat"), ("vic", "a.xml"), ("dice", "b.xml"),
]  # fmt: skip


def rig(baseline: float) -> list[gs.Camera]:
    pose = np.eye(4)
    pose[:3, 3] = [-baseline, 0.01 * baseline, 0.003]
    return [
        gs.Camera(WIDTH, HEIGHT, K, None, T, name)
        for T, name in ((np.eye(4), "left"), (pose, "right"))
    ]


@pytest.mark.parametrize(("format", "name"), ENDINGS)
def test_metres_come_back_as_metres(tmp_path: Path, format: str, name: str) -> None:
    path = tmp_path / name
    gs.write_calibration(path, rig(0.12), format)
    text = path.read_text()
    assert re.search(r"length_unit|\[mm\]", text)
    if format in ("matchid", "vic", "dice"):
        assert re.search(r"-120(\.0)?\b", text)  # millimetres, as these programs have them
    for source in (path, read_input(path)):
        got = gs.read_calibration(source, (WIDTH, HEIGHT))[1].camera_from_world[:3, 3]
        np.testing.assert_allclose(got, [-0.12, 0.0012, 0.003], rtol=1e-12)


def test_the_unit_that_an_opencv_file_says_is_no_hindrance_to_opencv(tmp_path: Path) -> None:
    for name in ("a.yml", "a.xml", "a.json"):
        path = tmp_path / name
        gs.write_calibration(path, rig(0.12), "opencv", unit="cm")
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        second = storage.getNode("cameras").at(1)
        np.testing.assert_allclose(second.getNode("T").mat().ravel(), [-12.0, 0.12, 0.3])
        assert storage.getNode("length_unit").string() == "cm"
        got = gs.read_calibration(path)[1].camera_from_world[:3, 3]
        np.testing.assert_allclose(got, [-0.12, 0.0012, 0.003], rtol=1e-12)


def test_files_that_do_not_say_are_read_as_asked_or_by_their_formats_habit(tmp_path: Path) -> None:
    path = tmp_path / "a.yml"
    gs.write_calibration(path, rig(0.12), "opencv", unit="mm")
    silent = re.sub("length_unit.*\n", "", path.read_text())
    path.write_text(silent)
    for unit, factor in ((None, 1e-3), ("mm", 1e-3), ("m", 1.0), ("in", 0.0254)):
        got = gs.read_calibration(path, unit=unit)[1].camera_from_world[0, 3]
        assert got == pytest.approx(-120.0 * factor, rel=1e-12)
    path.write_text(silent + "length_unit: mm\n")
    assert gs.read_calibration(path, unit="mm")[1].camera_from_world[0, 3] == pytest.approx(-0.12)
    for unit, part in (("m", "length_unit; got mm there, and unit m"), ("ell", "unit; got 'ell'")):
        with pytest.raises(InputError, match=part):
            gs.read_calibration(path, unit=unit)
    path.write_text(silent + "length_unit: ell\n")
    with pytest.raises(InputError, match="length_unit; got 'ell'; expected m, cm"):
        gs.read_calibration(path)


def test_what_a_format_cannot_hold_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "a.caldat"
    with pytest.raises(InputError, match="unit; got 'm'; expected mm"):
        gs.write_calibration(path, rig(0.12), "matchid", unit="m")
    aside = K.copy()
    aside[0, 2] += 3.0
    camera = gs.Camera(WIDTH, HEIGHT, K, [0.1, 0, 0, 0], name="a", lens_K=aside)
    with pytest.raises(InputError, match="lens_K"):
        gs.write_calibration(path, [camera], "matchid")
    assert not path.exists()


def test_a_rig_in_metres_measures_in_millimetres_and_odd_units_warn(tmp_path: Path) -> None:
    """A rig written in metres was read as millimetres: 0.8 m away became 0.8 mm."""
    pose = np.eye(4)
    pose[0, 3] = -BASELINE / 1000.0
    path, silent = tmp_path / "rig.yml", tmp_path / "silent.yml"
    gs.write_calibration(
        path,
        [gs.Camera(WIDTH, HEIGHT, K, None, T, n) for T, n in ((np.eye(4), "a"), (pose, "b"))],
        "opencv",
    )
    silent.write_text(re.sub("length_unit.*\n", "", path.read_text()))
    files = [picture(tmp_path / "l.png"), picture(tmp_path / "r.png", (-400 * 25.0 / 800.0, 0.0))]
    for name, more, far in ((path, (), DISTANCE), (silent, ("--calibration-unit", "m"), DISTANCE),
                            (silent, (), DISTANCE / 1000)):  # fmt: skip
        out = tmp_path / f"{name.stem}{len(more)}"
        done = run("--stereo", name, *more, *files, "-o", out, "--roi", "40,30,100,70")
        assert done.exit_code == 0, done.output
        lines = [x for x in (out / "0001_l.csv").read_text().splitlines() if x[0] != "#"]
        column = lines[0].split(",").index("Z_mm")
        depth = [float(x.split(",")[column]) for x in lines[1:] if x.endswith(",OK")]
        assert np.median(depth) == pytest.approx(far, rel=1e-3)
        page = (out / "report.html").read_text()
        assert "in mm in the frame of the left camera" in page
        assert "in pixels of the reference" not in page
        odd = far < 5.0
        assert ("the unit of its lengths looks wrong" in " ".join(done.output.split())) == odd
        assert ("looks wrong" in page) == odd


def test_units_are_those_that_users_choose_from() -> None:
    assert tuple(UNITS) == get_args(LengthUnit)
