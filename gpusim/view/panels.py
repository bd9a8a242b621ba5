"""What is written over the picture: title, fields, slider, progress, help, messages, faults."""

from __future__ import annotations

import textwrap

import numpy as np

from gpusim.view.body_marks import SIZE, draw_body_marks, mark_selection
from gpusim.view.field_list import FieldRows, draw_field_list
from gpusim.view.keys import help_lines
from gpusim.view.view_state import ViewState
from gpusim.visualization.legend import draw_legend, legend_width
from gpusim.visualization.overlay import INK, PAPER, Overlay

ACCENT, WARNING = "#1f6fb2", "#9c1c1c"
EDGE = 14
"""px between panels and the window's border."""
BAR = 8
"""px, height of the slider."""
BELOW = 5 * SIZE
"""px of the window's lower side for the slider and what it says."""


def draw_panels(viewer: ViewState, overlay: Overlay) -> FieldRows | None:
    """Collect all that stands over a viewer's picture; returns the list of fields, if it is."""
    rows = None
    if viewer.content is not None and viewer.picture.base is not None:
        draw_body_marks(viewer, overlay)
        low = _draw_scale(viewer, overlay) + EDGE
        if viewer.selected is not None:
            text = mark_selection(viewer, overlay)
            wide, _ = _panel_size(overlay, text)
            _panel(overlay, round(viewer.size[0] - wide - EDGE), round(low), text)
    below = _draw_title(viewer, overlay)
    if viewer.shown["fields"]:
        most = viewer.size[1] - below - 2.0 * BELOW
        rows = draw_field_list(viewer, overlay, EDGE, below + 6.0, most)
    _draw_slider(viewer, overlay)
    if viewer.shown["help"]:
        _draw_help(viewer, overlay)
    above = viewer.size[1] - EDGE - 4.0 * SIZE
    if viewer.fault:
        above = _draw_message(viewer, overlay, viewer.fault, above, WARNING) - 6.0
    if viewer.message:
        _draw_message(viewer, overlay, viewer.message, above)
    return rows


def _panel_size(overlay: Overlay, text: str) -> tuple[float, float]:
    """Width and height of text on paper."""
    lines = text.count("\n") + 1
    return overlay.text_width(text, SIZE) + 1.4 * SIZE, lines * 1.35 * SIZE + 0.7 * SIZE


def _panel(
    overlay: Overlay, x: float, y: float, text: str, color: str = INK
) -> tuple[float, float]:
    """Text on paper; returns how far it goes."""
    wide, tall = _panel_size(overlay, text)
    overlay.rectangle(round(x), round(y), round(wide), round(tall), PAPER)
    overlay.text(x + 0.7 * SIZE, y + 0.65 * SIZE, text, SIZE, color)
    return x + wide, y + tall


def _draw_title(viewer: ViewState, overlay: Overlay) -> float:
    """Returns how far down it goes."""
    content = viewer.content
    lines = [content.title if content is not None else viewer.path.name]
    if content is not None and content.parts:
        size = np.ptp(content.outline(0, 1.0), axis=0)
        lines.append(" × ".join(f"{1e3 * side:.4g}" for side in size) + " mm")  # noqa: RUF001
    if content is not None and viewer.through is not None:
        camera = content.cameras[viewer.through]
        lines.append(f"camera {camera.name}, {camera.width} × {camera.height} px")  # noqa: RUF001
        if content.lights is None:
            lines.append("no lamp: a headlight here, albedo alone in images")
        if viewer.sharp is not None:
            lines.append(viewer.sharp.describe())
            lines += ["orange is nearer, blue farther"] if viewer.shown["cameras"] else []
    shot, base = viewer.picture.shot, viewer.picture.base
    if shot is not None and shot.weights is not None and base is not None and base.coloured:
        lines.append('grey, as pictures of channels = "mono"')
    if content is not None and content.moves and viewer.scale != 1.0:
        lines.append(f"deformation × {viewer.scale:g}")  # noqa: RUF001
    if content is not None and content.cut is not None:
        lines.append(content.cut.describe(content.bounds))
    right, bottom = _panel(overlay, EDGE, EDGE, "\n".join(lines))
    if viewer.solver is not None:
        share, text = viewer.solver.progress
        top = bottom + 6
        right, bottom = _panel(overlay, EDGE, top, f"{text or 'solving'} … shown unloaded")
        overlay.rectangle(EDGE, round(bottom), round(share * (right - EDGE)), 4, ACCENT)
    if not viewer.shown["help"]:
        low = viewer.size[1] - EDGE - (1.5 * SIZE if _has_slider(viewer) else 0.0)
        _panel(overlay, EDGE, low - _panel_size(overlay, "h: help")[1], "h: help")
    return bottom


def _draw_help(viewer: ViewState, overlay: Overlay) -> None:
    lines = help_lines()
    size = min(SIZE, (viewer.size[1] - 2 * EDGE) / (1.35 * len(lines) + 1.0))
    first = max(overlay.text_width(key, size) for key, _ in lines) + size
    wide = first + max(overlay.text_width(text, size) for _, text in lines) + 1.4 * size
    tall = (1.35 * len(lines) + 1.0) * size
    overlay.rectangle(EDGE, EDGE, round(wide), round(tall), "white")
    for number, (key, text) in enumerate(lines):
        y = EDGE + 0.5 * size + (number + 0.5) * 1.35 * size
        overlay.text(EDGE + 0.7 * size, y, key, size, ACCENT, anchor="lm")
        overlay.text(EDGE + 0.7 * size + first, y, text, size, INK, anchor="lm")


def _draw_message(
    viewer: ViewState, overlay: Overlay, text: str, bottom: float, color: str = INK
) -> float:
    """A text in the middle; returns how far up it goes."""
    columns = max(int((viewer.size[0] - 4 * EDGE) / (0.56 * SIZE)), 20)
    lines = [part for line in text.splitlines() for part in textwrap.wrap(line, columns) or [""]]
    shown = "\n".join(lines[:24])
    wide, tall = _panel_size(overlay, shown)
    x, y = round(0.5 * (viewer.size[0] - wide)), round(bottom - tall)
    _panel(overlay, x, y, shown, color)
    if color != INK:
        overlay.rectangle(x - 4, y, 4, round(tall), color)
    return y


def panels_taken(viewer: ViewState) -> tuple[float, float]:
    """Px of the window's right and lower side that the legend and the slider take; half of it at
    most, so that something is left to be seen."""
    right = 0.0
    if viewer.field_values is not None:
        title = _legend_title(viewer)
        right = 2.0 * EDGE + legend_width(viewer.overlay, viewer.color_scale, title, SIZE)
    below = BELOW if _has_slider(viewer) else 0.0
    return min(right, 0.5 * viewer.size[0]), min(below, 0.5 * viewer.size[1])


# -- slider


def _has_slider(viewer: ViewState) -> bool:
    return viewer.content is not None and viewer.content.frames > 1


def _slider(viewer: ViewState) -> tuple[float, float, float]:
    """Left, width and middle height of the bar, px."""
    width, height = viewer.size
    return 3.0 * EDGE, max(width - 6.0 * EDGE, 1.0), height - EDGE - 0.5 * BAR


def slider_frame(viewer: ViewState, x: float, y: float | None) -> int | None:
    """The frame at a place of the window; None beside the slider, or where there is none.

    ``y``: None for a mouse that holds the slider.
    """
    if not _has_slider(viewer):
        return None
    assert viewer.content is not None
    left, width, middle = _slider(viewer)
    if y is not None and not (abs(y - middle) <= BAR + 4 and -EDGE <= x - left <= width + EDGE):
        return None
    return int(np.rint(np.clip((x - left) / width, 0.0, 1.0) * (viewer.content.frames - 1)))


def _draw_slider(viewer: ViewState, overlay: Overlay) -> None:
    if not _has_slider(viewer):
        return
    assert viewer.content is not None
    left, width, middle = _slider(viewer)
    share = viewer.frame / (viewer.content.frames - 1)
    top, at = round(middle - 0.5 * BAR), round(left + share * width)
    overlay.rectangle(left - 1, top - 1, width + 2, BAR + 2, "#00000060")
    overlay.rectangle(left, top, width, BAR, PAPER)
    overlay.rectangle(left, top, at - left, BAR, ACCENT)
    overlay.rectangle(at - 5, top - 5, 10, BAR + 10, "white")
    overlay.rectangle(at - 4, top - 4, 8, BAR + 8, ACCENT)
    text = viewer.content.frame_text(viewer.frame) + ", playing" * viewer.playing
    wide, tall = _panel_size(overlay, text)
    _panel(overlay, round(0.5 * (viewer.size[0] - wide)), top - 8 - tall, text)


# -- over the picture


def _legend_title(viewer: ViewState) -> str:
    assert viewer.field_values is not None
    kind = {"frame": "", "held": ", held", "frames": ", all frames"}[viewer.legend_range.kind]
    return viewer.field_values.field.label() + kind


def _draw_scale(viewer: ViewState, overlay: Overlay) -> float:
    """The legend of a field, in the corner; returns how far down it goes."""
    if viewer.field_values is None:
        return 0.0
    title, right = _legend_title(viewer), viewer.size[0] - EDGE
    tall = min(max(viewer.size[1] - 20.0 * SIZE, 4.0 * SIZE), 240.0)
    return EDGE + draw_legend(overlay, viewer.color_scale, title, right, EDGE, tall, SIZE)[1]
