"""A camera as near as a calibration format comes to it, and how far off that is.

Where a format has no place for a coefficient of the lens, or for skew, the others are refitted, and
with them the focal lengths, the principal point and the camera's turn about its own centre: such a
turn moves what it sees in all depths alike. So does whoever calibrates with that lens model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.optics.calibration.document import coefficients
from gpusim.optics.calibration.formats import FORMATS, lacking
from gpusim.optics.camera.pinhole import Camera
from gpusim.validation import require, require_one_of

_ACROSS, _DOWN = 33, 25
"""Places in the image, borders included, that are compared."""


@dataclass(frozen=True)
class LensFit:
    """A camera that a format can hold.

    Attributes
    ----------
    camera : the true one, where the format holds all of it.
    rms, largest : px, how far from its true place the camera has what it sees, over the image.
    words : what was done, "" for nothing.

    Examples
    --------
    >>> K = [[2000, 0, 320], [0, 2000, 240], [0, 0, 1]]
    >>> camera = gs.Camera(640, 480, K, [-0.1, 0.05, 1e-3, 0.0])
    >>> fit = gs.fit_lens(camera, "vic")
    >>> fit.words.split(",")[0], fit.largest < 0.05
    ('vic has no p1: lens refitted', True)
    """

    camera: Camera
    rms: float = 0.0
    largest: float = 0.0
    words: str = ""
    __repr__ = field_summary


def fit_lens(camera: Camera, format: str) -> LensFit:
    """The camera with what a calibration ``format`` has of the lens.

    Parameters
    ----------
    camera : any.
    format : "opencv", "kalibr", "matchid", "vic" or "dice".

    Returns
    -------
    LensFit
        A camera that ``gs.write_calibration`` takes for this format, and what it is off by. Its
        position is the camera's own.

    Raises
    ------
    InputError
        An unknown format, or a lens to which the format's comes so badly that it would fold in the
        image.

    Examples
    --------
    >>> camera = gs.Camera.from_lens((36, 24), 50, (640, 480), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> gs.fit_lens(camera, "kalibr").camera is camera
    True
    """
    require_one_of("fit_lens: format", format, FORMATS)
    lacks = lacking(camera, format)
    if not lacks:
        return LensFit(camera)
    pixels = np.stack(np.meshgrid(np.linspace(-0.5, camera.width - 0.5, _ACROSS),
                                  np.linspace(-0.5, camera.height - 0.5, _DOWN)),
                      axis=-1).reshape(-1, 2)  # fmt: skip
    ideal = np.concatenate([camera.undistort(pixels), np.ones((len(pixels), 1))], axis=1)
    rays = ideal @ camera.ray_matrix().T
    try:
        fitted = _fitted(camera, rays, pixels, format)
    except InputError as error:
        raise InputError(f"no lens of {format} comes near: {error}") from None
    off = np.linalg.norm(fitted.project(rays @ camera.camera_from_world[:3, :3] + camera.eye)
                         - pixels, axis=1)  # fmt: skip
    what, expected = f"camera {camera.name!r}: lens", f"one that {format} comes near to"
    require(np.isfinite(off).all(), what, "one that bends too far", expected)
    rms, largest = float(np.sqrt(np.mean(off**2))), float(off.max())
    turn = cv2.Rodrigues(fitted.camera_from_world[:3, :3] @ camera.camera_from_world[:3, :3].T)[0]
    words = f"{format} has no {' '.join(lacks)}: lens refitted, camera turned by "
    words += f"{np.degrees(np.linalg.norm(turn)):.4f} deg, "
    words += f"off by RMS {rms:.4f} px, {largest:.4f} px at most"
    return LensFit(fitted, rms, largest, words)


def _fitted(camera: Camera, rays: Float, pixels: Float, format: str) -> Camera:
    """The camera of a ``format`` that has ``rays`` (n, 3) of its own frame nearest to their
    ``pixels`` (n, 2), in the sense of least squares."""
    from scipy.optimize import least_squares  # seldom: most lenses have a place in the file

    K, held, skew = camera.K, list(FORMATS[format].lens), FORMATS[format].skew

    def parts(values: Float) -> tuple[Float, Float, Float]:
        """The turn (3,), the matrix (3, 3), the 14 coefficients."""
        fx, fy, cx, cy, shear = values[3:8]
        lens = np.zeros(14)
        lens[held] = values[8:]
        shear = shear if skew else 0.0
        return values[:3], np.array([[fx, shear, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), lens

    def off(values: Float) -> Float:
        turn, matrix, lens = parts(values)
        seen = cv2.projectPoints(rays, turn, np.zeros(3), matrix, lens)[0].reshape(-1, 2)
        seen[:, 0] += matrix[0, 1] / matrix[1, 1] * (seen[:, 1] - matrix[1, 2])
        return np.asarray((seen - pixels).ravel())

    start = [0, 0, 0, K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 1], *coefficients(camera)[held]]
    turn, matrix, lens = parts(least_squares(off, start, x_scale="jac").x)
    moved = np.eye(4)
    moved[:3, :3] = cv2.Rodrigues(turn)[0]
    pose = moved @ camera.camera_from_world
    short = lens[:5] if not lens[5:].any() else lens
    return replace(camera, K=matrix, distortion=short, camera_from_world=pose, lens_K=None)
