"""Fields in VTU files: one state, or one per time through ParaView's .pvd and .series."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field.field import Field
from gpusim.field.names import scalar_names, vector_name
from gpusim.files.input_file import SERIES_SUFFIXES, InputFile, read_input, read_series
from gpusim.mesh.formats.cell_blocks import assemble, solid_nodes
from gpusim.mesh.formats.vtu import VtuFile

__all__ = ["read_vtu_field"]

Float = npt.NDArray[np.float64]


def read_vtu_field(file: InputFile, name: str | None = None) -> Field:
    """The field of a .vtu (a single state, at time 1) or of a series of them.

    The mesh is that of the first file; the others must have as many nodes. All pieces of a file
    are read, one after another.
    """
    if file.suffix in SERIES_SUFFIXES:
        steps = read_series(file)
        for _, path in steps:
            if path.suffix.lower() != ".vtu":
                raise InputError(f"{file.path}: names {path.name}; expected .vtu files")
            if not path.is_file():
                raise InputError(f"{file.path}: names {path.name}, which isn't there")
        times = [time for time, _ in steps]
        # the first step is read now, the others, of a size that memory may not hold, when needed
        first_file = file.beside(steps[0][1].absolute(), "a .vtu file")
    else:
        times, first_file = [1.0], file
        steps = [(1.0, file.path)]
    first = VtuFile(first_file)
    raw = first.mesh()
    mesh = assemble(raw, str(first_file.path))
    used = solid_nodes(raw)
    _displacement(first, name)  # a wrong name shows at once

    hashes: dict[int, str] = {}  # of the steps that were read before

    def step(number: int) -> Float:
        path = steps[number][1]
        content = first
        if number:
            later = read_input(
                file.beside(path.absolute(), "a .vtu file"), sha256=hashes.get(number)
            )
            hashes[number] = later.sha256
            content = VtuFile(later)
        u = _displacement(content, name)
        if len(u) != len(used):
            raise InputError(
                f"{path}: got {len(u)} nodes; expected {len(used)}, as in {steps[0][1].name}"
            )
        return u[used]

    return Field(mesh, times, step, name=str(file.path))


def _displacement(content: VtuFile, name: str | None) -> Float:
    """(N, 3) of all nodes in the file."""
    known = content.point_data()
    which = vector_name([key for key, (_, columns) in known.items() if columns > 1], name)
    if which is None:
        try:
            names = scalar_names([key for key, (_, columns) in known.items() if columns <= 1], name)
        except InputError as error:
            had = ", ".join(f"{key} ({columns})" for key, (_, columns) in known.items())
            content.arrays.fail(f"{error}; point data: {had or 'none'}")
        return np.stack([content.point_values(key).astype(np.float64) for key in names], axis=1)
    u = content.point_values(which).astype(np.float64)
    if u.ndim != 2 or u.shape[1] != 3:
        content.arrays.fail(f"{which}; got shape {u.shape}; expected (N, 3)")
    return u
