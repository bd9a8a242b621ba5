"""Fields in Exodus files: nodal variables over time, read step by step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field.field import Field
from gpusim.field.names import scalar_names
from gpusim.mesh.exodus import read_exodus, read_exodus_steps

__all__ = ["read_exodus_field"]


def read_exodus_field(path: Path, name: str | None = None) -> Field:
    """The field of an Exodus file; ``name`` is what the three variables begin with."""
    mesh = read_exodus(path)
    steps = read_exodus_steps(path)
    if not len(steps.times):
        raise InputError(f"{path}: no time steps; got a mesh without results")
    names = scalar_names(steps.names, name)

    def step(number: int) -> npt.NDArray[np.float64]:
        return np.stack([steps.values(one, number) for one in names], axis=1)

    return Field(mesh, steps.times, step, name=str(path))
