"""Radiance as colours of a screen, on the device: exposed, with the curve of sRGB, enlarged."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.arrays.srgb import encoded
from gpusim.gpu import Device, Recording
from gpusim.optics.frame import Frame
from gpusim.optics.sensor.channels import Weights
from gpusim.visualization.placement import Placement


def draw_frame(
    device: Device,
    recording: Recording,
    target: Any,
    left: int,
    top: int,
    frame: Frame,
    exposure: float,
    *,
    weights: Weights | None = None,
    clear: bool = True,
) -> None:
    """Draw a frame over a target, pixel for pixel from a place there on; what lies beside it stays.

    ``target``: a `gpusim.gpu.Texture`, or what has its ``view``, ``format``, ``width`` and
    ``height``, of a format without "-srgb": the curve is put on here. ``exposure``: 1 / the
    radiance that is white. ``weights``: of red, green and blue, if the picture is grey all the
    same. ``clear``: the target is made black before.

    Examples
    --------
    >>> from gpusim.view.picture.display import draw_frame
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (60, 40), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> frame = gs.render([wall], camera)
    >>> target = frame.device.texture(60, 40, "rgba8unorm", "screen")
    >>> with frame.device.recording("view") as recording:
    ...     draw_frame(frame.device, recording, target, 0, 0, frame, 1.0)
    """
    raster = device.raster(
        "view/picture/display", (target.format,), {"coloured": float(frame.coloured)}, depth="none"
    )
    planes = frame.planes
    bands = zip(*(planes[k % len(planes)].bands for k in range(3)), strict=True)
    for red, green, blue in bands:
        bindings = raster.bind(
            params={
                "size": (target.width, target.height), "place": (left, top + red.row0),
                "width": frame.width, "rows": red.rows, "stride": red.stride,
                "exposure": exposure, "weights": (*(weights or (0.0, 0.0, 0.0)), 0.0),
            },
            red=red.buffer, green=green.buffer, blue=blue.buffer,
        )  # fmt: skip
        recording.draw(
            raster, bindings, colors=(target,), depth=None, vertices=6,
            size=(target.width, target.height), clear=0.0 if clear else None,
        )  # fmt: skip
        clear = False


def draw_enlarged(
    device: Device,
    recording: Recording,
    target: Any,
    place: Placement,
    frame: Frame,
    exposure: float,
    weights: Weights | None = None,
) -> None:
    """Draw a frame over a target made black, at its place there, interpolated between its pixels.

    As colours of the screen: a frame with fewer pixels than its place has looks better by no other
    way, and none is as quick.
    """
    small = device.target(frame.width, frame.height, "rgba8unorm", "view.small")
    draw_frame(device, recording, small, 0, 0, frame, exposure, weights=weights)
    raster = device.raster("view/picture/enlarge", (target.format,), depth="none")
    bindings = raster.bind(
        params={
            "size": (target.width, target.height), "place": (place.x, place.y),
            "scale": place.scale,
        },
        picture=small, smooth_sampler=device.smooth_sampler,
    )  # fmt: skip
    recording.draw(
        raster, bindings, colors=(target,), depth=None, vertices=6,
        size=(target.width, target.height), clear=0.0,
    )  # fmt: skip


def display_twin(
    radiance: npt.NDArray[np.floating[Any]], exposure: float, weights: Weights | None = None
) -> Float:
    """Colours (H, W, 3), 0 to 1, of a picture (H, W) or (H, W, 3)."""
    grey = weights is not None and radiance.ndim == 3
    values = np.atleast_3d(radiance @ np.array(weights) if grey else radiance).astype(np.float64)
    shown = encoded(np.clip(exposure * values, 0.0, 1.0))
    return np.broadcast_to(shown, (*values.shape[:2], 3))


def enlarged_twin(colors: Float, width: int, height: int, scale: float) -> Float:
    """Colours (height, width, 3) of a target, from whose corner on the pixels of a picture
    (H, W, 3) are ``scale`` px wide; 0 beside it."""
    values = colors
    inside = np.ones((height, width, 1), bool)
    for axis, size in ((0, height), (1, width)):
        count = values.shape[axis]
        at = (np.arange(size) + 0.5) / scale
        along = [-1 if k == axis else 1 for k in range(3)]
        inside &= (at < count).reshape(along)
        low = np.floor(at - 0.5).astype(int)
        share = (at - 0.5 - low).reshape(along)
        ends = [np.take(values, np.clip(low + k, 0, count - 1), axis) for k in (0, 1)]
        values = (1.0 - share) * ends[0] + share * ends[1]
    return np.where(inside, values, 0.0)
