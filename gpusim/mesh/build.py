"""Mesh builders: a box, and the tower crane of Zdziebko & Holak (Sensors 2021, 21(18), 6046)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from numbers import Real

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh.faces import boundary_faces
from gpusim.mesh.mesh import Mesh
from gpusim.mesh.select import select_faces

__all__ = ["box", "crane"]

Float = npt.NDArray[np.float64]


def box(
    size: Sequence[float],
    divisions: Sequence[int],
    origin: Sequence[float] = (0.0, 0.0, 0.0),
) -> Mesh:
    """A brick of hex8 with one corner at ``origin`` and edges ``size`` (any length unit).

    Face sets ``x_min … z_max``; nodes count x fastest, then y, then z.
    """
    lengths = _triple("box: size", size)
    start = _triple("box: origin", origin, positive=False)
    counts = [_count("box: divisions", n) for n in divisions]
    if len(counts) != 3:
        raise InputError(f"box: divisions; got {len(counts)} numbers; expected 3")
    axes = [
        start[k] + lengths[k] * np.arange(counts[k] + 1) / counts[k] for k in range(3)
    ]  # i*L/n: exact at both ends, where linspace may miss by a rounding
    mesh = _grid(axes, np.ones(counts, dtype=bool))
    return _with_side_sets(mesh)


def crane(
    *,
    height: float = 0.562,
    length: float = 0.597,
    foot: float = 0.070,
    width: float = 0.040,
    column_thickness: float = 0.006,
    beam_thickness: float = 0.004,
    load_length: float = 0.108,
    element_size: float = 0.003,
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
    """
    names = {
        "height": height, "length": length, "foot": foot, "width": width,
        "column_thickness": column_thickness, "beam_thickness": beam_thickness,
        "load_length": load_length, "element_size": element_size,
    }  # fmt: skip
    for name, value in names.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"crane: {name}; got {value}; expected a length > 0")
    if not load_length < length - column_thickness:
        raise InputError(
            f"crane: load_length; got {load_length}; expected less than length - column_thickness "
            f"= {length - column_thickness}"
        )
    thick, wide = _count("crane: through", through), _count("crane: across", across)
    x = _pieces(
        [0.0, column_thickness, length - load_length, length], element_size, fixed={0: thick}
    )
    # finer towards the edges: torsion of a thin section turns there within one thickness
    half = -0.5 * width * np.cos(np.pi * np.arange(wide + 1) / wide)
    y = 0.5 * (half - half[::-1])  # exactly symmetric, both ends exact
    z = _pieces([-foot, 0.0, height, height + beam_thickness], element_size, fixed={2: thick})
    filled = np.zeros((len(x) - 1, wide, len(z) - 1), dtype=bool)
    filled[:thick] = True
    filled[:, :, len(z) - 1 - thick :] = True
    mesh = _grid([x, y, z], filled)
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


def _grid(axes: Sequence[Float], filled: npt.NDArray[np.bool_]) -> Mesh:
    """Hex8 in the filled fields of a rectangular grid, x fastest; unused nodes are left out."""
    nx, ny, nz = (len(axis) for axis in axes)
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    k, j, i = np.nonzero(filled.transpose(2, 1, 0))
    base = i + nx * (j + ny * k)
    ring = np.array([0, 1, 1 + nx, nx])
    corner = np.concatenate([ring, ring + nx * ny])
    cells = base[:, None] + corner[None]
    used = np.unique(cells)
    renumber = np.zeros(nx * ny * nz, dtype=np.int32)
    renumber[used] = np.arange(len(used), dtype=np.int32)
    return Mesh(points[used], {"hex8": renumber[cells]})


def _pieces(breaks: Sequence[float], size: float, fixed: dict[int, int]) -> Float:
    """Coordinates that meet every break exactly; about ``size`` apart, or a fixed count."""
    parts: list[Float] = []
    for number, (start, end) in enumerate(pairwise(breaks)):
        count = fixed.get(number) or max(1, round((end - start) / size))
        # start + i*step keeps neighbouring elements congruent; the end comes from the next piece
        parts.append(start + (end - start) * np.arange(count) / count)
    return np.concatenate([*parts, [breaks[-1]]])


def _with_side_sets(mesh: Mesh) -> Mesh:
    faces = boundary_faces(mesh)
    sets = {}
    for axis in "xyz":
        for side, sign in (("min", "-"), ("max", "+")):
            sets[f"{axis}_{side}"] = select_faces(mesh, faces=faces, normal=sign + axis).pairs()
    return mesh.with_sets(face_sets=sets)


def _triple(where: str, value: Sequence[float], positive: bool = True) -> Float:
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    good = numbers.shape == (3,) and bool(np.isfinite(numbers).all())
    if not good or (positive and not (numbers > 0.0).all()):
        kind = "3 numbers > 0" if positive else "3 finite numbers"
        raise InputError(f"{where}; got {value}; expected {kind}")
    return numbers


def _count(where: str, value: int) -> int:
    if not (isinstance(value, Real) and 1 <= value < np.inf and int(value) == value):
        raise InputError(f"{where}; got {value}; expected a whole number >= 1")
    return int(value)
