"""The HTML that a notebook shows: a heading, pictures, short tables, notes.

Colours are the page's own: text is inherited, lines are a half transparent grey, and pictures of
things have no background, so that all of it can be read on light and dark pages.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Real
from gpusim.export.images import encoded_picture
from gpusim.report.html import data_uri, page_template
from gpusim.report.text import number

Rows = Sequence[tuple[str, ...]]
"""Of a table: what a row is of, and its values."""
DIGITS = 4
_WIDTH = 480  # px on the page


@dataclass(frozen=True)
class Legend:
    """What the colours of a picture mean: ``colours`` from left to right, as CSS."""

    text: str
    low: str
    high: str
    colours: str


@dataclass(frozen=True, eq=False)
class Picture:
    """``pixels`` (H, W, 4), (H, W, 3) or (H, W) uint8, or a drawing as ``svg``; ``text`` stands in
    for it. ``shown_width``: px on the page, at most 480 unless given."""

    text: str
    pixels: npt.NDArray[np.uint8] | None = None
    caption: str = ""
    legend: Legend | None = None
    svg: str = ""
    shown_width: int = 0

    @property
    def source(self) -> str:
        """The pixels as a data URI."""
        assert self.pixels is not None
        return data_uri("image/png", encoded_picture(self.pixels, ".png"))

    @property
    def width(self) -> int:
        """px on the page."""
        assert self.pixels is not None
        return self.shown_width or min(self.pixels.shape[1], _WIDTH)


def page(
    title: str,
    rows: Rows,
    pictures: Sequence[Callable[[], Picture]] = (),
    notes: Sequence[str] = (),
    head: Sequence[str] = (),
) -> str:
    """The HTML of one thing. ``head``: titles of columns; without, rows are names and values.

    ``pictures`` are made here: in place of one that fails a note says why.
    """
    made, said = [], list(notes)
    for make in pictures:
        try:
            made.append(make())
        except Exception as error:
            said.append(f"No picture: {error}")
    return page_template("display.html.j2").render(
        title=title, rows=rows, pictures=made, notes=said, head=head
    )


def quantity(value: float, unit: str = "", digits: int = DIGITS) -> str:
    """A number with its unit, rounded, without zeros at its end."""
    text = number(float(f"{float(value):.{digits - 1}e}"), digits)
    if "." in text and "\N{MULTIPLICATION SIGN}" not in text:
        text = text.rstrip("0").rstrip(".")
    return f"{text} {unit}".rstrip()


def span(values: Real) -> str:
    """The least and the greatest of the finite values; a dash where there are none."""
    known = values[np.isfinite(values)]
    if not known.size:
        return number(float("nan"))
    return f"{quantity(known.min())} to {quantity(known.max())}"
