"""The programs that shade a view: one for each kind of paint and light.

Software rasterisers run both sides of every branch: a plain wall must not pay for the pattern on a
marker.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from gpusim.optics.paint.bitmap import BITMAP
from gpusim.optics.paint.checker_lines import BoardLines
from gpusim.optics.shading.setup import GRAZING, Setup
from gpusim.optics.shading.tile_light import LightTiles

__all__ = ["Program", "shader_programs"]


@dataclass(frozen=True, eq=False)
class Program:
    """Override constants, and the numbers of the triangles to draw with them, nearest first."""

    constants: dict[str, float]
    triangles: npt.NDArray[np.uint32]


def shader_programs(
    setup: Setup,
    tiles: LightTiles | None,
    lines: BoardLines | None,
    sort: bool,
) -> list[Program]:
    """The programs that a view needs, one at least (which clears the targets)."""
    result: list[Program] = []
    order = np.zeros(0, np.int64)
    if sort:
        nearest = setup.view.inverse_depth().max(axis=1, initial=0.0)
        order = np.argsort(-nearest, kind="stable")
    none = np.zeros(setup.view.count, bool)
    tiled = none if tiles is None else tiles.member
    boards = none if lines is None else lines.member
    groups = (BITMAP, 3 + GRAZING, 2 + GRAZING, 3, 2, 1, 0)
    each = (True, False)
    kind = setup.groups.astype(np.uint8) << np.uint8(4)
    for bit, flags in enumerate((tiled, setup.bumpy, setup.shiny, boards)):
        if flags.any():
            kind |= flags.view(np.uint8) << np.uint8(bit)
    many = np.bincount(kind, minlength=256)
    if lines is not None:
        strips = kind[lines.parent]
    kind = kind[order] if sort else kind
    for group, board, glossy, bumpy, lit in product(groups, each, each, each, each):
        wanted = 16 * group + 8 * board + 4 * glossy + 2 * bumpy + lit
        numbers = np.flatnonzero(kind == wanted) if many[wanted] else order[:0]
        own: npt.NDArray[np.uint32] = (order[numbers] if sort else numbers).astype(np.uint32)
        if len(own) or not (group or board or glossy or bumpy or lit or result):
            constants = {**setup.constants([group], glossy, bumpy), "light_tiled": float(lit)}
            if board and lines is not None:
                # in front of the others, which are then left out where they are
                strip = setup.view.count + np.flatnonzero(strips == wanted)
                result.insert(0, Program({**constants, "board": 2.0}, strip.astype(np.uint32)))
            result.append(Program({**constants, "board": float(board)}, own))
    return result
