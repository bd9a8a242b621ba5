"""Mesh builders on rectangular grids: a box, a beam, a tower crane.

The crane is that of Zdziebko & Holak, Sensors 2021, 21(18), 6046.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.errors import InputError
from gpusim.mesh.boundary import boundary_faces
from gpusim.mesh.builders.notches import Notch, notch_axes, notched, stepped_axis
from gpusim.mesh.mesh import Mesh
from gpusim.mesh.selection import select_faces
from gpusim.validation import Positive, checked, count_of, real_numbers, require


def box(
    size: Sequence[float],
    divisions: Sequence[int],
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    notches: Sequence[Notch] = (),
) -> Mesh:
    """A brick of hex8 with one corner at ``origin`` and edges ``size`` (any length unit).

    With ``notches`` (positions in the frame of the brick, see `Notch`) the size of the elements
    away from them is that of ``divisions``, and they get finer towards each notch.

    Face sets ``x_min … z_max`` and ``notch_1 …``; nodes count x fastest, then y, then z.

    Examples
    --------
    >>> gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1)).bounds
    array([[0., 0., 0.],
           [2., 1., 1.]])
    """
    lengths = triple_of("box: size", size)
    start = triple_of("box: origin", origin, positive=False)
    counts = _counts("box: divisions", divisions)
    if notches:
        body = np.stack([start, start + lengths])
        axes = notch_axes(body, [float(n) for n in lengths / counts], notches)
        return notched(_axes_grid(axes), notches)
    return _axes_grid(
        [start[k] + lengths[k] * np.arange(counts[k] + 1) / counts[k] for k in range(3)]
    )  # i*L/n: exact at both ends, where linspace may miss by a rounding


def beam(
    length: float,
    width: float,
    height: float,
    divisions: Sequence[int],
    *,
    end_width: float | None = None,
    end_height: float | None = None,
    notches: Sequence[Notch] = (),
) -> Mesh:
    """A bar of hex8 along x, its axis on the x axis (any length unit).

    It fills x in [0, length], y in [-width/2, width/2], z in [-height/2, height/2]; with
    ``end_width`` or ``end_height`` the section tapers linearly to those at x = length.
    ``divisions`` are the numbers of elements along x, y, z; with ``notches`` they say how large the
    elements away from the notches are. Face sets ``x_min … z_max`` and ``notch_1 …``.

    Raises InputError for a length that isn't positive, and for a notch in a tapered beam.

    Examples
    --------
    >>> gs.mesh.beam(length=1.0, width=0.1, height=0.1, divisions=(4, 1, 1), end_width=0.05)
    Mesh(20 nodes, 4 hex8, 6 named sets)
    """
    sizes = triple_of("beam: length, width, height", (length, width, height))
    end = triple_of(
        "beam: length, end_width, end_height",
        (length, width if end_width is None else end_width,
         height if end_height is None else end_height),
    )  # fmt: skip
    corner = (0.0, -0.5 * float(sizes[1]), -0.5 * float(sizes[2]))
    straight = box((length, width, height), divisions, corner, notches)
    ratio = end / sizes
    if (ratio == 1.0).all():
        return straight
    if notches:
        raise InputError("beam: notches in a tapered beam; expected one or the other")
    points = straight.points.copy()
    points[:, 1:] *= 1.0 + (ratio[1:] - 1.0) * (points[:, :1] / sizes[0])
    return Mesh(points, straight.cells, {}, straight.face_sets)


@checked
def crane(
    *,
    height: Positive = 0.562,
    length: Positive = 0.597,
    foot: Positive = 0.070,
    width: Positive = 0.040,
    column_thickness: Positive = 0.006,
    beam_thickness: Positive = 0.004,
    load_length: Positive = 0.108,
    element_size: Positive = 0.003,
    through: int = 2,
    across: int = 6,
) -> Mesh:
    """The tower crane: a column with a beam on top, hex8, conforming at the joint.

    Frame: the column fills x in [0, column_thickness], y in [-width/2, width/2], z in [-foot,
    height]; the beam x in [0, length], z in [height, height + beam_thickness]. Lengths in metres
    by default (any consistent unit works). ``element_size`` is along the members, ``through``
    elements through each thickness, ``across`` over the width (finer towards its edges, where
    the shear stress of torsion turns). Element borders fall on z = 0 and x = length - load_length.

    Node set "foot" (z <= 0). Face sets "foot" (the faces below z = 0), "load" (top of the last
    ``load_length``), "front" and "back" (y = -width/2, +width/2), "tip" (x = length).

    Examples
    --------
    >>> gs.mesh.crane(element_size=0.05, through=1, across=2)
    Mesh(156 nodes, 50 hex8, 6 named sets)
    """
    expected = f"less than length - column_thickness = {length - column_thickness}"
    require(load_length < length - column_thickness, "crane: load_length", load_length, expected)
    thick, wide = count_of("crane: through", through), count_of("crane: across", across)
    x = stepped_axis(
        [0.0, column_thickness, length - load_length, length], element_size, fixed={0: thick}
    )
    # finer towards the edges: torsion of a thin section turns there within one thickness
    half = -0.5 * width * np.cos(np.pi * np.arange(wide + 1) / wide)
    y = 0.5 * (half - half[::-1])  # exactly symmetric, both ends exact
    z = stepped_axis([-foot, 0.0, height, height + beam_thickness], element_size, fixed={2: thick})
    below = len(z) - 1 - thick
    mesh = _blocks(
        [x, y, z],
        [(range(thick), range(wide), range(below)),
         (range(len(x) - 1), range(wide), range(below, len(z) - 1))],
    )  # fmt: skip
    faces = boundary_faces(mesh)
    top = height + beam_thickness
    sets = {
        "foot": select_faces(mesh, faces=faces, bounds={"z_max": 0.0}),
        "load": select_faces(
            mesh, faces=faces, bounds={"x_min": length - load_length, "z_min": top}, normal="+z"
        ),
        "front": select_faces(mesh, faces=faces, normal="-y"),
        "back": select_faces(mesh, faces=faces, normal="+y"),
        "tip": select_faces(mesh, faces=faces, bounds={"x_min": length}, normal="+x"),
    }
    foot_nodes = np.flatnonzero(mesh.points[:, 2] <= 0.0).astype(np.int32)
    return mesh.with_sets({"foot": foot_nodes}, {name: part.pairs() for name, part in sets.items()})


def _axes_grid(axes: Sequence[Float]) -> Mesh:
    """A full rectangular grid with its six sides as face sets."""
    nx, ny, nz = [len(axis) - 1 for axis in axes]
    number = np.arange(nx * ny * nz, dtype=np.int32).reshape(nz, ny, nx)
    sides = {
        "x_min": (number[:, :, 0], 5), "x_max": (number[:, :, -1], 3),
        "y_min": (number[:, 0], 2), "y_max": (number[:, -1], 4),
        "z_min": (number[0], 0), "z_max": (number[-1], 1),
    }  # fmt: skip
    sets = {
        name: np.stack([cells.ravel(), np.full(cells.size, local, dtype=np.int32)], axis=1)
        for name, (cells, local) in sides.items()
    }
    return _full(axes, sets)


def _full(axes: Sequence[Float], face_sets: Mapping[str, Int]) -> Mesh:
    """Hex8 in all fields of a rectangular grid, x fastest."""
    nx, ny, nz = (len(axis) for axis in axes)
    points = np.empty((nz, ny, nx, 3))
    points[..., 0] = axes[0]
    points[..., 1] = axes[1][:, None]
    points[..., 2] = axes[2][:, None, None]
    lowest = np.arange(nx * ny * nz, dtype=np.int32).reshape(nz, ny, nx)[:-1, :-1, :-1]
    cells = lowest.reshape(-1, 1) + _corners(nx, ny).astype(np.int32)
    return Mesh(points.reshape(-1, 3), {"hex8": cells}, {}, face_sets)


def _blocks(axes: Sequence[Float], blocks: Sequence[tuple[range, range, range]]) -> Mesh:
    """Hex8 in blocks of fields (along x, y, z) of a rectangular grid, x fastest in each.

    Nothing is as large as the whole grid, most of which may be empty.
    """
    nx, ny = len(axes[0]), len(axes[1])
    lowest = [
        (np.array(k)[:, None, None] * ny + np.array(j)[:, None]) * nx + np.array(i)
        for i, j, k in blocks
    ]
    cells = np.concatenate([part.ravel() for part in lowest])[:, None] + _corners(nx, ny)
    used, number = np.unique(cells, return_inverse=True)
    points = np.stack([axes[0][used % nx], axes[1][used // nx % ny], axes[2][used // (nx * ny)]], 1)
    return Mesh(points, {"hex8": number.reshape(cells.shape).astype(np.int32)})


def _corners(nx: int, ny: int) -> Long:
    """Numbers of a field's corners less that of its lowest, in a grid of nx x ny nodes a layer."""
    ring = [0, 1, 1 + nx, nx]
    return np.array([*ring, *(n + nx * ny for n in ring)])


def triple_of(where: str, value: Sequence[float], positive: bool = True) -> Float:
    numbers = real_numbers(value, where)
    low = 0.0 if positive else -np.inf
    fits = numbers.shape == (3,) and ((low < numbers) & (numbers < np.inf)).all()
    require(fits, where, value, "3 numbers > 0" if positive else "3 finite numbers")
    return numbers


def _counts(where: str, value: Sequence[int]) -> list[int]:
    counts = [count_of(where, n) for n in value]
    require(len(counts) == 3, where, f"{len(counts)} numbers", "3")
    return counts
