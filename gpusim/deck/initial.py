"""Stress that is there before the first step."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.isoparametric_map import add_to
from gpusim.fem.elements.strain import internal_force
from gpusim.mesh.formats.abaqus.cards import Card
from gpusim.mesh.formats.abaqus.content import InpContent
from gpusim.mesh.formats.abaqus.reader import LabelledMesh
from gpusim.mesh.formats.abaqus.values import number, whole

__all__ = ["InitialStress"]

Float = npt.NDArray[np.float64]

# CalculiX gives xx yy zz xy xz yz, we have xx yy zz xy yz zx.
_ORDER = [0, 1, 2, 3, 5, 4]


class InitialStress:
    """*INITIAL CONDITIONS, TYPE=STRESS at integration points.

    ``values`` maps a cell type to (M,Q,6) float64, order xx yy zz xy yz zx; empty: none is given.
    """

    def __init__(
        self, content: InpContent, labelled: LabelledMesh, formulation: Mapping[str, str]
    ) -> None:
        self.content = content
        self.labelled = labelled
        self.formulation = formulation
        self.values: dict[str, Float] = {}

    def read(self, card: Card) -> None:
        """Element or element set, integration point (left out: all), and six stresses.

        CalculiX names points one by one; Abaqus leaves them out. Bricks only: other elements'
        points are counted differently by different programs. Raises InputError.
        """
        for line, row in card.rows():
            where = card.where(line)
            if len(row) not in (7, 8):
                raise InputError(
                    f"{where}: got {len(row)} fields; expected element, integration point "
                    "(or none: all), six stresses"
                )
            cells = self.labelled.cell_index(self.content.cells_named(row[0], where))
            stress = np.array([number(text, where) for text in row[-6:]])[_ORDER]
            point = whole(row[1], where) if len(row) == 8 else None
            self._set(cells, point, stress, where)

    def _set(
        self, cells: npt.NDArray[np.int64], point: int | None, stress: Float, where: str
    ) -> None:
        for kind, first, block in self.labelled.mesh.blocks():
            mine = cells[(cells >= first) & (cells < first + len(block))] - first
            if not mine.size:
                continue
            count = len(ELEMENTS[kind].rule(self.formulation[kind]).weight)
            if not kind.startswith("hex"):
                raise InputError(f"{where}: initial stress of {kind}; expected C3D8 or C3D20 types")
            if point is not None and not 1 <= point <= count:
                raise InputError(f"{where}: integration point; got {point}; expected 1 … {count}")
            values = self.values.setdefault(kind, np.zeros((len(block), count, 6)))
            values[mine, slice(None) if point is None else point - 1] = stress

    def forces(self) -> Float:
        """(N,3) nodal forces that the stress exerts where nothing holds it."""
        mesh = self.labelled.mesh
        forces = np.zeros((mesh.node_count, 3))
        for kind, _, block in mesh.blocks():
            if kind in self.values:
                held = internal_force(
                    kind, self.formulation[kind], mesh.points[block], self.values[kind]
                )
                add_to(forces, block, -held)
        return forces
