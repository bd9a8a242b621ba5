"""What is drawn over a picture: rectangles, lines, triangles and text, all in one pass.

Everything is a convex quad of one colour. Its coverage of a pixel follows from the distances of the
pixel's centre to its edges; that of a letter is copied from a
`gpusim.visualization.glyphs.GlyphAtlas`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from PIL import ImageColor

from gpusim.arrays.array_types import Float, Single
from gpusim.arrays.srgb import decoded
from gpusim.errors import InputError
from gpusim.gpu import Buffer, Device, Recording, Texture
from gpusim.validation import require
from gpusim.visualization.glyphs import GlyphAtlas

Shade = str | Sequence[float]
"""``"#rrggbb"``, ``"#rrggbbaa"``, a name of CSS, or three or four numbers from 0 to 1, as sRGB has
them."""

QUAD = np.dtype([("corner", "<f4", (4, 2)), ("color", "<f4", 4), ("sprite", "<u4", 4)])
"""One of what the shader draws: corners in order (the last twice for a triangle), px."""

LINE_ENDS = 0b1010
"""Edges of a line's quad that are hard: pieces that go on with each other have no gap between."""

INK, PAPER = "#16202b", "#ffffffd8"
"""Of what is written, and what is beneath."""

LINE_HEIGHT = 1.35
"""Of lines of text, over their size."""


class Target(NamedTuple):
    """What is drawn into where that isn't a `gpusim.gpu.Texture`, such as a window's texture."""

    view: Any
    format: str
    width: int
    height: int


def display_color(color: Shade) -> tuple[float, float, float, float]:
    """Red, green, blue and alpha, 0 to 1, as sRGB has them.

    Raises
    ------
    InputError
        Anything else than a `Shade`.

    Examples
    --------
    >>> from gpusim.visualization.overlay import display_color
    >>> display_color("#ff000033")
    (1.0, 0.0, 0.0, 0.2)
    """
    try:
        given: Any = color
        if isinstance(color, str):
            given = [value / 255.0 for value in ImageColor.getrgb(color)]
        values = [float(value) for value in given]
        if len(values) not in (3, 4) or not all(0.0 <= value <= 1.0 for value in values):
            raise ValueError
    except (TypeError, ValueError):
        raise InputError(
            f"overlay: colour; got {color!r}; expected '#rrggbb', '#rrggbbaa', a name, or three or "
            "four numbers from 0 to 1"
        ) from None
    red, green, blue, alpha = [*values, 1.0][:4]
    return red, green, blue, alpha


class Overlay:
    """Collects what is to be drawn, then draws it over a target, in the order it came.

    Places are in px from the target's top left corner, x right, y down: pixel (0, 0) is the square
    from 0 to 1. (Pixel coordinates of cameras count from a pixel's centre: add 0.5.)

    Examples
    --------
    >>> from gpusim.visualization.overlay import Overlay
    >>> device = gs.Device()
    >>> overlay, picture = Overlay(device), device.texture(64, 48, "rgba8unorm", "picture")
    >>> overlay.rectangle(4, 4, 40, 20, "#202830c0")
    >>> overlay.line([(4, 40), (30, 30), (60, 44)], "orange", width=2)
    >>> overlay.text(24, 14, "12 µm", 12, "white", anchor="mm")
    >>> with device.recording("view") as recording:
    ...     overlay.draw(picture, recording)
    """

    def __init__(self, device: Device) -> None:
        self.device, self.atlas = device, GlyphAtlas()
        self._quads: list[npt.NDArray[np.void]] = []
        self._letters: Buffer | None = None

    def clear(self) -> None:
        """Forget what was collected and not drawn."""
        self._quads.clear()

    def rectangle(self, x: float, y: float, width: float, height: float, color: Shade) -> None:
        """A filled rectangle; at whole px its edges are sharp."""
        right, down = x + width, y + height
        self.polygons(np.array([[(x, y), (right, y), (right, down), (x, down)]]), color)

    def polygon(self, points: npt.ArrayLike, color: Shade) -> None:
        """A filled triangle or convex quadrilateral, corners (3 or 4, 2) in order."""
        self.polygons(np.asarray(points, np.float64)[None], color)

    def polygons(self, corners: Float, color: Shade | Float, hard: int = 0) -> None:
        """Many of them, (n, 3 or 4, 2), of one colour or one each (n, 4).

        ``hard``: bit k for the edge from corner k to the next, if it isn't to be softened.

        Raises
        ------
        InputError
            Another shape. Those that aren't finite or have no area are left out.
        """
        shape = corners.shape
        fits = len(shape) == 3 and shape[1:] in ((3, 2), (4, 2))
        require(fits, "overlay: corners", f"shape {shape}", "(n, 3, 2) or (n, 4, 2)")
        quads = np.zeros(len(corners), QUAD)
        quads["sprite"][:, 3] = hard
        each = isinstance(color, np.ndarray) and color.ndim == 2
        quads["color"] = color if each else display_color(color)  # type: ignore[arg-type]
        with np.errstate(over="ignore", invalid="ignore"):
            quads["corner"][:, : corners.shape[1]] = corners
            quads["corner"][:, 3] = corners[:, -1]
            a, b = (quads["corner"][:, k + 2] - quads["corner"][:, k] for k in (0, 1))
            area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
            self._quads.append(quads[np.isfinite(area) & (area > 1e-6)])

    def line(self, points: npt.ArrayLike, color: Shade, width: float = 1.5) -> None:
        """A line through points (n, 2); it is interrupted where these aren't finite."""
        at = np.asarray(points, np.float64)
        self.segments(np.stack([at[:-1], at[1:]], axis=1), color, width)

    def segments(self, ends: Float, color: Shade | Float, width: float = 1.5) -> None:
        """Many straight lines, (n, 2, 2), of one colour or one each (n, 4)."""
        along = ends[:, 1] - ends[:, 0]
        size = np.hypot(along[:, 0], along[:, 1])
        own = np.isfinite(size) & (size > 1e-9)
        ends, along = ends[own], along[own] / size[own, None]
        side = 0.5 * width * np.stack([along[:, 1], -along[:, 0]], axis=1)
        corners = [ends[:, 0] + side, ends[:, 1] + side, ends[:, 1] - side, ends[:, 0] - side]
        if isinstance(color, np.ndarray) and color.ndim == 2:
            color = color[own]
        self.polygons(np.stack(corners, axis=1), color, LINE_ENDS)

    def text_width(self, text: str, size: float) -> float:
        """Width of the longest line, px."""
        return max(self.atlas.width(line, round(size)) for line in text.split("\n"))

    def text(
        self, x: float, y: float, text: str, size: float, color: Shade, anchor: str = "la",
        halo: Shade | None = None,
    ) -> None:  # fmt: skip
        """Lines of text, ``size`` px (the font's em), on whole pixels.

        ``anchor``: what lies at (x, y): l, m or r for left, middle, right, and a, m, s or d for the
        top of the first line's capitals, the middle, the first base line, the last base line.
        ``halo``: a border of this colour, to be read over pictures. A character that
        the font hasn't is a box.
        """
        known = len(anchor) == 2 and anchor[0] in "lmr" and anchor[1] in "amsd"
        require(known, "overlay: anchor", repr(anchor), "one of l m r, then a m s d")
        pixels, lines = max(round(size), 6), text.split("\n")
        step, ascent = LINE_HEIGHT * pixels, self.atlas.ascent(pixels)
        above = {"a": ascent, "s": 0.0, "d": -(len(lines) - 1) * step}
        above["m"] = 0.5 * (above["a"] + above["d"])
        base = y + above[anchor[1]]
        places: list[tuple[float, float, float, float]] = []
        sprites: list[tuple[int, int, int, int]] = []
        for number, line in enumerate(lines):
            pen = x - {"l": 0.0, "m": 0.5, "r": 1.0}[anchor[0]] * self.atlas.width(line, pixels)
            for character in line:
                glyph = self.atlas.glyph(character, pixels)
                left, top = round(pen) + glyph.left, round(base + number * step) + glyph.top
                if glyph.width:
                    places.append((left, top, left + glyph.width, top + glyph.height))
                    sprites.append((glyph.first, glyph.width, glyph.height, 0))
                pen += glyph.advance
        if not places:
            return
        quads = np.zeros(len(places), QUAD)
        quads["corner"] = np.array(places)[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 4, 2)
        quads["sprite"] = sprites
        if halo is not None:
            around = quads.copy()
            around["color"] = display_color(halo)
            for step_x, step_y in ((-1, -1), (1, -1), (-1, 1), (1, 1)):
                moved = around.copy()
                moved["corner"] += (step_x, step_y)
                self._quads.append(moved)
        quads["color"] = display_color(color)
        self._quads.append(quads)

    def add(self, quads: npt.NDArray[np.void]) -> None:
        """Collect what another overlay had collected, letters aside: (n,) `QUAD`."""
        self._quads.append(quads)

    def quads(self) -> npt.NDArray[np.void]:
        """What has been collected, (n,) `QUAD`."""
        return np.concatenate([np.zeros(0, QUAD), *self._quads])

    def draw(self, target: Any, recording: Recording) -> None:
        """Draw what has been collected over ``target``, and forget it.

        ``target``: a `gpusim.gpu.Texture` or a `Target` of an 8-bit format, with sRGB's curve
        ("…-srgb") or without; what is there stays beneath. ``recording``: takes the pass, to be
        submitted with what comes before.
        """
        quads = self.quads()
        self.clear()
        if not len(quads):
            return
        if target.format.endswith("-srgb"):
            quads["color"][:, :3] = decoded(quads["color"][:, :3])
        coverage = self.atlas.coverage
        if self._letters is None or self._letters.nbytes != max(coverage.nbytes, 4):
            some = coverage if coverage.size else np.zeros(4, np.uint8)
            self._letters = self.device.buffer(some, "overlay.letters")
        raster = self.device.raster("visualization/overlay", (target.format,), depth="over")
        bindings = raster.bind(
            params={"width": target.width, "height": target.height},
            quads=self.device.buffer(quads, "overlay.quads"), letters=self._letters,
        )  # fmt: skip
        recording.draw(
            raster, bindings, colors=(target,), depth=None, vertices=6 * len(quads),
            size=(target.width, target.height), clear=None,
        )  # fmt: skip


def pixels_of(device: Device, texture: Texture) -> npt.NDArray[Any]:
    """(H, W, 4) uint8 of a texture of 8 bits a channel."""
    buffer = device.empty(texture.stride * texture.height, "view.pixels")
    with device.recording("view.pixels") as recording:
        recording.copy_texture(texture, buffer, texture.height)
    rows = buffer.read(np.uint8, (texture.height, texture.stride))
    return rows[:, : 4 * texture.width].reshape(texture.height, texture.width, 4)


def overlay_twin(
    picture: Single,
    quads: npt.NDArray[np.void],
    coverage: npt.NDArray[np.uint8],
) -> Single:
    """``quads`` over a picture (H, W, 4), as the device draws them without sRGB's curve."""
    result = picture.copy()
    height, width = picture.shape[:2]
    for quad in quads:
        corner = quad["corner"]
        low = np.maximum(np.floor(corner.min(axis=0) - 1.0), 0).astype(int)
        high = np.minimum(np.ceil(corner.max(axis=0) + 1.0), [width, height]).astype(int)
        if not (high > low).all():
            continue
        x, y = np.meshgrid(*(np.arange(low[k], high[k]) + np.float32(0.5) for k in (0, 1)))
        share = _letter(quad, coverage, x, y) if quad["sprite"][1] else _share(quad, x, y)
        alpha = (quad["color"][3] * share)[..., None]
        there = result[low[1] : high[1], low[0] : high[0]]
        there[..., :3] = alpha * quad["color"][:3] + (1.0 - alpha) * there[..., :3]
        there[..., 3:] = alpha + (1.0 - alpha) * there[..., 3:]
    return result


def _share(
    quad: npt.NDArray[np.void], x: npt.NDArray[Any], y: npt.NDArray[Any]
) -> npt.NDArray[Any]:
    corner, hard = quad["corner"], int(quad["sprite"][3])
    across, other = corner[2] - corner[0], corner[3] - corner[1]
    turn = np.float32(1.0 if across[0] * other[1] - across[1] * other[0] > 0.0 else -1.0)
    outside = np.zeros_like(x)
    for k in range(4):
        edge = corner[(k + 1) % 4] - corner[k]
        size = np.hypot(edge[0], edge[1])
        if size > 0.0:
            inside = turn * (edge[0] * (y - corner[k][1]) - edge[1] * (x - corner[k][0])) / size
            soft = 1.0 - np.clip(inside + np.float32(0.5), 0.0, 1.0)
            outside += inside < 0.0 if hard >> k & 1 else soft
    # what the rasteriser draws: at sharp tips it ends before the coverage does
    wide = _outward(corner, turn)
    for k in range(4):
        edge = wide[(k + 1) % 4] - wide[k]
        outside[turn * (edge[0] * (y - wide[k][1]) - edge[1] * (x - wide[k][0])) < 0.0] = 1.0
    return np.maximum(1.0 - outside, 0.0)


def _outward(corner: Single, turn: np.float32) -> Single:
    """Corners moved so that all edges are a pixel farther out."""
    wide = np.empty_like(corner)
    for k, own in enumerate(corner):
        before, after = corner[k - 1], corner[(k + 1) % 4]
        before = corner[k - 2] if (before == own).all() else before
        after = corner[k - 2] if (after == own).all() else after
        a, b = ((d / np.hypot(*d)) for d in (own - before, after - own))
        normal = turn * np.array([a[1] + b[1], -a[0] - b[0]])
        wide[k] = own + normal / max(1.0 + a @ b, np.float32(0.1))
    return wide


def _letter(
    quad: npt.NDArray[np.void],
    coverage: npt.NDArray[np.uint8],
    x: npt.NDArray[Any],
    y: npt.NDArray[Any],
) -> npt.NDArray[Any]:
    first, columns, rows, _ = (int(v) for v in quad["sprite"])
    own = coverage[first : first + columns * rows].reshape(rows, columns)
    i, j = (np.floor(v - quad["corner"][0][k]).astype(int) for k, v in ((1, y), (0, x)))
    inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
    value = own[np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1)]
    return np.where(inside, value / np.float32(255.0), np.float32(0.0))
