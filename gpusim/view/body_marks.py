"""What stands at the bodies in space: measured points, symbols, the undeformed shape, the smallest
and the largest value, the selection."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.view.camera_marks import draw_distortion, draw_image_frame, draw_principal_point
from gpusim.view.content.picking import Pick
from gpusim.view.view_state import ViewState
from gpusim.visualization.color_scale import format_value, value_text
from gpusim.visualization.mesh_edges import crease_edges, element_edges
from gpusim.visualization.overlay import Overlay
from gpusim.visualization.symbols import BEFORE, Symbols

SIZE = 14
"""px of letters."""
GHOST = "#e8b23ad0"
"""Of the undeformed shape."""
ALL_HARD = 15
"""No edge of a square is softened: neighbours meet without a seam."""


def draw_body_marks(viewer: ViewState, overlay: Overlay) -> None:
    """All of it but the selection; of what hides it only a sharp picture tells."""
    content, shown, (camera, _, _) = viewer.content, viewer.shown, viewer.camera()
    assert content is not None
    hides = viewer.picture.base if not viewer.picture.waits else None
    symbols = Symbols(overlay, camera, viewer.place, hides)
    if viewer.field_values is not None and viewer.field_values.points is not None:
        _draw_squares(viewer, symbols)
    if hides is not None:
        for ends in content.creases:
            symbols.lines(ends, "#00000090", 1.0)
    if shown["undeformed"]:
        for _, surface in content.whole:
            symbols.lines(crease_edges(surface, eye=camera.eye), GHOST, 1.4, pale=0.45)
    _draw_models(viewer, symbols)
    if shown["cameras"]:
        outline = content.outline(viewer.frame, viewer.scale)
        others = [own for own in content.cameras if np.linalg.norm(own.eye - camera.eye) > 0.0]
        symbols.cameras(others, 0.2 * float(np.ptp(outline, axis=0).max()))
    if shown["extremes"]:
        _draw_extremes(viewer, symbols)
    width, height = viewer.size
    if viewer.through is not None:
        draw_image_frame(overlay, camera, viewer.place, width, height)
        draw_principal_point(overlay, camera, viewer.place)
        if shown["cameras"]:
            draw_distortion(overlay, camera, viewer.place)
    else:
        below = 50.0 + viewer.taken()[1]
        symbols.tripod(width - 60.0, height - below, min(42.0, 0.1 * height))


def _draw_models(viewer: ViewState, symbols: Symbols) -> None:
    """Borders of elements, supports and loads."""
    content, shown, surfaces = viewer.content, viewer.shown, viewer.surfaces()
    assert content is not None
    for number, skin in enumerate(content.skins):
        if shown["mesh"] and symbols.frame is not None:
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


# -- measured points and values


def _squares(viewer: ViewState) -> tuple[Float, Float]:
    """Values (n,) of measured points that are shown; middle and corners (n, 5, 3) of their squares
    as they have moved with the bodies."""
    content, found = viewer.content, viewer.field_values
    assert content is not None and found is not None and found.points is not None
    point, places = content.squares(found.points, viewer.device)
    corners, shown = np.zeros((len(point), 5, 3)), np.zeros(len(point), bool)
    for number, (skin, _) in enumerate(content.whole):
        own = places.surface == number
        u = content.displacement(number, viewer.frame)
        vertices = skin.at_vertices(skin.mesh.points + viewer.scale * u)
        corners[own] = places.weights[own] @ vertices[places.vertices[own]]
        shown[own] = content.kept[number][skin.cell_of_piece[places.face[own]]]
    values = found.values[0][point]
    shown &= np.isfinite(values)
    return values[shown], corners[shown]


def _draw_squares(viewer: ViewState, symbols: Symbols) -> None:
    """Measured points in the colours of their values, those that are seen from their front."""
    (values, places), scale = _squares(viewer), viewer.color_scale
    at, eye = symbols.window(places[:, 1:]), symbols.camera.eye
    (x, y), (u, v) = (at[:, 2] - at[:, 0]).T, (at[:, 3] - at[:, 1]).T
    before = eye + (1.0 - BEFORE) * (places[:, 0] - eye)
    own = (x * v - y * u > 0.0) & symbols.seen(before, around=True)
    share = np.clip((values[own] - scale.low) / (scale.high - scale.low), 0.0, 1.0)
    colors = scale.colors[np.rint(share * (len(scale.colors) - 1)).astype(int)]
    symbols.overlay.polygons(at[own], np.insert(colors, 3, 1.0, axis=1), ALL_HARD)


def _values_in_space(viewer: ViewState) -> Iterator[tuple[Float, Float]]:
    """Values (n,) of the field on what is shown, and where they are (n, 3), surface by surface."""
    found = viewer.field_values
    if found is not None and found.points is not None:
        values, places = _squares(viewer)
        yield values, places[:, 0]
        return
    for surface, field in zip(viewer.surfaces(), viewer.surface_fields(), strict=False):
        topology = surface.topology
        if field.by_face:
            yield field.values[topology.source], surface.points[topology.triangles].mean(axis=1)
        else:
            yield field.values, surface.points


def _draw_extremes(viewer: ViewState, symbols: Symbols) -> None:
    """Rings round the smallest and the largest value of what is shown."""
    if viewer.field_values is None:
        return
    every = list(_values_in_space(viewer))
    values, places = (np.concatenate([one[k] for one in every]) for k in (0, 1))
    values, places = values[np.isfinite(values)], places[np.isfinite(values)]
    if not len(values) or values.min() == values.max():
        return
    unit = viewer.field_values.field.unit
    marks = [(f"{word} {value_text(float(values[k]), unit)}", places[k])
             for word, k in (("min", values.argmin()), ("max", values.argmax()))]  # fmt: skip
    free = np.stack([(0.0, 0.0), np.subtract(viewer.size, viewer.taken())])
    symbols.rings(marks, SIZE, free)


# -- selection


def mark_selection(viewer: ViewState, overlay: Overlay) -> str:
    """A mark where the selected material point is now; what is known of it."""
    found, content = viewer.selected, viewer.content
    assert found is not None and content is not None
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
    return "\n".join(_selection_lines(viewer, at, moved, pixel))


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
    return [*lines, *_selected_value(viewer, found)]


def _selected_value(viewer: ViewState, found: Pick) -> Iterator[str]:
    """The field at the selection: of its element, its node, or the measured point beside it."""
    field, content = viewer.field_values, viewer.content
    if field is None or found.node is None or content is None:
        return
    number, place = found.surface, found.node
    if field.points is not None:
        point, places = content.squares(field.points, viewer.device)
        away = np.linalg.norm(places.reference - found.reference, axis=2)
        if not len(away) or not away[:, 0].min() <= away[away[:, 0].argmin(), 1:].max():
            return  # outside of the nearest square
        number, place = 0, int(point[away[:, 0].argmin()])
    elif field.field.place == "elements":
        place = found.element or 0
    yield f"{field.field.title} {value_text(float(field.values[number][place]), field.field.unit)}"
