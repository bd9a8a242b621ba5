"""Linear radiance as floating-point pictures: OpenEXR and TIFF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.atomic_files import PathLike, atomic_path
from gpusim.optics.frame import Frame

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
    if values.dtype.kind != "f" or not (values.ndim == 2 or values.shape[2:] == (3,)):
        raise InputError(
            f"radiance: got shape {values.shape}, {values.dtype}; expected a Frame, or floats "
            "(H, W) or (H, W, 3)"
        )
    if 0 in values.shape:
        raise InputError(f"radiance: got shape {values.shape}; expected at least one pixel")
    finite = values[np.isfinite(values)]
    if half and not np.abs(finite).max(initial=0.0) <= _LARGEST_HALF:
        raise InputError(
            f"radiance: got up to {np.abs(finite).max():g}; expected at most {_LARGEST_HALF:g} "
            "with half"
        )
    values = np.ascontiguousarray(values, np.float16 if half else np.float32)
    suffix = Path(path).suffix.lower()
    if suffix not in (".exr", ".tif", ".tiff"):
        raise InputError(f"image file: {path}: got suffix {suffix!r}; expected .exr, .tif or .tiff")
    return _write_exr(path, values) if suffix == ".exr" else _write_tiff(path, values)


def _write_exr(path: PathLike, values: npt.NDArray[Any]) -> Path:
    try:
        import OpenEXR
    except ImportError:
        raise InputError(
            f"image file: {path}: got no package OpenEXR; expected it for .exr files: "
            "pip install 'gpusim[exr]'"
        ) from None
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with atomic_path(path) as part:
        OpenEXR.File(header, {"Y" if values.ndim == 2 else "RGB": values}).write(str(part))
    return Path(path)


def _write_tiff(path: PathLike, values: npt.NDArray[Any]) -> Path:
    import tifffile

    with atomic_path(path) as part:
        kind = "minisblack" if values.ndim == 2 else "rgb"
        tifffile.imwrite(part, values, photometric=kind, metadata=None, software="gpusim")
    return Path(path)
