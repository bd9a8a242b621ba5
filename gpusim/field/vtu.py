"""Fields in VTU files: one state, or one per time through ParaView's .pvd and .series."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field.field import Field
from gpusim.field.names import scalar_names, vector_name
from gpusim.input_file import InputFile, read_input
from gpusim.mesh.raw import assemble, solid_nodes
from gpusim.mesh.read_meshio import raw_of, read_content
from gpusim.series import SERIES_SUFFIXES, read_series

__all__ = ["read_vtu_field"]

Float = npt.NDArray[np.float64]


def read_vtu_field(path: str | PathLike[str] | InputFile, name: str | None = None) -> Field:
    """The field of a .vtu (a single state, at time 1) or of a series of them.

    The mesh is that of the first file; the others must have as many nodes.
    """
    source = read_input(path, "a file with a displacement field")
    if source.suffix in SERIES_SUFFIXES:
        steps = read_series(source)
        times, files = [time for time, _ in steps], [file for _, file in steps]
    else:
        times, files = [1.0], [source.path]
    for file in files:
        if file.suffix.lower() != ".vtu":
            raise InputError(f"{source.path}: names {file.name}; expected .vtu files")
        if not file.is_file():
            raise InputError(f"{source.path}: names {file.name}, which isn't there")

    def content_of(number: int) -> Any:
        file = source if files[number] == source.path else source.beside(files[number].absolute())
        return read_content(file, "vtu")

    first = content_of(0)
    raw = raw_of(first, files[0], "vtu")
    mesh = assemble(raw, str(files[0]))
    used = solid_nodes(raw)
    _displacement(first, files[0], name)  # a wrong name shows at once

    def step(number: int) -> Float:
        content = first if number == 0 else content_of(number)
        u = _displacement(content, files[number], name)
        if len(u) != len(used):
            raise InputError(
                f"{files[number]}: got {len(u)} nodes; expected {len(used)}, as in {files[0].name}"
            )
        return u[used]

    return Field(mesh, times, step, name=str(source.path))


def _displacement(content: Any, file: Path, name: str | None) -> Float:
    """(N, 3) of all nodes in the file."""
    data = {key: values for key, values in content.point_data.items() if values.dtype.kind in "iuf"}
    which = vector_name([key for key, values in data.items() if values.ndim == 2], name)
    if which is None:
        try:
            names = scalar_names([key for key, v in data.items() if v.ndim == 1], name)
        except InputError as error:
            had = ", ".join(f"{key} {values.shape}" for key, values in data.items())
            raise InputError(f"{file}: {error}; point data: {had or 'none'}") from None
        return np.stack([data[key].astype(np.float64) for key in names], axis=1)
    u = np.asarray(data[which], dtype=np.float64)
    if u.shape[1] != 3:
        raise InputError(f"{file}: {which}; got shape {u.shape}; expected (N, 3)")
    return u
