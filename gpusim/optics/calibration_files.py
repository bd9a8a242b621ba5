"""Cameras from and to the calibration files of other programs.

| format | file | lengths | distortion | rotation |
|---|---|---|---|---|
| opencv | FileStorage .yml .yaml .xml .json | the board's unit | all of OpenCV's | matrices |
| kalibr | camchain .yaml, pinhole + radtan | m | k1 k2 p1 p2 | 4 x 4 from one camera to the next |
| matchid | .caldat | mm | k1 k2 k3 p1 p2 | Theta, Phi, Psi in degrees |
| vic | .xml with <camera> (project.xml of a .z3d) | mm | k1 k2 k3 | alpha, beta, gamma in degrees |
| dice | camera system .xml | mm | all of OpenCV's | matrix, or ALPHA, BETA, GAMMA |

Pixel centres are whole numbers and the first pixel's is (0, 0) in all of them. Skew is K[0, 1] in
px (MatchID's and DICe's Fs, VIC's fifth number): x = fx X + Fs Y + cx; OpenCV's own functions
ignore it, Kalibr has none. Three angles make R = Rz(third) Ry(second) Rx(first), and X_camera =
R X + T. The frame of Kalibr and MatchID is that of the first camera, that of VIC and DICe a world.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from gpusim.errors import InputError
from gpusim.input_file import InputFile
from gpusim.optics.calibration_opencv import read_opencv, write_opencv
from gpusim.optics.calibration_text import read_kalibr, read_matchid, write_kalibr, write_matchid
from gpusim.optics.calibration_xml import read_dice, read_vic, write_dice, write_vic
from gpusim.optics.camera import Camera

__all__ = ["UNIT_MM", "calibration_format", "read_calibration", "write_calibration"]

Size = tuple[int, int] | None

UNIT_MM = {"opencv": 1.0, "kalibr": 1000.0, "matchid": 1.0, "vic": 1.0, "dice": 1.0}
"""Length of a format's unit, mm; OpenCV's is that of the board, by habit a millimetre."""

_READ: dict[str, Callable[[str, str, Size], list[Camera]]] = {
    "opencv": read_opencv,
    "kalibr": read_kalibr,
    "matchid": read_matchid,
    "vic": read_vic,
    "dice": read_dice,
}
_WRITE: dict[str, Callable[[Sequence[Camera], str], str]] = {
    "opencv": write_opencv,
    "kalibr": write_kalibr,
    "matchid": write_matchid,
    "vic": write_vic,
    "dice": write_dice,
}


def calibration_format(path: str | Path | InputFile) -> str:
    """Which program's calibration a file holds, by its name and its first words.

    Raises
    ------
    InputError
        The file can't be read, or is none of them.
    """
    text, file = _text(path), path.path if isinstance(path, InputFile) else Path(path)
    if file.suffix.lower() == ".caldat":
        return "matchid"
    if "opencv_storage" in text[:500] or text.lstrip().startswith(("%YAML", "{")):
        return "opencv"
    if "<ParameterList" in text:
        return "dice"
    if "<camera" in text.lower() and "<" in text.lstrip()[:1]:
        return "vic"
    if "camera_model:" in text:
        return "kalibr"
    raise InputError(
        f"calibration file {file}; got neither its suffix nor its contents known; expected one of "
        f"{sorted(_READ)}"
    )


def read_calibration(
    path: str | Path | InputFile, size: tuple[int, int] | None = None
) -> list[Camera]:
    """The cameras in a calibration file, in its order and unit of length.

    Parameters
    ----------
    size : (columns, rows) px, for files that don't say it (MatchID, VIC, some of OpenCV's).

    Raises
    ------
    InputError
        Not such a file, or content that has no like here: a fisheye model, another distortion
        than OpenCV's, a matrix that is no rotation. It names the file and the key.
    """
    name = str(path.path if isinstance(path, InputFile) else path)
    return _READ[calibration_format(path)](_text(path), name, size)


def write_calibration(path: str | Path, cameras: Sequence[Camera], format: str) -> None:
    """Write cameras so that another program, or `read_calibration`, reads them again.

    Raises
    ------
    InputError
        An unknown format, no camera, or cameras that the format can't express; nothing is written.
    """
    if format not in _WRITE:
        raise InputError(f"write_calibration format; got {format!r}; expected {sorted(_WRITE)}")
    if not cameras:
        raise InputError("write_calibration cameras; got none; expected at least one")
    for camera in cameras:
        if not isinstance(camera, Camera):
            raise InputError(f"write_calibration cameras; got {camera!r}; expected a Camera")
    names = [camera.name for camera in cameras]
    if len(set(names)) < len(names) and format == "opencv":
        raise InputError(f"write_calibration cameras; got names {names}; expected different ones")
    text = _WRITE[format](cameras, f"write_calibration {path}")
    Path(path).write_text(text, encoding="utf-8")


def _text(path: str | Path | InputFile) -> str:
    if isinstance(path, InputFile):
        return path.text("a calibration file")
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"calibration file {path}; got {error}; expected a readable text"
        ) from None
