"""How elements answer to a motion: internal forces, tangents, and what they remember of it.

Elements of one type and one law answer by chunks, and disjoint chunks may be asked from several
threads. What they remember (internal modes, foretold stresses, states of the points) is part of a
load step and is set back with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Protocol

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.errors import NotConverged, require
from gpusim.fem.elements.element import ELEMENTS, Rule
from gpusim.fem.elements.isoparametric_map import determinant, reference_gradient
from gpusim.fem.materials.law import Material

# elements that are checked at a time
_CHUNK = 4096


class Want(Enum):
    """What is asked of elements beside forces: nothing, the tangent, or its material part alone,
    which is definite wherever the law's moduli are."""

    FORCES = auto()
    TANGENT = auto()
    MATERIAL = auto()


@dataclass(frozen=True, eq=False)
class ElementBlock:
    """Elements of one type, formulation and law.

    name, formulation : a key of ``ELEMENTS`` and one of its formulations.
    points : (N,3) reference positions of all nodes; ``cells`` (M,k) their numbers.
    free_strain : (M,Q,6) strain that causes no stress, engineering shear, along global axes at
        rest, so that it turns with the material; None: none. At finite strain it is subtracted
        from the Green-Lagrange strain: a stretch 1 + e of heat is e + e^2/2.
    numbers : (M,) of the mesh's cells; None where they are no mesh's.
    """

    name: str
    formulation: str
    points: Float
    cells: Int
    law: Material
    free_strain: Float | None = None
    numbers: Long | None = None

    def __post_init__(self) -> None:
        rule, centre = self.rule, ELEMENTS[self.name].centre_gradient
        for start in range(0, len(self.cells), _CHUNK):
            nodes = self.relative(
                self.points, np.arange(start, min(start + _CHUNK, len(self.cells)))
            )
            det = determinant(reference_gradient(nodes, rule))
            det0 = determinant(centre_slope(nodes, centre))
            good = (np.concatenate([det, det0[:, None]], axis=1) > 0.0).all(axis=1)
            require(
                bool(good.all()),
                f"{self.name}: cells inverted at a quadrature point or the centre",
                f"{int((~good).sum())} of cells {start} to {start + len(nodes) - 1}",
                "positive volume everywhere (see mesh_quality)",
            )

    @property
    def rule(self) -> Rule:
        return ELEMENTS[self.name].rule(self.formulation)

    def relative(self, values: Float, which: Long) -> Float:
        """(m,k,3) of nodal ``values`` (N,3), less those of each element's first node: neither large
        coordinates nor a translation cost digits."""
        nodal = values[self.cells[which]]
        return nodal - nodal[:, :1]


def centre_slope(values: Float, gradient: Float) -> Float:
    """(3,3,m) of nodal values (m,k,3) and the gradients of the nodes, (k,3) or (m,k,3)."""
    return np.asarray(np.matmul(values.swapaxes(1, 2), gradient).transpose(1, 2, 0))


class ForetoldStress:
    """Stresses (or forces) ``values`` (M,…) that the linear part of the last step foretells, of
    the elements where it was asked for (mixed integration points: Magisano, Leonetti & Garcea,
    IJNME 109 (2017) 1237)."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.values, self.valid = np.zeros(shape), np.zeros(shape[0], dtype=bool)

    def put(self, which: Long, values: Float) -> None:
        self.values[which], self.valid[which] = values, True

    def instead_of(self, actual: Float, which: Long) -> Float:
        """The foretold ones of the elements ``which`` that have any, the ``actual`` ones else."""
        valid: Bool = self.valid[which]
        if not valid.any():
            return actual
        return np.where(valid.reshape(-1, *[1] * (actual.ndim - 1)), self.values[which], actual)

    def forget(self) -> None:
        self.valid[:] = False

    def copy(self) -> ForetoldStress:
        other = ForetoldStress(self.values.shape)
        if self.valid.any():
            other.values, other.valid = self.values.copy(), self.valid.copy()
        return other


@dataclass(frozen=True, eq=False)
class Internal:
    """What elements remember beside the displacements: ``modes`` (M,9), ``foretold`` stresses,
    ``state`` of the points (M,Q,n); None where the element has none."""

    modes: Float | None
    foretold: ForetoldStress
    state: Float | None


@dataclass(frozen=True, eq=False)
class PointValues:
    """Results at the Q quadrature points of m elements, order xx yy zz xy yz zx.

    cauchy, piola : (m,Q,6) Cauchy stress in global axes, second Piola-Kirchhoff stress.
    strain : (m,Q,6) Green-Lagrange strain, engineering shear, free strain included.
    volume : (m,Q) volume in the reference configuration.
    """

    cauchy: Float
    piola: Float
    strain: Float
    volume: Float


class ElementResponse(Protocol):
    """Elements of one type and one law: ``name`` of the cell type, ``cells`` (M,k)."""

    name: str
    cells: Int
    block: ElementBlock

    def response(self, which: Long, u: Float, want: Want) -> tuple[Float, Float | None]:
        """Internal forces (m,3k), those left after condensation of internal modes, and the
        symmetric tangent (m,3k,3k) if one is wanted, of the elements ``which`` at displacements
        ``u`` (N,3) of all nodes. Raises NotConverged where elements are turned inside out."""
        ...

    def advance(self, which: Long, u: Float, du: Float, foretell: bool) -> None:
        """The global step ``du`` (N,3) goes on from ``u``, where ``response`` was asked last: moves
        internal modes. ``foretell``: the geometric part of the next tangent takes the stresses
        foretold by the linear part of the step."""
        ...

    def forget_foretold(self) -> None:
        """The next tangents are those of the state."""
        ...

    def snapshot(self) -> Internal:
        """What may have to be set back with a step."""
        ...

    def restore(self, internal: Internal) -> None:
        """As it was at a ``snapshot``."""
        ...

    def commit(self, u: Float) -> None:
        """The step has converged at ``u``, where ``response`` was asked last."""
        ...

    def set_free_strain(self, free_strain: Float | None) -> None:
        """From now on points are free to strain so, see `ElementBlock`."""
        ...

    def strain_extent(self, which: Long, u: Float) -> Float:
        """(m,) largest principal Biot strain, by size, at the points of each element."""
        ...

    def point_values(self, which: Long, u: Float) -> PointValues:
        """Stress and strain at the points."""
        ...


def require_upright(name: str, volume_ratio: Float) -> None:
    """Raises NotConverged where a deformed volume over that at rest, (m,) or (m,Q), isn't a
    positive number."""
    good = (volume_ratio > 0.0) & (volume_ratio < np.inf)
    if not good.all():
        count = int((~good.reshape(len(good), -1).all(axis=1)).sum())
        worst = float(volume_ratio[~good].min())
        raise NotConverged(
            f"{name}: {count} cells are turned inside out by the step; got a volume of {worst:.3g} "
            "times that at rest; expected a positive one"
        )
