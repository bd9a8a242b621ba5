"""A frame: the picture itself, and what it is of."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Single
from gpusim.export.images import encoded_picture
from gpusim.notebook.axes import flat_axes
from gpusim.notebook.page import Picture, page, span
from gpusim.notebook.shading import encoded
from gpusim.optics.frame import Frame
from gpusim.report.html import fitting
from gpusim.report.style import named

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH, _HEIGHT = 640, 480  # px, at most
_WHITE = 0.998
"""Share of the pixels that aren't cut off at white: lamps and glints may be."""
_UNIT = "W/(m² sr), or albedo without lights"


def html(frame: Frame) -> str:
    """Size, camera, radiance; the picture."""
    camera = frame.view.camera
    rows = [
        ("size", f"{frame.width} x {frame.height} px, {'colour' if frame.coloured else 'grey'}"),
        ("camera", camera.name),
        ("rendered by", frame.device.name if frame.device is not None else "NumPy"),
    ]
    if frame.released:
        return page("Frame", rows, notes=["It was released: its picture is gone."])
    rows.insert(2, ("radiance", f"{span(frame.radiance)} {_UNIT}"))
    rows += list(frame.facts.items())
    return page("Frame", rows, [partial(_picture, frame)], frame.warnings)


def png(frame: Frame) -> bytes | None:
    """The picture as a file; None of a released frame."""
    return None if frame.released else encoded_picture(toned(_small(frame.radiance)), ".png")


def plot(frame: Frame, ax: Axes | None, **style: Any) -> Axes:
    """The radiance with its scale where it is grey, else the picture; axes in px."""
    ax = flat_axes(ax)
    if frame.coloured:
        ax.imshow(toned(frame.radiance), **style)
    else:
        dark = {} if "norm" in style else {"vmin": 0.0}
        drawn = ax.imshow(frame.radiance, **{"cmap": "gray", **dark, **style})
        ax.figure.colorbar(drawn, ax=ax, shrink=0.8).set_label("radiance (W/(m² sr))")
    ax.set(xlabel="column (px)", ylabel="row (px)", title=named(frame.view.camera.name))
    return ax


def _picture(frame: Frame) -> Picture:
    pixels = toned(_small(frame.radiance))
    # a tiny picture is shown by squares that can be seen
    zoom = max(1, int(min(_WIDTH / pixels.shape[1], _HEIGHT / pixels.shape[0]) / 2))
    caption = "Tone-mapped: linear up to white, then sRGB."
    if zoom > 1:
        pixels = pixels.repeat(zoom, axis=0).repeat(zoom, axis=1)
        caption += f" Each pixel is drawn as {zoom} x {zoom}."
    return Picture(f"what camera {frame.view.camera.name} sees", pixels, caption)


def _small(radiance: Single) -> Single:
    """By area average."""
    size = fitting(radiance.shape, _WIDTH, _HEIGHT)
    if size == radiance.shape[1::-1]:
        return radiance
    return np.asarray(cv2.resize(radiance, size, interpolation=cv2.INTER_AREA), np.float32)


def toned(radiance: Single) -> npt.NDArray[np.uint8]:
    """sRGB; white is what all but a few pixels stay below."""
    known = radiance[np.isfinite(radiance)]
    white = float(np.quantile(known, _WHITE)) if known.size else 0.0
    white = white if white > 0.0 else float(known.max(initial=0.0)) or 1.0
    return encoded(np.nan_to_num(radiance) / white)
