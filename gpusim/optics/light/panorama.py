"""Pictures of surroundings: radiances in files, equirectangular."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.arrays.grey import grey_of
from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input
from gpusim.files.picture_file import decoding, read_picture
from gpusim.validation import require

PANORAMA_SUFFIXES = (".hdr", ".pic", ".exr", ".tif", ".tiff", ".npy")


def read_panorama(path: str | os.PathLike[str] | InputFile, channels: str = "rgb") -> Float:
    """A picture of radiances as float64: (H, W) if it is grey, else (H, W, 3) of red, green, blue.

    Radiance (.hdr, .pic), OpenEXR and TIFF files of floats, and .npy arrays (H, W) or (H, W, 3) of
    red, green and blue. Exposures that a Radiance file states are divided out; colours that it or
    OpenEXR states in other primaries become those of sRGB, white staying white. Pictures of 8 or 16
    bit are refused: lamps in them are cut off at white. With the ``channels`` "grey", colours count
    by their luminance (ITU-R BT.709).

    Raises
    ------
    InputError
        Names the file: absent, damaged, of another kind, or values below 0 or not finite. Or other
        ``channels``.
    """
    require(channels in ("rgb", "grey"), "panorama channels", repr(channels), "'rgb' or 'grey'")
    file = path.path if isinstance(path, InputFile) else Path(path)
    expected = f"a picture of radiances, one of {', '.join(PANORAMA_SUFFIXES)}"
    if not isinstance(path, InputFile) and not file.exists():
        raise InputError(f"{file}: no such file; expected {expected}")
    suffix = file.suffix.lower()
    known = suffix in PANORAMA_SUFFIXES
    require(known, f"{file}: unknown kind of picture", repr(suffix), expected)
    whole = read_input(path, expected)
    if suffix == ".npy":
        with decoding(whole):
            pixels = np.load(whole.stream(), allow_pickle=False)
    else:
        pixels = read_picture(whole)
    fits = pixels.dtype.kind == "f" and (pixels.ndim == 2 or pixels.shape[2:] == (3,))
    got = f"{pixels.dtype} of shape {pixels.shape}"
    require(fits, f"{file}: no radiances", got, "floats, grey or of three colours")
    values: Float = pixels.astype(np.float64)
    fits = bool(np.isfinite(values).all() and (values >= 0.0).all())
    require(fits, f"{file}: radiances", "values below 0 or not finite", "from 0 up")
    if channels == "rgb" and values.ndim == 3 and (values != values[..., :1]).any():
        return values
    return grey_of(values)
