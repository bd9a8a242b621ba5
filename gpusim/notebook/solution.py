"""A solution: how far it can be trusted, and the deformed body in the colours of a field."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.arrays.srgb import decoded
from gpusim.errors import InputError
from gpusim.export.body_state import BodyState, known_of
from gpusim.export.field_catalogue import BODY
from gpusim.fem import Solution
from gpusim.notebook.axes import draw_faces, space_axes
from gpusim.notebook.mesh import MOST_CELLS, metal_surface, skin_of
from gpusim.notebook.page import Legend, Picture, page, quantity
from gpusim.notebook.shading import Colouring, fitted_camera, shaded
from gpusim.optics.truth import Truth
from gpusim.surface import Skin, Surface
from gpusim.validation import is_number, require
from gpusim.visualization.body_picture import exaggeration
from gpusim.visualization.color_scale import color_map

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIELDS = {name: one for name, one in BODY.items() if one.place == "nodes"}
FIELDS |= {axis: BODY[f"displacement_{axis}"] for axis in "xyz"}
"""What a body may be coloured by, in the model's units; "x" is short for "displacement_x"."""

_STRESS_CELLS = 30_000
"""Of a mesh whose stress is found without being asked for: about half a second."""
_STRESS_UNITS = {"m": "Pa", "mm": "MPa"}
"""By the unit of lengths, with forces in N."""
_COLOURS = "viridis"
_STOPS = 9
_NOTE = "In the model's units: m, N and Pa where a scene made it."


@dataclass(frozen=True, eq=False)
class _Shown:
    """A load case on its skin: displaced ``scale`` times, ``values`` (P,) at the vertices."""

    skin: Skin
    points: Float
    values: Float
    scale: float


def html(solution: Solution) -> str:
    """Error, method, extremes, forces; the deformed body."""
    u = _cases(solution.u)
    length = np.linalg.norm(u, axis=2)
    place = np.unravel_index(int(length.argmax()), length.shape)
    of_case = f", load case {place[0]}" if len(u) > 1 else ""
    rows = [
        ("converged", "yes" if solution.converged else "no"),
        ("estimated error of u", quantity(solution.error_estimate, digits=2)),
        ("method", f"{solution.method}, {solution.iterations} iterations ({solution.backend})"),
        ("unknowns", f"{solution.unknowns:,}"),
        ("largest displacement", f"{quantity(length.max())} (node {place[1]}{of_case})"),
    ]
    model = solution.model
    field = "displacement"
    if model is not None and model.mesh.cell_count <= _STRESS_CELLS:
        field = "von_mises"
        peak = _field(solution, 0, field)
        rows.append(("largest von Mises stress", f"{quantity(peak.max())} (node {peak.argmax()})"))
    for case, sums in enumerate(_cases(solution.reactions).sum(axis=1)):
        if case < 3:
            name = "sum of reactions" + (f", load case {case}" if len(u) > 1 else "")
            noise = 1e-9 * float(np.abs(sums).max())
            shown = np.where(np.abs(sums) > noise, sums, 0.0)
            rows.append((name, ", ".join(quantity(value) for value in shown)))
    if solution.steps:
        rows.append(("stored energy", quantity(solution.strain_energy[0])))
        rows.append(("work of loads and supports", quantity(solution.external_work[0])))
    else:
        rows.append(("energy balance", quantity(solution.energy_balance, digits=2)))
    notes = [_NOTE, *solution.warnings]
    if not solution.converged:
        notes.append(solution.message)
    small = model is not None and model.mesh.cell_count <= MOST_CELLS
    if model is not None and not small:
        notes.append("Not drawn for its size: plot() draws it.")
    return page("Solution", rows, [partial(_picture, solution, field)] if small else [], notes)


def plot(
    solution: Solution,
    ax: Axes | None,
    *,
    field: str = "von_mises",
    case: int = 0,
    scale: float | None = None,
    unit: str = "m",
    cmap: str = _COLOURS,
    **style: Any,
) -> Any:
    """The deformed skin in the colours of a field, with a colour bar."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    shown = _shown(solution, field, case, scale)
    space = space_axes(ax, unit)
    corner = np.where(shown.skin.pieces < 0, shown.skin.pieces[:, [2] * 4], shown.skin.pieces)
    norm = Normalize(*_range(shown.values))
    colours = colormaps[cmap](norm(shown.values[corner].mean(axis=1)))
    draw_faces(space, shown.points, shown.skin.pieces, colours, **style)
    bar = space.figure.colorbar(ScalarMappable(norm, cmap), ax=space, shrink=0.7, pad=0.16)
    bar.set_label(_label(field, unit))
    space.set_title(f"displacements drawn {shown.scale:g} times")
    return space


def _label(field: str, unit: str) -> str:
    stress = _STRESS_UNITS.get(unit, f"N/{unit}²")
    shown = {"mm": unit, "MPa": stress}.get(FIELDS[field].unit, "")
    return f"{FIELDS[field].title} ({shown})" if shown else FIELDS[field].title


def _cases(values: Float) -> Float:
    """(L, N, 3), also for one load case."""
    return values if values.ndim == 3 else values[None]


def _shown(solution: Solution, field: str, case: int, scale: float | None) -> _Shown:
    """What is drawn. Raises InputError for what there isn't."""
    model, u = solution.model, _cases(solution.u)
    if model is None:
        raise InputError("Solution.plot: it has no model; got model None; expected one to draw")
    require(field in FIELDS, "Solution.plot: field", repr(field), f"one of {list(FIELDS)}")
    require(-len(u) <= case < len(u), "Solution.plot: case", case, f"0 to {len(u) - 1}")
    drawable = scale is None or (is_number(scale) and np.isfinite(scale))
    require(drawable, "Solution.plot: scale", repr(scale), "a finite number")
    skin = skin_of(model.mesh)
    rest, moved = skin.at_vertices(model.mesh.points), skin.at_vertices(u[case])
    if scale is None:
        scale = exaggeration(rest, np.linalg.norm(moved, axis=1))
    values = skin.at_vertices(_field(solution, case, field))
    return _Shown(skin, rest + scale * moved, values, scale)


def _field(solution: Solution, case: int, field: str) -> Float:
    """(N,) at the nodes."""
    model, u = solution.model, _cases(solution.u)[case]
    assert model is not None
    warm = 0.0 if model.temperature is None or solution.steps else model.temperature[case]
    state = BodyState(model.mesh, u, model, temperature=warm)
    found = solution.steps[-1].stress if solution.steps else None
    if found is not None:
        state = BodyState(model.mesh, u, known=known_of(found))
    return np.asarray(FIELDS[field].of(state))


def _range(values: Float) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    return low, high if high > low else low + (abs(low) or 1.0)


def _picture(solution: Solution, field: str) -> Picture:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    shown = _shown(solution, field, 0, None)
    low, high = _range(shown.values)
    surface, colouring = _valued(shown, low, high)
    pixels = shaded([surface], fitted_camera(shown.points), colouring, shown.skin.face_of_piece)
    stops = [to_hex(colormaps[_COLOURS](k / (_STOPS - 1))) for k in range(_STOPS)]
    legend = Legend(
        FIELDS[field].title, quantity(low, digits=3), quantity(high, digits=3), ", ".join(stops)
    )
    times = f"Displacements drawn {shown.scale:g} times."
    case = " Load case 0." if solution.u.ndim == 3 else ""
    return Picture(f"the deformed body, {FIELDS[field].title}", pixels, times + case, legend)


def _valued(shown: _Shown, low: float, high: float) -> tuple[Surface, Colouring]:
    """The deformed surface, and its colours by what it has at its vertices.

    The renderer tells of each pixel where its material was before: between the vertices as exactly
    as where it is. So the surface is told to come from places that differ by the values.
    """
    length = 1e-3 * float(np.linalg.norm(np.ptp(shown.points, axis=0)))
    share = (shown.values - low) / (high - low)
    plain = metal_surface(shown.skin)
    surface = Surface(
        shown.points, plain.faces, plain.paint, plain.region,
        shown.points - length * share[:, None] * np.array([1.0, 0.0, 0.0]),
    )  # fmt: skip
    # a little brighter: shading darkens them
    table = np.minimum(1.25 * decoded(color_map(_COLOURS)), 1.0)

    def colours(truth: Truth) -> Float:
        at = np.clip(truth.displacement[:, 0] / length, 0.0, 1.0)
        return table[np.rint(255.0 * at).astype(np.int64)]

    return surface, colours
