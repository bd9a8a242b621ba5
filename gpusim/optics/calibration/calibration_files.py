"""The calibration files of a rig, as each program wants to have them.

======= ======================== ================== ==============================================
format  files                    frame (see below)  source
======= ======================== ================== ==============================================
opencv  each camera, each pair   the scene's        samples calibration.cpp and stereo_calib.cpp
matchid each camera, each pair   the first camera's .caldat of the stereo DIC challenge, pyvale
vic     one                      the scene's        project.xml in a .z3d of VIC-3D
dice    one, up to 10 cameras    the scene's        DICe_CameraSystem.cpp, DICe_Camera.cpp
kalibr  one                      the first camera's "yaml formats" of Kalibr's wiki
======= ======================== ================== ==============================================

The frame is that of X in X_camera = R X + T, where the first camera may have been turned as its
lens was refitted; M1 D1 M2 D2 R T of an OpenCV pair lead from the first
camera to the second. Lengths are millimetres, Kalibr's metres; angles are those of
`gpusim.optics.calibration.formats`. Files are named by the format and, where there are several, by
their cameras: ``vic.xml``, ``matchid-left+right.caldat``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from os import PathLike

from gpusim.field_summary import field_summary
from gpusim.files.atomic_files import safe_name, write_text
from gpusim.files.output_folder import inside
from gpusim.optics.calibration.formats import FORMATS, calibration_text
from gpusim.optics.calibration.lens_fit import LensFit, fit_lens
from gpusim.optics.camera.pinhole import Camera
from gpusim.printable import printable
from gpusim.validation import require, require_one_of

_IN_PARTS = ("opencv", "matchid")
"""Whose files hold one camera or two."""


@dataclass(frozen=True)
class CalibrationFile:
    """A file of a ``format``: its ``name``, its ``text``, and what became of each camera in it:
    ``fits``."""

    format: str
    name: str
    text: str
    fits: Sequence[LensFit]
    __repr__ = field_summary


def calibration_files(cameras: Sequence[Camera], formats: Sequence[str]) -> list[CalibrationFile]:
    """The files of a rig in some ``formats``; ``cameras`` in metres, each of another name.

    Raises
    ------
    InputError
        As `gpusim.optics.calibration.lens_fit.fit_lens`, and for more cameras than a file takes.
    """
    names = [safe_name(camera.name) for camera in cameras]
    expected = "different ones, without blanks and signs, too"
    got = f"names {[camera.name for camera in cameras]}"
    require(len(set(names)) == len(names), "calibration files: cameras", got, expected)
    files = []
    for format in formats:
        fits = {camera.name: fit_lens(camera, format) for camera in cameras}
        for stem, own in _parts(format, cameras):
            name, used = stem + FORMATS[format].ending, [fits[camera.name] for camera in own]
            comments = [
                f"camera {k}: {printable(fit.camera.name)}" + f"; {fit.words}" * bool(fit.words)
                for k, fit in enumerate(used)
            ]
            own_unit = FORMATS[format].unit
            text = calibration_text([fit.camera for fit in used], format, own_unit, name, comments)
            files.append(CalibrationFile(format, name, text, used))
    return files


def _parts(format: str, cameras: Sequence[Camera]) -> Iterator[tuple[str, Sequence[Camera]]]:
    """Names, without their ending, and cameras of a format's files."""
    if format not in _IN_PARTS:
        yield format, cameras
        return
    for count in (1, 2):
        for own in combinations(cameras, count):
            yield f"{format}-{'+'.join(safe_name(camera.name) for camera in own)}", own


def write_calibration_files(
    folder: str | PathLike[str], cameras: Sequence[Camera], formats: Sequence[str] = tuple(FORMATS)
) -> dict[str, float]:
    """Write a rig's calibration files for other programs.

    Parameters
    ----------
    folder : made if need be.
    cameras : lengths in metres, as a scene's are; names become names of files.
    formats : some of "opencv", "kalibr", "matchid", "vic", "dice". One that lacks part of a lens
        gets the lens refitted (``gs.fit_lens``).

    Returns
    -------
    dict
        Names of the files, and the largest error of a refitted lens in each, px; 0 where all is
        exact.

    Raises
    ------
    InputError
        An unknown format, more cameras than it takes, names that would be those of the same
        files, or a lens that it doesn't come near to; nothing is written.

    Examples
    --------
    >>> camera = gs.Camera.from_lens((36, 24), 50, (640, 480), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> gs.write_calibration_files("rig", [camera], ["vic", "matchid"])
    {'vic.xml': 0.0, 'matchid-camera.caldat': 0.0}
    >>> len(gs.read_calibration("rig/vic.xml"))
    1
    """
    for format in formats:
        require_one_of("write_calibration_files: format", format, FORMATS)
    for camera in cameras:
        given, wanted = (
            isinstance(camera, Camera),
            "a Camera (of a scene: scene.cameras().values())",
        )
        require(given, "write_calibration_files: cameras", repr(camera), wanted)
    files = calibration_files(cameras, formats)
    for file in files:
        write_text(inside(folder, file.name), file.text)
    return {file.name: max(fit.largest for fit in file.fits) for file in files}
