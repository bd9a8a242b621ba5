"""Linear radiance as floating-point pictures: OpenEXR and TIFF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.export.images import save_tiff
from gpusim.files.atomic_files import PathLike, atomic_path
from gpusim.files.picture_file import openexr
from gpusim.optics.frame import Frame
from gpusim.validation import require

_LARGEST_HALF = 65504.0


def write_radiance(
    path: PathLike, frame: Frame | npt.NDArray[np.floating[Any]], *, half: bool = False
) -> Path:
    """Write linear radiance, before any sensor, in the format that the suffix of ``path`` names.

    Parameters
    ----------
    path
        Ends in ``.exr`` (needs ``pip install 'gpusim[exr]'``), ``.tif`` or ``.tiff``. Written
        atomically.
    frame
        A frame, or its radiance (H, W), written as the channel Y, or (H, W, 3), as R, G and B: the
        primaries of sRGB, as OpenEXR takes for granted.
    half
        16 bits a number (11 significant ones, up to 65504) in place of 32.

    Raises
    ------
    InputError
        Wrong suffix, shape or type; numbers that are too large for ``half``; OpenEXR is missing; or
        a place that can't be written to.

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (3, 2), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> gs.export.write_radiance("wall.tif", gs.render([wall], camera, backend="numpy")).name
    'wall.tif'
    """
    values = np.asarray(frame.radiance if isinstance(frame, Frame) else frame)
    got, shape = f"shape {values.shape}, {values.dtype}", values.shape
    known = values.dtype.kind == "f" and (values.ndim == 2 or shape[2:] == (3,))
    require(known, "radiance", got, "a Frame, or floats (H, W) or (H, W, 3)")
    require(0 not in shape, "radiance", f"shape {shape}", "at least one pixel")
    most = np.abs(values[np.isfinite(values)]).max(initial=0.0) if half else 0.0
    expected = f"at most {_LARGEST_HALF:g} with half"
    require(most <= _LARGEST_HALF, "radiance", f"up to {most:g}", expected)
    values = np.ascontiguousarray(values, np.float16 if half else np.float32)
    suffix = Path(path).suffix.lower()
    known = suffix in (".exr", ".tif", ".tiff")
    require(known, f"image file: {path}", f"suffix {suffix!r}", ".exr, .tif or .tiff")
    package = openexr(path) if suffix == ".exr" else None
    with atomic_path(path) as part:
        if package is None:
            save_tiff(part, values)
        else:
            header = {"compression": package.ZIP_COMPRESSION, "type": package.scanlineimage}
            channels = {"Y" if values.ndim == 2 else "RGB": values}
            package.File(header, channels).write(str(part))
    return Path(path)
