"""Builders of structured hexahedral plates with round holes: a flat plate, and a bent bracket.

They consist of blocks in a plane, joined at their common borders and extruded.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.errors import InputError
from gpusim.mesh.boundary import Faces, boundary_faces
from gpusim.mesh.builders.grids import triple_of
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.mesh import Mesh
from gpusim.validation import Positive, checked, count_of, one_of, require

# element type -> steps of the node grid per element
HEX_OF_ORDER = {"hex8": 1, "hex20": 2, "hex27": 2}
Brick = Annotated[str, one_of(*HEX_OF_ORDER)]


def ruled(first: Float, last: Float, places: Float) -> Float:
    """A block (len(first), len(places), 2) between two lines of points, straight across them.

    ``places`` run from 0 (on ``first``) to 1 (on ``last``).
    """
    weight = places[None, :, None]
    return np.asarray((1.0 - weight) * first[:, None] + weight * last[:, None])


def extruded(blocks: Sequence[Float], heights: Float, kind: str) -> tuple[Float, Int]:
    """Points (N,3) and cells (M,k) of ``kind`` over planar blocks.

    Parameters
    ----------
    blocks
        Each (a, b, 2) points of a grid whose two directions and +z are right-handed. For a
        quadratic ``kind`` every second line is one of midside nodes (odd a and b).
    heights
        (c,) growing z of the node planes, midside planes included.

    Points that agree exactly become one node: neighbouring blocks share the numbers on their
    common border.
    """
    step = HEX_OF_ORDER[kind]
    flat = np.concatenate([block.reshape(-1, 2) for block in blocks])
    # as complex numbers: compared exactly, by x, then by y
    named, name = np.unique(flat[:, 0] + 1j * flat[:, 1], return_inverse=True)
    plane = np.stack([named.real, named.imag], axis=1)

    layer = len(plane)
    cells: list[Long] = []
    start = 0
    template = _template(kind)
    levels = np.arange(0, len(heights) - 1, step)
    for block in blocks:
        a, b = block.shape[:2]
        i, j, k = np.meshgrid(
            np.arange(0, a - 1, step), np.arange(0, b - 1, step), levels, indexing="ij"
        )
        local = (i.ravel()[:, None] + template[:, 0]) * b + j.ravel()[:, None] + template[:, 1]
        cells.append(name[start + local] + layer * (k.ravel()[:, None] + template[:, 2]))
        start += a * b
    z = np.repeat(heights, layer)
    points = np.column_stack([np.tile(plane, (len(heights), 1)), z])
    numbers = np.concatenate(cells)
    used = np.zeros(len(points), dtype=bool)
    used[numbers.ravel()] = True
    return points[used], (np.cumsum(used, dtype=np.int32) - np.int32(1))[numbers]


def _template(kind: str) -> Long:
    """(k,3) steps of each local node from the cell's lowest corner."""
    step = HEX_OF_ORDER[kind]
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners = step * np.array([(i, j, k) for k in (0, 1) for i, j in ring], dtype=np.int64)
    if step == 1:
        return corners
    middles = [corners[list(row)].sum(axis=0) // len(row) for row in CELL_TYPES[kind].parents]
    return np.concatenate([corners, np.array(middles)])


@checked
def plate_with_hole(
    length: float,
    width: float,
    thickness: float,
    hole_diameter: float,
    *,
    around: int = 32,
    radial: int = 8,
    through: int = 2,
    element: Brick = "hex8",
) -> Mesh:
    """A plate with a round hole in its middle, of structured hexahedra (any length unit).

    Frame: x along the length, y along the width, z through the thickness from 0; the hole's centre
    is the origin. A square of side min(length, width) around the hole is meshed in rings, finer
    towards the hole; what is left of the plate continues its grid.

    Parameters
    ----------
    around
        Elements around the hole, a multiple of 4.
    radial
        Elements from the hole to the square's border.
    through
        Elements through the thickness.
    element
        "hex8", "hex20" or "hex27"; midside nodes lie on the circle.

    Face sets "hole", "x_min" … "z_max". Raises InputError for sizes that don't fit.

    Examples
    --------
    >>> gs.mesh.plate_with_hole(2.0, 1.0, 0.1, hole_diameter=0.4, around=8, radial=2, through=1)
    Mesh(60 nodes, 20 hex8, 7 named sets)
    """
    sizes = triple_of("plate_with_hole: length, width, thickness", (length, width, thickness))
    step = HEX_OF_ORDER[element]
    sides, rings = _ring_counts("plate_with_hole", around, radial)
    layers = count_of("plate_with_hole: through", through)
    square = float(min(sizes[0], sizes[1]))
    radius = _radius("plate_with_hole: hole_diameter", hole_diameter, square)
    whole = 0.5 * sizes[:2, None] * np.array([-1.0, 1.0])
    long = 0 if sizes[0] >= sizes[1] else 1
    rest = 0.5 * (float(sizes[long]) - square)
    inner = whole.copy()
    if rest > 1e-9 * square:
        inner[long] = [-0.5 * square, 0.5 * square]
    blocks = _ring(inner, radius, sides, rings, step)
    if rest > 1e-9 * square:
        count = max(1, round(rest * sides / square)) * step
        for end in (0, 1):
            border = _side(inner, sides * step, long, end)
            outer = border.copy()
            outer[:, long] = whole[long, end]
            blocks.append(ruled(border, outer, np.arange(count + 1) / count))
    heights = sizes[2] * np.arange(layers * step + 1) / (layers * step)
    points, cells = extruded([_right_handed(block) for block in blocks], heights, element)
    mesh = Mesh(points, {element: cells})
    faces = boundary_faces(mesh)
    low, high = mesh.bounds
    tolerance = 1e-9 * float((high - low).max())
    sets = {
        f"{axis}_{side}": _where(faces, np.abs(points[:, k] - bound[k]) <= tolerance)
        for k, axis in enumerate("xyz")
        for side, bound in (("min", low), ("max", high))
    }
    distance = np.hypot(points[:, 0], points[:, 1])
    sets["hole"] = _where(faces, distance <= radius * (1.0 + 1e-9))
    return mesh.with_sets(face_sets=sets)


@checked
def bracket(
    *,
    base_length: Positive = 0.06,
    wall_height: Positive = 0.08,
    width: Positive = 0.04,
    thickness: Positive = 0.005,
    fillet_radius: Positive = 0.006,
    hole_diameter: float = 0.012,
    around: int = 32,
    radial: int = 5,
    through: int = 2,
    bend: int = 6,
    element: Brick = "hex8",
) -> Mesh:
    """An L-bracket of bent plate with a hole in each leg, of structured hexahedra.

    Frame: the base lies on z = 0 and reaches to x = ``base_length``; the wall stands on x = 0 and
    reaches to z = ``wall_height``; y runs over the width from -width/2 to width/2. The legs meet in
    a round bend of inner radius ``fillet_radius`` and outer radius fillet_radius + thickness. Each
    hole is centred half a width from its leg's free end. Lengths in metres by default (any
    consistent unit works).

    ``around``, ``radial``, ``through``, ``element`` as for `plate_with_hole`; ``bend`` elements
    along the bend. Face sets "base" (z = 0), "wall" (x = 0), "base_hole", "wall_hole", "base_end",
    "wall_end", "y_min", "y_max".

    Raises InputError for sizes that don't fit: each leg needs room for a square of side ``width``
    beside the bend.

    Examples
    --------
    >>> sorted(gs.mesh.bracket(around=8, radial=2, through=1, bend=2).face_sets)[:3]
    ['base', 'base_end', 'base_hole']
    """
    step = HEX_OF_ORDER[element]
    sides, rings = _ring_counts("bracket", around, radial)
    layers, bends = count_of("bracket: through", through), count_of("bracket: bend", bend)
    radius = _radius("bracket: hole_diameter", hole_diameter, width)
    outer = fillet_radius + thickness
    legs = [base_length - outer, wall_height - outer]
    expected = f"at least width + fillet_radius + thickness = {width + outer:.6g}"
    for name, length in (("base_length", base_length), ("wall_height", wall_height)):
        fits = length - outer >= width * (1.0 - 1e-9)
        require(fits, f"bracket {name}", f"{length:.6g}", expected)
    # The plate laid flat: s < 0 on the base, 0 … width over the bend, beyond it on the wall.
    half = 0.5 * width
    squares = []
    blocks = []
    bend_ends = []
    for leg, start, sign in ((legs[0], 0.0, -1.0), (legs[1], width, 1.0)):
        rest = leg - width
        near = start if rest <= 1e-9 * width else start + sign * rest
        limits = np.array([sorted([near, start + sign * leg]), [-half, half]])
        blocks += _ring(limits, radius, sides, rings, step)
        border = _side(limits, sides * step, 0, 1 if sign < 0.0 else 0)
        end = border.copy()
        end[:, 0] = start
        if near != start:
            count = max(1, round(rest * sides / width)) * step
            blocks.append(ruled(border, end, np.arange(count + 1) / count))
        squares.append(limits)
        bend_ends.append(end)
    first, last = bend_ends
    blocks.append(ruled(first, last, np.arange(bends * step + 1) / (bends * step)))
    heights = thickness * np.arange(layers * step + 1) / (layers * step)
    flat, cells = extruded([_right_handed(block) for block in blocks], heights, element)
    mesh = Mesh(_bent(flat, fillet_radius, thickness, width), {element: cells})
    return mesh.with_sets(face_sets=_bracket_sets(mesh, flat, squares, radius))


def _bent(flat: Float, fillet: float, thickness: float, turn: float) -> Float:
    """From (s, -y, height over the outer side) to the bracket's frame; the bend is s = 0 … turn.

    The sign of y keeps the frames right-handed: s runs against x on the base.
    """
    s, across, height = flat.T
    outer = fillet + thickness
    angle = 0.5 * np.pi * np.clip(s / turn, 0.0, 1.0)
    depth = outer - height  # distance from the bend's axis
    on_base, on_wall = s <= 0.0, s >= turn
    x = np.where(on_base, outer - s, np.where(on_wall, height, outer - depth * np.sin(angle)))
    z = np.where(
        on_base, height, np.where(on_wall, outer + (s - turn), outer - depth * np.cos(angle))
    )
    return np.stack([x, -across, z], axis=1)


def _bracket_sets(
    mesh: Mesh, flat: Float, squares: Sequence[Float], radius: float
) -> dict[str, Int]:
    faces = boundary_faces(mesh)
    (s, across, height), y = flat.T, mesh.points[:, 1]
    low, high = squares[0][0, 0], squares[1][0, 1]
    tolerance = 1e-9 * (high - low)
    turn = float(squares[0][1, 1] - squares[0][1, 0])
    base, wall = (limits.mean(axis=1) for limits in squares)
    near = radius * (1.0 + 1e-9)
    return {
        "base": _where(faces, (height <= tolerance) & (s <= tolerance)),
        "wall": _where(faces, (height <= tolerance) & (s >= turn - tolerance)),
        "base_hole": _where(faces, np.hypot(s - base[0], across) <= near),
        "wall_hole": _where(faces, np.hypot(s - wall[0], across) <= near),
        "base_end": _where(faces, s <= low + tolerance),
        "wall_end": _where(faces, s >= high - tolerance),
        "y_min": _where(faces, y <= -0.5 * turn + tolerance),
        "y_max": _where(faces, y >= 0.5 * turn - tolerance),
    }


def _ring(limits: Float, radius: float, sides: int, rings: int, step: int) -> list[Float]:
    """Four blocks between a circle and the rectangle (2,2) around it, finer towards the circle.

    ``sides`` elements along each side, ``rings`` from the circle outwards, ``step`` grid steps in
    each.
    """
    centre = limits.mean(axis=1)
    gap = 0.5 * float((limits[:, 1] - limits[:, 0]).min()) - radius
    places = _radial_places(gap, 0.5 * np.pi * radius / sides, rings, step)
    count = sides * step
    angles = -0.75 * np.pi + 0.5 * np.pi * np.arange(4 * count + 1) / count
    circle = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    circle[-1] = circle[0]  # the same numbers, so that the blocks share their nodes
    border = [
        _side(limits, count, 1, 0),
        _side(limits, count, 0, 1),
        _side(limits, count, 1, 1)[::-1],
        _side(limits, count, 0, 0)[::-1],
    ]
    return [ruled(circle[k * count : (k + 1) * count + 1], border[k], places) for k in range(4)]


def _side(limits: Float, count: int, axis: int, end: int) -> Float:
    """(count+1, 2) points on the rectangle's side at ``limits[axis, end]``, in growing order."""
    points = np.empty((count + 1, 2))
    points[:, axis] = limits[axis, end]
    low, high = limits[1 - axis].tolist()
    points[:, 1 - axis] = np.linspace(low, high, count + 1)
    return points


def _radial_places(gap: float, first: float, rings: int, step: int) -> Float:
    """0 … 1 in ``rings`` geometric steps that begin with about ``first`` over ``gap``."""
    low, high = 1.0, 2.0
    for _ in range(60):  # the ratio whose sum of steps fills the gap
        ratio = 0.5 * (low + high)
        total = first * float((ratio ** np.arange(rings)).sum())
        low, high = (ratio, high) if total < gap else (low, ratio)
    edges = np.concatenate([[0.0], np.cumsum(ratio ** np.arange(rings))])
    edges /= edges[-1]
    if step == 1:
        return np.asarray(edges)
    places = np.empty(2 * rings + 1)
    places[::2], places[1::2] = edges, 0.5 * (edges[1:] + edges[:-1])
    return places


def _right_handed(block: Float) -> Float:
    """The block with its two directions and +z right-handed."""
    a, b = block[1, 0] - block[0, 0], block[0, 1] - block[0, 0]
    return block if a[0] * b[1] - a[1] * b[0] > 0.0 else block[:, ::-1]


def _where(faces: Faces, inside: Bool) -> Int:
    """(cell, local face) of the faces whose nodes are all inside."""
    every = (inside[np.maximum(faces.nodes, 0)] | (faces.nodes < 0)).all(axis=1)
    return faces[np.flatnonzero(every)].pairs()


def _ring_counts(what: str, around: int, radial: int) -> tuple[int, int]:
    count = count_of(f"{what}: around", around)
    if count % 4 or count < 8:
        raise InputError(f"{what}: around; got {around}; expected a multiple of 4, at least 8")
    return count // 4, count_of(f"{what}: radial", radial)


def _radius(what: str, diameter: float, room: float) -> float:
    if not (np.isfinite(diameter) and 0.0 < diameter < 0.98 * room):
        raise InputError(f"{what}; got {diameter}; expected more than 0 and less than {room:.6g}")
    return 0.5 * float(diameter)
