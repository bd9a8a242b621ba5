"""What is written over the picture: title, selection, slider, progress, help, messages, faults."""

from __future__ import annotations

import textwrap

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.export.field_catalogue import named_field
from gpusim.view.camera_marks import (
    draw_distortion,
    draw_image_frame,
    draw_principal_point,
)
from gpusim.view.keys import help_lines
from gpusim.view.view_state import ViewState
from gpusim.visualization.color_scale import format_value
from gpusim.visualization.legend import draw_legend, legend_width
from gpusim.visualization.mesh_edges import element_edges
from gpusim.visualization.overlay import INK, PAPER, Overlay
from gpusim.visualization.symbols import Symbols

SIZE = 14
"""px of letters."""

ACCENT, WARNING = "#1f6fb2", "#9c1c1c"
EDGE = 14
"""px between panels and the window's border."""
BAR = 8
"""px, height of the slider."""
BELOW = 5 * SIZE
"""px of the window's lower side for the slider and what it says."""


def draw_panels(viewer: ViewState, overlay: Overlay) -> None:
    """Collect all that stands over a viewer's picture."""
    if viewer.content is not None and viewer.picture.base is not None:
        _draw_symbols(viewer, overlay)
        _draw_selection(viewer, overlay, _draw_scale(viewer, overlay) + EDGE)
    _draw_title(viewer, overlay)
    _draw_slider(viewer, overlay)
    if viewer.shown["help"]:
        _draw_help(viewer, overlay)
    above = viewer.size[1] - EDGE - 4.0 * SIZE
    if viewer.fault:
        above = _draw_message(viewer, overlay, viewer.fault, above, WARNING) - 6.0
    if viewer.message:
        _draw_message(viewer, overlay, viewer.message, above)


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


def _draw_title(viewer: ViewState, overlay: Overlay) -> None:
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
    right, bottom = _panel(overlay, EDGE, EDGE, "\n".join(lines))
    if viewer.solver is not None:
        share, text = viewer.solver.progress
        top = bottom + 6
        right, bottom = _panel(overlay, EDGE, top, f"{text or 'solving'} … shown unloaded")
        overlay.rectangle(EDGE, round(bottom), round(share * (right - EDGE)), 4, ACCENT)
    if not viewer.shown["help"]:
        low = viewer.size[1] - EDGE - (1.5 * SIZE if _has_slider(viewer) else 0.0)
        _panel(overlay, EDGE, low - _panel_size(overlay, "h: help")[1], "h: help")


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
    if viewer.field_values and viewer.field is not None:
        title = named_field(viewer.field).label()
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
    text = viewer.content.frame_text(viewer.frame)
    wide, tall = _panel_size(overlay, text)
    _panel(overlay, round(0.5 * (viewer.size[0] - wide)), top - 8 - tall, text)


# -- over the picture


def _draw_scale(viewer: ViewState, overlay: Overlay) -> float:
    """The legend of a field, in the corner; returns how far down it goes."""
    if not viewer.field_values or viewer.field is None:
        return 0.0
    title, right = named_field(viewer.field).label(), viewer.size[0] - EDGE
    tall = min(max(viewer.size[1] - 20.0 * SIZE, 4.0 * SIZE), 240.0)
    return EDGE + draw_legend(overlay, viewer.color_scale, title, right, EDGE, tall, SIZE)[1]


def _draw_symbols(viewer: ViewState, overlay: Overlay) -> None:
    """What stands in space; of what hides it only a sharp picture tells."""
    content, picture, shown = viewer.content, viewer.picture, viewer.shown
    assert content is not None
    camera, _, _ = viewer.camera()
    place, width, height = viewer.place, *viewer.size
    hides = picture.base if not picture.waits else None
    symbols = Symbols(overlay, camera, place, hides)
    surfaces = viewer.surfaces()
    if hides is not None:
        for ends in content.creases:
            symbols.lines(ends, "#00000090", 1.0)
    for number, skin in enumerate(content.skins):
        if shown["mesh"] and hides is not None:
            symbols.elements(element_edges(surfaces[number], skin))
        try:
            model = content.model(number) if shown["supports"] or shown["loads"] else None
        except GpusimError as error:  # the picture is as good without
            viewer.fault = viewer.fault or str(error)
            continue
        if model is None:
            continue
        nodes = model.mesh.points + viewer.scale * content.displacement(number, viewer.frame)
        if shown["supports"] and model.fixed is not None:
            outside = np.unique(skin.faces.nodes[skin.faces.nodes >= 0])
            symbols.supports(nodes[outside], model.fixed[outside])
        if shown["loads"]:
            symbols.loads(nodes, content.forces(number, viewer.frame))
    if shown["cameras"]:
        outline = content.outline(viewer.frame, viewer.scale)
        others = [own for own in content.cameras if np.linalg.norm(own.eye - camera.eye) > 0.0]
        symbols.cameras(others, 0.2 * float(np.ptp(outline, axis=0).max()))
    if viewer.through is not None:
        draw_image_frame(overlay, camera, place, width, height)
        draw_principal_point(overlay, camera, place)
        if shown["cameras"]:
            draw_distortion(overlay, camera, place)
    else:
        below = 50.0 + panels_taken(viewer)[1]
        symbols.tripod(width - 60.0, height - below, min(42.0, 0.1 * height))


def _draw_selection(viewer: ViewState, overlay: Overlay, top: float) -> None:
    """A mark where the selected material point is now, and what is known of it."""
    found, content = viewer.selected, viewer.content
    if found is None or content is None:
        return
    shown, true = (surfaces[found.surface].points[found.vertices]
                   for surfaces in (viewer.surfaces(), content.surfaces(viewer.frame)))  # fmt: skip
    at, moved = found.weights @ shown, found.weights @ true - found.reference
    camera, _, _ = viewer.camera()
    pixel = camera.project(at)
    x, y = viewer.place.window(pixel)
    if np.isfinite([x, y]).all():
        for radius, color in ((7.0, "#000000a0"), (5.0, "#ffd23f")):
            overlay.polygon([(x - radius, y), (x, y - radius), (x + radius, y), (x, y + radius)],
                            color)  # fmt: skip
    text = "\n".join(_selection_lines(viewer, at, moved, pixel))
    wide, _ = _panel_size(overlay, text)
    _panel(overlay, round(viewer.size[0] - wide - EDGE), round(top), text)


def _selection_lines(viewer: ViewState, at: Float, moved: Float, pixel: Float) -> list[str]:
    found, content = viewer.selected, viewer.content
    assert found is not None and content is not None
    lines = [found.name if content.parts else f"{found.name}, paint {found.paint}"]
    if found.element is not None:
        lines.append(f"element {found.element}, node {found.node}")
    if found.sets:
        lines.append(f"set {', '.join(found.sets)}")
    if viewer.through is not None:
        whole, (seen, _, _) = content.cameras[viewer.through], viewer.camera()
        share = np.array([whole.width / seen.width, whole.height / seen.height])
        column, row = (pixel + 0.5) * share - 0.5
        lines.append(f"pixel {column:.1f}, {row:.1f}")
        if viewer.sharp is not None:
            depth = float(whole.to_camera(at)[2])
            lines.append(f"depth {1e3 * depth:.4g} mm: blur {viewer.sharp.blur_at(depth):.2g} px")

    def mm(values: Float) -> str:
        return ", ".join(format_value(round(1e3 * float(v), 3) + 0.0, 1e-2) for v in values) + " mm"

    lines.append(f"at rest {mm(found.reference)}")
    if content.moves and found.element is not None:
        lines.append(f"moved by {mm(moved)}")
    if viewer.field is not None and viewer.field_values and found.node is not None:
        kind = named_field(viewer.field)
        place = found.element if kind.place == "elements" else found.node
        value = format_value(float(viewer.field_values[found.surface][place]))
        lines.append(f"{kind.title} {value} {kind.unit}")
    return lines
