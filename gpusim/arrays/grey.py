"""Grey from colour, in the one way in which everything that measures takes it.

The luminance of linear sRGB (ITU-R BT.709): green, which has half of a Bayer mosaic's pixels and so
the least noise and blur, counts most.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""What red, green and blue count for."""


def grey_of(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The grey picture (H, W) of one in red, green and blue (H, W, 3); anything else as it is.

    Floating point, of a type that holds the image's; where all channels are equal, their numbers.
    """
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype.kind not in "uif":
        return image
    if (image == image[..., :1]).all():
        return np.ascontiguousarray(image[..., 0])
    kind = np.result_type(image.dtype, np.float32)
    return np.asarray(image.astype(kind) @ np.array(LUMINANCE, kind))
