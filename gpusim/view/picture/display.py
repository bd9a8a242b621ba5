"""Radiance as colours of a screen, on the device: scaled, exposed, with the curve of sRGB."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.srgb import encoded
from gpusim.gpu import Device, Recording
from gpusim.optics.frame import Frame
from gpusim.view.placement import Placement

__all__ = ["display_twin", "draw_frame"]


def draw_frame(
    device: Device,
    recording: Recording,
    target: Any,
    place: Placement,
    frame: Frame,
    exposure: float,
    *,
    first_row: int = 0,
    rows: int | None = None,
    clear: bool = True,
    smooth: bool = True,
) -> None:
    """Draw a frame over a target, at its place there; what lies beside it stays.

    ``target``: a `gpusim.gpu.Texture`, or what has its ``view``, ``format``, ``width`` and
    ``height``, of a format without "-srgb": the curve is put on here. ``exposure``: 1 / the
    radiance that is white. ``first_row``, ``rows``: the frame is a part of a picture of so many
    rows, and begins there. ``clear``: the target is made black before. ``smooth``: interpolated
    between pixels where the sizes differ, within each of the frame's bands.

    Examples
    --------
    >>> from gpusim.view.picture.display import draw_frame
    >>> from gpusim.view.placement import Placement
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> frame = gs.render([wall], camera)
    >>> target = frame.device.texture(60, 40, "rgba8unorm", "screen")
    >>> with frame.device.recording("view") as recording:
    ...     draw_frame(frame.device, recording, target, Placement(scale=10.0), frame, 1.0)
    """
    height = rows or frame.height
    raster = device.raster(
        "view/picture/display", (target.format,), {"coloured": float(frame.coloured)}, depth="none"
    )
    for red, green, blue in zip(*_three(frame.planes), strict=True):
        bindings = raster.bind(
            params={
                "width": frame.width, "height": height, "row0": first_row + red.row0,
                "rows": red.rows, "stride": red.stride, "blend": int(smooth),
                "left": place.x, "top": place.y, "scale": 1.0 / place.scale, "exposure": exposure,
            },
            red=red.buffer, green=green.buffer, blue=blue.buffer,
        )  # fmt: skip
        recording.draw(
            raster, bindings, colors=(target,), depth=None, vertices=3,
            size=(target.width, target.height), clear=0.0 if clear else None,
        )  # fmt: skip
        clear = False


def _three(planes: Sequence[Frame]) -> list[Any]:
    """Bands of red, green and blue."""
    return [planes[k % len(planes)].bands for k in range(3)]


def display_twin(
    radiance: npt.NDArray[np.floating[Any]],
    width: int,
    height: int,
    exposure: float,
    scale: float = 1.0,
    smooth: bool = True,
) -> npt.NDArray[np.float64]:
    """Colours (height, width, 3), 0 to 1, of a picture (H, W) or (H, W, 3) from a target's corner
    on, where its pixels are ``scale`` px wide; 0 beside it."""
    values = np.atleast_3d(radiance).astype(np.float64)
    values = np.broadcast_to(values, (*values.shape[:2], 3))
    inside = np.ones((height, width, 1), bool)
    for axis, size in ((0, height), (1, width)):
        count = values.shape[axis]
        at = (np.arange(size) + 0.5) / scale
        along = [-1 if k == axis else 1 for k in range(3)]
        inside &= (at < count).reshape(along)
        low = np.floor(at - 0.5 if smooth else at).astype(int)
        share = (at - 0.5 - low if smooth else np.zeros(size)).reshape(along)
        ends = [np.take(values, np.clip(low + k, 0, count - 1), axis) for k in (0, 1)]
        values = (1.0 - share) * ends[0] + share * ends[1]
    value = np.where(inside, np.clip(exposure * values, 0.0, 1.0), 0.0)
    return encoded(value)
