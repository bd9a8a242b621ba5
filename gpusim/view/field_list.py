"""The list of fields in a corner of the window: the one that is shown, and those round it."""

from __future__ import annotations

from typing import NamedTuple

from gpusim.view.body_marks import SIZE
from gpusim.view.content.field_values import field_names, field_of
from gpusim.view.view_state import ViewState
from gpusim.visualization.overlay import INK, PAPER, Overlay

CHOSEN = "#1f6fb2"
ROW = 1.35 * SIZE
"""px, height of a row."""


class FieldRows(NamedTuple):
    """Where a list was drawn, px, and the names of its rows; None: paint."""

    left: float
    top: float
    wide: float
    names: list[str | None]

    def at(self, x: float, y: float) -> int | None:
        """The number of the row at a place; None beside the rows."""
        row = int((y - self.top) // ROW)
        inside = 0.0 <= x - self.left <= self.wide and 0 <= row < len(self.names)
        return row if inside else None


def all_fields(viewer: ViewState) -> list[str | None]:
    """Paint, and the names of the fields that can be shown now, in their order."""
    return [None, *field_names(viewer.content)]


def draw_field_list(
    viewer: ViewState, overlay: Overlay, left: float, top: float, most: float
) -> FieldRows | None:
    """As many rows as are no higher than ``most``, and the number of the chosen one."""
    content, names = viewer.content, all_fields(viewer)
    if content is None:
        return None
    chosen = names.index(viewer.field) if viewer.field in names else 0
    count = min(len(names), max(int(most / ROW) - 2, 1))
    first = min(max(chosen - count // 2, 0), len(names) - count)
    shown = names[first : first + count]
    labels = [
        field_of(content, name, viewer.seen_camera)[0].label() if name else "paint"
        for name in shown
    ]  # fmt: skip
    head = f"{chosen + 1} of {len(names)}; f, d or a click"
    wide = overlay.text_width("\n".join([head, *labels]), SIZE) + 1.4 * SIZE
    overlay.rectangle(left, round(top), round(wide), round((count + 1.5) * ROW), PAPER)
    overlay.text(left + 0.7 * SIZE, top + 0.7 * ROW, head, SIZE, "#5b6876", anchor="lm")
    rows = FieldRows(left, top + 1.25 * ROW, wide, shown)
    for number, label in enumerate(labels):
        y, color = rows.top + number * ROW, INK
        if first + number == chosen:
            overlay.rectangle(left, round(y), round(wide), round(ROW), CHOSEN)
            color = "white"
        overlay.text(left + 0.7 * SIZE, y + 0.5 * ROW, label, SIZE, color, anchor="lm")
    return rows
