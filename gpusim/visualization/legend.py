"""The legend of a picture's colours: a bar with ticks and a title."""

from __future__ import annotations

import numpy as np

from gpusim.visualization.color_scale import ColorScale, format_value
from gpusim.visualization.overlay import INK, PAPER, Overlay


def _labels(scale: ColorScale) -> list[str]:
    """What stands at the ticks."""
    step = float(np.diff(scale.ticks).min()) if len(scale.ticks) > 1 else None
    return [format_value(tick, step) for tick in scale.ticks]


def legend_width(overlay: Overlay, scale: ColorScale, title: str, size: float) -> float:
    """Of what `draw_legend` draws, px."""
    beside = max((overlay.text_width(label, size) for label in _labels(scale)), default=0.0)
    bar = round(1.2 * size) + round(0.45 * size) + 6 + beside
    return float(round(2 * round(0.8 * size) + max(overlay.text_width(title, size), bar)))


def draw_legend(
    overlay: Overlay,
    scale: ColorScale,
    title: str,
    right: float,
    y: float,
    height: float,
    size: float,
) -> tuple[float, float]:
    """The bar of colours with its ticks and title; returns the width and height it takes, px.

    (right, y): top right corner; ``height``: of the bar; ``size``: of the letters. Values beyond
    an end are told by a tip there.
    """
    wide = legend_width(overlay, scale, title, size)
    x, y, height = round(right - wide), round(y), round(height)
    pad, bar, tip = round(0.8 * size), round(1.2 * size), round(0.7 * size)
    mark = round(0.45 * size)
    tall = 2 * pad + round(1.8 * size) + height + 2 * tip
    overlay.rectangle(x, y, wide, tall, PAPER)
    overlay.text(x + pad, y + pad, title, size, INK)
    left, top = x + pad, y + pad + round(1.8 * size) + tip
    colors = scale.colors
    rows = (np.arange(height)[::-1] + 0.5) / height * (len(colors) - 1)
    corners = np.array([[left, 0.0], [left + bar, 0.0], [left + bar, 1.0], [left, 1.0]])
    strips = corners + np.stack([np.zeros(height), top + np.arange(height)], axis=1)[:, None]
    shades = np.ones((height, 4))
    shades[:, :3] = colors[np.rint(rows).astype(int)]
    overlay.polygons(strips.astype(np.float64), shades)
    middle = left + 0.5 * bar
    if scale.above:
        overlay.polygon([(left, top), (middle, top - tip), (left + bar, top)], tuple(colors[-1]))
    if scale.below:
        end = top + height
        overlay.polygon([(left, end), (left + bar, end), (middle, end + tip)], tuple(colors[0]))
    for tick, label in zip(scale.ticks, _labels(scale), strict=True):
        share = (scale.high - tick) / (scale.high - scale.low)
        at = top + min(max(round(share * height - 0.5), 0), height - 1)
        overlay.rectangle(left + bar, at, mark, 1, INK)
        overlay.text(left + bar + mark + 5, at + 0.5, label, size, INK, anchor="lm")
    return wide, float(tall)
