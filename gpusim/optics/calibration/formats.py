"""Cameras from and to the calibration files of other programs.

| format | file | lengths | distortion | rotation |
|---|---|---|---|---|
| opencv | FileStorage .yml .xml .json, ROS | as it says, else mm | all of OpenCV's | matrices |
| kalibr | camchain .yaml, pinhole + radtan | m | k1 k2 p1 p2 | 4 x 4 from one camera to the next |
| matchid | .caldat | mm | k1 k2 k3 p1 p2 | Theta, Phi, Psi in degrees |
| vic | .xml with <camera> (project.xml of a .z3d) | mm | k1 k2 k3 | alpha, beta, gamma in degrees |
| dice | camera system .xml | mm | all of OpenCV's | matrix, or ALPHA, BETA, GAMMA |

Here lengths are metres. A file may say ``length_unit: mm``: OpenCV's as a key, the others, whose
programs would stumble over a key, in a comment; that goes before the format's habit. In VIC's a
comment says the size of the pictures, for which the format has no place; MatchID's .caldat has none
for comments either: such a file is read with ``size=``.

Pixel centres are whole numbers and the first pixel's is (0, 0) in all of them. Skew is K[0, 1] in
px (MatchID's and DICe's Fs, VIC's fifth number): x = fx X + Fs Y + cx; OpenCV's own functions
ignore it, Kalibr has none. Three angles make R = Rz(third) Ry(second) Rx(first), and X_camera =
R X + T. The frame of Kalibr and MatchID is that of the first camera, that of VIC and DICe a world.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input
from gpusim.optics.calibration.document import coefficients, read_document
from gpusim.optics.calibration.opencv import cameras_of, needs_extrinsics, read_opencv, write_opencv
from gpusim.optics.calibration.rig_formats import (
    read_dice,
    read_kalibr,
    read_matchid,
    read_vic,
    write_dice,
    write_kalibr,
    write_matchid,
    write_vic,
)
from gpusim.optics.camera.pinhole import Camera
from gpusim.validation import require, require_one_of

Size = tuple[int, int] | None
Source = str | PathLike[str] | InputFile

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
"""Metres in each unit of length that a file may have."""
_STATED = re.compile(r"""\blength_unit\b["'>:\s]*([A-Za-z]+)""")

LONGEST, LONGEST_MESSAGE = 4_000_000, 800  # bytes, characters


class Format(NamedTuple):
    """How a program's files are read and written, and the ``unit`` where they don't say it.

    ``ending``: of their names. ``lens``: which coefficients they hold, by their place among
    OpenCV's 14. ``skew``: whether the program knows it. ``most``: cameras in a file.
    """

    read: Callable[[str, str, Size], list[Camera]]
    write: Callable[[Sequence[Camera], str, Sequence[str]], str]
    unit: str
    ending: str
    lens: Collection[int]
    skew: bool
    most: int


FORMATS = {  # OpenCV's lengths are those of the board, mostly millimetres
    "opencv": Format(read_opencv, write_opencv, "mm", ".yml", range(14), skew=False, most=999),
    "kalibr": Format(read_kalibr, write_kalibr, "m", ".yaml", range(4), skew=False, most=999),
    "matchid": Format(read_matchid, write_matchid, "mm", ".caldat", range(5), skew=True, most=2),
    "vic": Format(read_vic, write_vic, "mm", ".xml", (0, 1, 4), skew=True, most=999),
    "dice": Format(read_dice, write_dice, "mm", ".xml", range(14), skew=True, most=10),
}
COEFFICIENTS = tuple("k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y".split())
"""Of a lens, as OpenCV counts them."""


def calibration_format(source: Source) -> str:
    """Which program's calibration a file holds, by its name and its first words.

    Raises
    ------
    InputError
        The file can't be read, or is none of them.
    """
    file = _read(source)
    text = _text(file)
    begin = text.lstrip()[:1]
    if file.suffix == ".caldat":
        return "matchid"
    if "<ParameterList" in text:
        return "dice"
    if begin == "<" and "opencv_storage" not in text[:500] and "<camera" in text.lower():
        return "vic"
    if begin in "<{%" and begin:
        return "opencv"
    if re.search(r"\bcamera_model\b", text):
        return "kalibr"
    if re.search(r"^\s*[\w\"'-]+\s*:", text, re.MULTILINE):
        return "opencv"
    raise InputError(
        f"calibration file {file.path}; got neither its suffix nor its contents known; expected "
        f"one of {sorted(FORMATS)}"
    )


def read_calibration(
    source: Source, size: tuple[int, int] | None = None, unit: str | None = None
) -> list[Camera]:
    """The cameras in a calibration file, in its order, lengths in metres.

    Parameters
    ----------
    source : the file. Of OpenCV's pair ``intrinsics.yml`` and ``extrinsics.yml`` either one, with
        the other beside it.
    size : (columns, rows) px, for files that don't say it (MatchID's, those that VIC itself wrote,
        some of OpenCV's).
    unit : "m", "cm", "mm", "um" or "in": the file's lengths, where it doesn't say so. Otherwise
        Kalibr's are metres and all others' millimetres.

    Raises
    ------
    InputError
        Not such a file, or content that has no like here: a fisheye model, another distortion
        than OpenCV's, a matrix that is no rotation; a unit that the file contradicts. It names the
        file and the key.

    Examples
    --------
    >>> import tempfile, pathlib, gpusim as gs
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "camera.yml"
    >>> camera = gs.Camera.from_lens((36, 24), 50, (640, 480), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> gs.write_calibration(path, [camera], "opencv", unit="mm")
    >>> bool(abs(gs.read_calibration(path)[0].camera_from_world[2, 3] - 2.0) < 1e-12)
    True
    """
    cameras, metres = read_rig(source, size, unit)
    return [_scaled(camera, metres) for camera in cameras]


def read_rig(
    source: Source, size: tuple[int, int] | None = None, unit: str | None = None
) -> tuple[list[Camera], float]:
    """The cameras in the file's own unit of length, and how many metres that is."""
    try:
        return _read_rig(source, size, unit)
    except InputError as error:
        text = str(error)
        if len(text) <= LONGEST_MESSAGE:
            raise
        # a damaged file may have anything in place of a number
        raise InputError(f"{text[: LONGEST_MESSAGE // 2]} … {text[-100:]}") from None


def _read_rig(source: Source, size: Size, unit: str | None) -> tuple[list[Camera], float]:
    file = _read(source)
    kind, text, where = calibration_format(file), _text(file), str(file.path)
    name = _unit(text, kind, where, unit)
    if kind == "opencv":
        document = read_document(text, where)
        partner = None if isinstance(source, InputFile) else _partner(file.path)
        if partner is not None and ("extrinsic" in file.path.name or needs_extrinsics(document)):
            other = _text(_read(partner))
            document = read_document(other, str(partner)) | document
        return cameras_of(document, where, size), UNITS[name]
    return FORMATS[kind].read(text, where, size), UNITS[name]


def write_calibration(
    path: str | PathLike[str],
    cameras: Sequence[Camera],
    format: str,
    unit: str | None = None,
) -> None:
    """Write cameras so that another program, or `read_calibration`, reads them again.

    MatchID's format has no place for the size of the pictures: `read_calibration` must be told its
    ``size`` then.

    Parameters
    ----------
    cameras : lengths in metres, as a scene's are.
    unit : of the lengths in an OpenCV file, "m" unless given; it says so itself. The other
        formats have one of their own: Kalibr's is the metre, all others' the millimetre.

    Raises
    ------
    InputError
        An unknown format or unit, no camera, or cameras that the format can't express; nothing is
        written.

    Examples
    --------
    >>> camera = gs.Camera.from_lens((36, 24), 50, (640, 480), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> gs.write_calibration("rig.yml", [camera], "opencv", unit="mm")
    >>> gs.read_calibration("rig.yml")[0].eye.round(6) + 0.0
    array([0., 0., 2.])
    """
    Path(path).write_text(calibration_text(cameras, format, unit, str(path)), encoding="utf-8")


def calibration_text(
    cameras: Sequence[Camera], format: str, unit: str | None, name: str,
    comments: Sequence[str] = (),
) -> str:  # fmt: skip
    """What `write_calibration` writes into a file of that ``name``, with ``comments`` where the
    format has a place for them."""
    where = f"write_calibration {name}"
    require_one_of(f"{where}: format", format, FORMATS)
    own = FORMATS[format]
    require(not isinstance(cameras, Camera), f"{where}: cameras", repr(cameras), "a list of Camera")
    fits = 1 <= len(cameras) <= own.most
    require(fits, f"{where}: cameras", len(cameras) or "none", f"1 to {own.most} for {format}")
    for camera in cameras:
        require(isinstance(camera, Camera), f"{where}: cameras", repr(camera), "a Camera")
        lacks = [one for one in lacking(camera, format) if (format, one) != ("opencv", "skew")]
        held = " ".join(COEFFICIENTS[k] for k in own.lens)
        expected = f"{held}, all that this format holds; gs.fit_lens(camera, {format!r}) comes near"
        require(not lacks, f"{where}: camera {camera.name!r}", " ".join(lacks), expected)
    names = [camera.name for camera in cameras]
    distinct = len(set(names)) == len(names) or format != "opencv"
    require(distinct, f"{where}: cameras", f"names {names}", "different ones")
    unit = unit or ("m" if format == "opencv" else own.unit)
    able = list(UNITS) if format == "opencv" else [own.unit]
    require(unit in able, f"{where}: unit", repr(unit), " or ".join(able))
    scaled = [_scaled(camera, 1.0 / UNITS[unit]) for camera in cameras]
    if format == "opencv":
        return write_opencv(scaled, unit, comments, Path(name).suffix.lower())
    return own.write(scaled, unit, comments)


def lacking(camera: Camera, format: str) -> list[str]:
    """What a camera has that the program knows nothing of. OpenCV's files can keep a skew, which
    its own functions pass over."""
    own, lens = FORMATS[format], coefficients(camera)
    lacks = [name for k, name in enumerate(COEFFICIENTS) if lens[k] and k not in own.lens]
    if camera.K[0, 1] and not own.skew:
        lacks.append("skew")
    if camera.lens is not None and not np.array_equal(camera.distorting_K, camera.K):
        lacks.append("lens_K")
    return lacks


def _scaled(camera: Camera, factor: float) -> Camera:
    pose = camera.camera_from_world.copy()
    pose[:3, 3] *= factor
    return replace(camera, camera_from_world=pose)


def _unit(text: str, kind: str, where: str, given: str | None) -> str:
    """The unit that a file states, else the one given, else its format's."""
    known = given is None or given in UNITS
    require(known, "calibration unit", repr(given), ", ".join(UNITS))
    match = _STATED.search(text)
    stated = match[1] if match else None
    if '"camera_from_first_mm"' in text:
        stated = "mm"
    known = stated is None or stated in UNITS
    require(known, f"{where}: length_unit", repr(stated), ", ".join(UNITS))
    one = not (stated and given) or stated == given
    got = f"{stated} there, and unit {given}"
    require(one, f"{where}: length_unit", got, "the unit of the file")
    return stated or given or FORMATS[kind].unit


def _partner(path: Path) -> Path | None:
    """OpenCV's file of extrinsics beside one of intrinsics, or the other way round."""
    for mine, other in (("intrinsic", "extrinsic"), ("extrinsic", "intrinsic")):
        beside = path.with_name(path.name.replace(mine, other))
        if mine in path.name and beside.is_file():
            return beside
    return None


def _read(source: Source) -> InputFile:
    return read_input(source, "a readable text: a calibration file")


def _text(file: InputFile) -> str:
    size = len(file.data)
    require(size <= LONGEST, f"{file.path}", f"{size} bytes", "a calibration file")
    return file.text("a readable text: a calibration file")
