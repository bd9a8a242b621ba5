"""Fields in Exodus files: nodal variables over time, read step by step."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field.field import Field
from gpusim.field.names import scalar_names
from gpusim.files.input_file import InputFile
from gpusim.mesh.formats.exodus import read_exodus_steps

__all__ = ["read_exodus_field"]


def read_exodus_field(file: InputFile, name: str | None = None) -> Field:
    """The field of an Exodus file; ``name`` is what the three variables begin with."""
    mesh, steps = read_exodus_steps(file)
    if not len(steps.times):
        raise InputError(f"{file.path}: no time steps; got a mesh without results")
    names = scalar_names(steps.names, name)

    def step(number: int) -> npt.NDArray[np.float64]:
        return steps.values(names, number)

    return Field(mesh, steps.times, step, name=str(file.path))
