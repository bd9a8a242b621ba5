"""One plot: curves, marks and bars, and the ranges of its axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gpusim.report.canvas import Box, Canvas, pixels
from gpusim.report.style import PAGE, TEXT

__all__ = ["Floats", "Panel", "ToPixels"]

Floats = npt.NDArray[np.float64]
ToPixels = Callable[[npt.ArrayLike, npt.ArrayLike], Floats]
Item = Callable[[Canvas, ToPixels, Box], None]

_MARGIN = 0.045  # of the range, around the data


@dataclass
class Panel:
    """One plot; what is added to it later is drawn above what was there.

    ``x_range``, ``y_range``: None for that of the data. ``right``: y over this number on a second
    axis, named ``right_label``. ``equal``: one unit is as long on both axes. ``log``: y is a
    logarithm to base 10. ``downwards``: y grows down. ``bare``: no axes. ``names``: of rows at
    y = 0, 1, … in place of numbers.
    """

    title: str = ""
    x_label: str = ""
    y_label: str = ""
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    right: float | None = None
    right_label: str = ""
    equal: bool = False
    log: bool = False
    downwards: bool = False
    bare: bool = False
    whole: bool = False
    names: Sequence[str] = ()
    rows: int = 6
    """Numbers on the y axis, at most."""
    items: list[Item] = field(default_factory=list)
    data: list[Floats] = field(default_factory=list)
    keys: list[tuple[str, Item]] = field(default_factory=list)

    def line(
        self,
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        colour: str,
        width: float = 1.4,
        label: str = "",
    ) -> None:
        """A curve through points."""

        def draw(canvas: Canvas, to: ToPixels, box: Box) -> None:
            canvas.lines([to(x, y)], colour, width, box)

        def key(canvas: Canvas, to: ToPixels, box: Box) -> None:
            canvas.lines([to([0.0, 1.0], [0.5, 0.5])], colour, width, box)

        self._add(draw, x, y, label, key)

    def marks(
        self,
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        colour: str,
        shape: str = "o",
        size: float = 5.0,
        *,
        inside: str | None = PAGE,
        edge: float = 1.2,
        label: str = "",
    ) -> None:
        """Marks at points; see `Canvas.marks`."""

        def draw(canvas: Canvas, to: ToPixels, box: Box) -> None:
            reach = round(pixels(size))
            wide = box[0] - reach, box[1] - reach, box[2] + reach, box[3] + reach
            at = to(x, y)
            inner = (at >= np.array(box[:2]) - 1.0) & (at <= np.array(box[2:]) + 1.0)
            canvas.marks(
                at[inner.all(axis=1)], shape, size, colour, inside=inside, edge=edge, box=wide
            )

        def key(canvas: Canvas, to: ToPixels, box: Box) -> None:
            canvas.marks(to([0.5], [0.5]), shape, size, colour, inside=inside, edge=edge)

        self._add(draw, x, y, label, key)

    def segments(self, x: npt.ArrayLike, y: npt.ArrayLike, colour: str, width: float = 1.2) -> None:
        """Straight lines: ``x``, ``y`` (n, 2) hold their ends."""
        ends = np.asarray(x, np.float64), np.asarray(y, np.float64)

        def draw(canvas: Canvas, to: ToPixels, box: Box) -> None:
            at = to(ends[0].ravel(), ends[1].ravel()).reshape(-1, 2, 2)
            canvas.lines(list(at), colour, width, box)

        self._add(draw, *(end.ravel() for end in ends))

    def bars(self, corners: Floats, colour: str, label: str = "", places: bool = True) -> None:
        """Filled boxes (n, 4): x and y of one corner, then of the opposite one."""

        def draw(canvas: Canvas, to: ToPixels, box: Box) -> None:
            for x0, y0, x1, y1 in corners:
                canvas.fill(to([x0, x1, x1, x0], [y0, y0, y1, y1]), colour, box)

        def key(canvas: Canvas, to: ToPixels, box: Box) -> None:
            canvas.fill(to([0.1, 0.9, 0.9, 0.1], [0.2, 0.2, 0.8, 0.8]), colour, box)

        known = corners if places else corners[:0]
        self._add(draw, known[:, 0::2].ravel(), known[:, 1::2].ravel(), label, key)

    def rule(self, place: float, colour: str, *, upright: bool = False, dotted: bool = False,
             width: float = 1.0) -> None:  # fmt: skip
        """A line through the whole panel at y (or x, if ``upright``) = ``place``."""

        def draw(canvas: Canvas, to: ToPixels, box: Box) -> None:
            at = to([place], [place])[0]
            ends = [[at[0], box[1]], [at[0], box[3]]] if upright else [
                [box[0], at[1]], [box[2], at[1]]]  # fmt: skip
            a, b = np.array(ends, np.float64)
            if dotted:
                step = pixels(4.0)
                share = np.arange(0.0, np.linalg.norm(b - a), step) / np.linalg.norm(b - a)
                half = 0.35 * step * (b - a) / np.linalg.norm(b - a)
                canvas.lines([a + s * (b - a) + [0 * half, half] for s in share], colour, width,
                             box)  # fmt: skip
            else:
                canvas.lines([np.stack([a, b])], colour, width, box)

        self.items.append(draw)

    def note(self, x: float, y: float, text: str, *, right: bool = False, size: float = 9.5,
             ahead: float = 0.0, colour: str = TEXT) -> None:  # fmt: skip
        """Words beside a point; ``right``: they end there; ``ahead`` points away from it."""

        def draw(canvas: Canvas, to: ToPixels, box: Box) -> None:
            at = to([x], [y])[0]
            shift = -pixels(ahead) if right else pixels(ahead)
            across = 1.0 if right else 0.0
            canvas.text(at[0] + shift, at[1], text, size=size, across=across, down=0.5,
                        colour=colour)  # fmt: skip

        self.items.append(draw)

    def _add(
        self,
        draw: Item,
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        label: str = "",
        key: Item | None = None,
    ) -> None:
        self.items.append(draw)
        points = np.stack(
            np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64)), axis=-1
        )
        self.data.append(points.reshape(-1, 2))
        if label and key is not None:
            self.keys.append((label, key))

    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """What the axes show."""
        points = np.concatenate([np.zeros((0, 2)), *self.data])
        points = points[np.isfinite(points).all(axis=1)]
        found = []
        for axis, given in enumerate((self.x_range, self.y_range)):
            if given is not None:
                found.append(given)
                continue
            low, high = 0.0, 1.0
            if len(points):
                low, high = float(points[:, axis].min()), float(points[:, axis].max())
            if not high - low > 1e-12 * max(abs(low), abs(high), 1e-290):
                low, high = low - (0.05 * abs(low) or 0.5), high + (0.05 * abs(high) or 0.5)
            more = _MARGIN * (high - low)
            found.append((low - more, high + more))
        return found[0], found[1]
