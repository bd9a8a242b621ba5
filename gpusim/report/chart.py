"""Panels on a page: axes and numbers around them, laid out so that all labels fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gpusim.export.files import PathLike
from gpusim.report.canvas import Box, Canvas, pixels, text_size
from gpusim.report.panel import Floats, Panel, ToPixels
from gpusim.report.style import GRID, MUTED
from gpusim.report.ticks import Ticks, decades, round_ticks

__all__ = ["draw_chart"]

_GAP = 5.0  # points between labels
_PAD = 6.0  # points around a page
_TICK = 3.5  # points


@dataclass(frozen=True)
class _Axes:
    """A panel's ranges and numbers, and the room that its labels take: left, top, right, bottom."""

    panel: Panel
    x: tuple[float, float]
    y: tuple[float, float]
    x_ticks: Ticks
    y_ticks: Ticks
    right_ticks: Ticks | None
    room: tuple[float, float, float, float]


def draw_chart(
    path: PathLike,
    size: tuple[float, float],
    rows: Sequence[Sequence[Panel]],
    heights: Sequence[float] = (),
) -> None:
    """Draw rows of panels on a page of ``size`` inches; ``heights`` are the rows' relative ones.

    Written as a PNG, whole or not at all. Raises as `gpusim.export.write_image` does.
    """
    canvas = Canvas(size)
    width, height = canvas.box[2:]
    axes = [[_axes(panel) for panel in row] for row in rows]
    shares = np.asarray(heights or [1.0] * len(rows), np.float64)
    pad = pixels(_PAD)
    above = [max(one.room[1] for one in row) for row in axes]
    below = [max(one.room[3] for one in row) for row in axes]
    left = max(row[0].room[0] for row in axes)
    right = max(row[-1].room[2] for row in axes)
    free = height - sum(above) - sum(below) - (len(rows) + 1) * pad
    top = 0.0
    for row, share, over, under in zip(axes, shares / shares.sum(), above, below, strict=True):
        top += pad + over
        bottom = top + max(free, 0.2 * height) * float(share)
        first = [left, *(one.room[0] for one in row[1:])]
        last = [*(one.room[2] for one in row[:-1]), right]
        inner = (width - sum(first) - sum(last) - (len(row) + 1) * pad) / len(row)
        x = 0.0
        for one, before, after in zip(row, first, last, strict=True):
            one = replace(one, room=(before, one.room[1], one.room[2], one.room[3]))
            x += pad + before
            _draw(canvas, one, (round(x), round(top), round(x + inner), round(bottom)))
            x += inner + after
        top = bottom + under
    canvas.save(path)


def _axes(panel: Panel) -> _Axes:
    x, y = panel.ranges()
    letters = text_size("0")[1]
    gap, tick = pixels(_GAP), pixels(_TICK)
    x_ticks = round_ticks(*x, 7, panel.whole)
    y_ticks = decades(*y, panel.rows) if panel.log else round_ticks(*y, panel.rows)
    if panel.names:
        y_ticks = Ticks(tuple(map(float, range(len(panel.names)))), tuple(panel.names))
    right_ticks = None
    above = letters + gap if panel.title else 0.5 * letters
    if panel.bare:
        return _Axes(panel, x, y, x_ticks, y_ticks, None, (0.0, above, 0.0, 0.0))
    left = max((text_size(label)[0] for label in y_ticks.labels), default=0.0) + tick + gap
    left += letters + 1.5 * gap if panel.y_label else 0.0
    right = 0.5 * text_size(x_ticks.labels[-1] if x_ticks.labels else "")[0]
    if panel.right:
        right_ticks = round_ticks(y[0] / panel.right, y[1] / panel.right, panel.rows)
        right = max((text_size(label)[0] for label in right_ticks.labels), default=0.0)
        right += tick + 2.5 * gap + letters
    below = letters + tick + gap + (letters + gap if panel.x_label else 0.0)
    return _Axes(panel, x, y, x_ticks, y_ticks, right_ticks, (left, above, right, below))


def _draw(canvas: Canvas, axes: _Axes, box: Box) -> None:
    panel, (left, top, right, bottom) = axes.panel, box
    if right - left < 8 or bottom - top < 8:
        return
    if panel.title:
        canvas.text(left, top - pixels(_GAP), panel.title, bold=True, down=1.0)
    (x0, x1), (y0, y1) = axes.x, axes.y
    if panel.equal:
        unit = max((x1 - x0) / (right - left), (y1 - y0) / (bottom - top))
        grow = 0.5 * (unit * (right - left) - (x1 - x0)), 0.5 * (unit * (bottom - top) - (y1 - y0))
        x0, x1, y0, y1 = x0 - grow[0], x1 + grow[0], y0 - grow[1], y1 + grow[1]
        x_ticks, y_ticks = round_ticks(x0, x1, 6), round_ticks(y0, y1, panel.rows)
    else:
        x_ticks, y_ticks = axes.x_ticks, axes.y_ticks

    def to(x: npt.ArrayLike, y: npt.ArrayLike) -> Floats:
        u = (np.asarray(x, np.float64) - x0) / (x1 - x0)
        v = (np.asarray(y, np.float64) - y0) / (y1 - y0)
        v = v if panel.downwards else 1.0 - v
        at = np.stack(np.broadcast_arrays(left + u * (right - left), top + v * (bottom - top)), -1)
        return np.asarray(at, np.float64).reshape(-1, 2)

    if not panel.bare:
        _frame(canvas, axes, box, to, x_ticks, y_ticks)
    for item in panel.items:
        item(canvas, to, box)
    if panel.keys:
        _legend(canvas, panel, box, to)


def _frame(
    canvas: Canvas, axes: _Axes, box: Box, to: ToPixels, x_ticks: Ticks, y_ticks: Ticks
) -> None:
    """Grid, axes and numbers."""
    panel, (left, top, right, bottom) = axes.panel, box
    tick, gap, letters = pixels(_TICK), pixels(_GAP), text_size("0")[1]
    columns = to(x_ticks.places, np.zeros(len(x_ticks.places)))[:, 0]
    lines = to(np.zeros(len(y_ticks.places)), y_ticks.places)[:, 1]
    grid = [np.array([[x, top], [x, bottom]]) for x in columns]
    if not panel.names:
        grid += [np.array([[left, y], [right, y]]) for y in lines]
    canvas.lines(grid, GRID, 0.8)
    canvas.lines([np.array([[left, top], [left, bottom], [right, bottom]], float)], MUTED, 0.8)
    for x, label in zip(columns, x_ticks.labels, strict=True):
        canvas.lines([np.array([[x, bottom], [x, bottom + tick]])], MUTED, 0.8)
        canvas.text(x, bottom + tick + 0.6 * gap, label, across=0.5)
    for y, label in zip(lines, y_ticks.labels, strict=True):
        if not panel.names:
            canvas.lines([np.array([[left - tick, y], [left, y]])], MUTED, 0.8)
        canvas.text(left - tick - 0.6 * gap, y, label, across=1.0, down=0.5)
    below = bottom + tick + 1.4 * gap + letters
    canvas.text(0.5 * (left + right), below, x_ticks.on(panel.x_label), across=0.5)
    middle = 0.5 * (top + bottom)
    if panel.y_label:
        beside = left - axes.room[0] + gap
        canvas.text(beside, middle, y_ticks.on(panel.y_label), down=0.5, upright=True)
    if axes.right_ticks is not None and panel.right:
        canvas.lines([np.array([[right, top], [right, bottom]], float)], MUTED, 0.8)
        places = np.array(axes.right_ticks.places) * panel.right
        for y, label in zip(to(np.zeros(len(places)), places)[:, 1], axes.right_ticks.labels,
                            strict=True):  # fmt: skip
            canvas.lines([np.array([[right, y], [right + tick, y]])], MUTED, 0.8)
            canvas.text(right + tick + 0.6 * gap, y, label, down=0.5)
        label = axes.right_ticks.on(panel.right_label)
        canvas.text(right + axes.room[2] - gap, middle, label, across=1.0, down=0.5, upright=True)


def _legend(canvas: Canvas, panel: Panel, box: Box, to: ToPixels) -> None:
    """The keys, in the corner where they hide least."""
    gap, letters = pixels(_GAP), text_size("0")[1]
    row, sample = letters + 1.4 * gap, 4.0 * gap
    width = sample + gap + max(text_size(label)[0] for label, _ in panel.keys)
    height = row * len(panel.keys)
    at = np.concatenate([np.zeros((0, 2)), *(to(*points.T) for points in panel.data)])
    at = _between(at)
    best: tuple[int, float, float] | None = None
    for x in (box[0] + gap, box[2] - gap - width):
        for y in (box[1] + gap, box[3] - gap - height):
            inside = (at > [x - gap, y - gap]) & (at < [x + width + gap, y + height + gap])
            hidden = int(inside.all(axis=1).sum())
            if best is None or hidden < best[0]:
                best = hidden, x, y
    assert best is not None
    _, x, y = best
    for label, key in panel.keys:
        place = round(x), round(y), round(x + sample), round(y + row)

        def own(u: npt.ArrayLike, v: npt.ArrayLike, place: Box = place) -> Floats:
            across = place[0] + np.asarray(u, np.float64) * (place[2] - place[0])
            down = place[1] + np.asarray(v, np.float64) * (place[3] - place[1])
            return np.stack([across, down], axis=-1)

        key(canvas, own, place)
        canvas.text(x + sample + gap, y + 0.5 * row, label, down=0.5)
        y += row


def _between(at: Floats) -> Floats:
    """Points of curves, and some between them: (n, 2), finite."""
    at = at[np.isfinite(at).all(axis=1)]
    if len(at) < 2 or len(at) > 5000:
        return at
    share = np.linspace(0.0, 1.0, 6)[:, None, None]
    return np.asarray((at[:-1] + share * (at[1:] - at[:-1])).reshape(-1, 2))
