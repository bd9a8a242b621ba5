"""Columns of a field's table: places, displacements and strains, measured, true and levelled."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.pipeline.measurements.results import Columns

STRAINS = {"exx": (0, 0), "eyy": (1, 1), "exy": (0, 1)}


def compared_columns(names: tuple[str, ...], *values: Float) -> Columns:
    """Columns of quantities (M, K): measured, true, levelled."""
    return {
        f"{kind}_{name}": column
        for kind, each in zip(("measured", "true", "levelled"), values, strict=True)
        for name, column in zip(names, each.T, strict=True)
    }


def shape_columns(axes: str, found: Float, true: Float) -> Columns:
    """Columns of places (M, K) mm in the first pictures: measured and true."""
    return {
        f"{kind}_{axis}_mm": column
        for kind, each in (("measured", found), ("true", true))
        for axis, column in zip(axes, each.T, strict=True)
    }


def strain_columns(*tensors: Float) -> Columns:
    """`compared_columns` of strains (M, 2, 2)."""
    return compared_columns(tuple(STRAINS), *map(strain_components, tensors))


def strain_components(tensor: Float) -> Float:
    """(M, 3): those of `STRAINS`."""
    return np.stack([tensor[:, i, j] for i, j in STRAINS.values()], axis=1)
