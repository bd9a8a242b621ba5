"""How elements answer to a motion: internal forces, tangents, and what they remember of it.

Elements of one type and one law answer by chunks of at most some 500, and disjoint chunks may be
asked from several threads. What they remember (internal modes, foretold stresses, states of the
points) is part of a load step and is set back with it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.errors import NotConverged
from gpusim.fem.elements.element import ELEMENTS, Rule
from gpusim.fem.elements.finite_strain import largest_principal_strain
from gpusim.fem.elements.isoparametric_map import (
    determinant,
    inverse,
    reference_gradient,
    require_positive,
)
from gpusim.fem.materials.law import Law


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
    numbers : (M,) of the mesh's cells; None where they are no mesh's.

    Raises InputError for cells inverted at a quadrature point.
    """

    name: str
    formulation: str
    points: Float
    cells: Int
    law: Law
    numbers: Long | None = None

    def __post_init__(self) -> None:
        nodes = self.points[self.cells]
        jacobian = reference_gradient(nodes - nodes[:, :1], self.rule)
        require_positive(self.name, determinant(jacobian))

    @property
    def rule(self) -> Rule:
        return ELEMENTS[self.name].rule(self.formulation)

    def relative(self, values: Float, which: Long) -> Float:
        """(m,k,3) of nodal ``values`` (N,3), less those of each element's first node: neither large
        coordinates nor a translation cost digits."""
        nodal = values[self.cells[which]]
        return nodal - nodal[:, :1]

    def centre(self, which: Long) -> tuple[Float, Float, Float]:
        """At the centre: gradients (m,k,3) of the nodes, dxi_J/dX_I (3,3,m), and the determinant
        of its inverse (m,)."""
        shapes = ELEMENTS[self.name].centre_gradient
        jacobian = nodal_slope(self.relative(self.points, which), shapes)
        det = determinant(jacobian)
        back = inverse(jacobian, det)
        return np.matmul(shapes, back.transpose(2, 0, 1)), back, det


def nodal_slope(values: Float, gradient: Float) -> Float:
    """(3,3,m) of nodal values (m,k,3) and the gradients of the nodes, (k,3) or (m,k,3)."""
    return np.asarray(np.matmul(values.swapaxes(1, 2), gradient).transpose(1, 2, 0))


@dataclass(frozen=True, eq=False)
class Internal:
    """What elements remember beside the displacements: ``modes`` (M,9), ``foretold`` stresses or
    forces (M,…), NaN where none are, ``state`` of the points (M,Q,n); None where there is none."""

    modes: Float | None
    foretold: Float
    state: Float | None


@dataclass(frozen=True, eq=False)
class PointValues:
    """Results at the Q quadrature points of m elements, order xx yy zz xy yz zx.

    cauchy, piola : (m,Q,6) Cauchy stress in global axes, second Piola-Kirchhoff stress.
    strain : (m,Q,6) Green-Lagrange strain, engineering shear, free strain included.
    volume : (m,Q) volume in the reference configuration.
    results : (m,Q,…) what the law tells by name; "energy" is what is stored per such volume, NaN
        where the law doesn't say it.
    """

    cauchy: Float
    piola: Float
    strain: Float
    volume: Float
    results: Mapping[str, Float]


class ElementResponse(ABC):
    """Elements of one type and one law: ``name`` of the cell type, ``cells`` (M,k).

    ``free_strain`` may be set: (M,Q,6) strain that causes no stress, engineering shear, along
    global axes at rest, so that it turns with the material; None: none. At finite strain it is the
    stretch of a free body, less one.

    ``foretold`` and ``state`` are the shapes of what is kept: stresses or forces that the linear
    part of a step foretells (mixed integration points: Magisano, Leonetti & Garcea, IJNME 109
    (2017) 1237), and the law's states.
    """

    def __init__(
        self, block: ElementBlock, foretold: tuple[int, ...], state: tuple[int, ...] | None
    ) -> None:
        self.block, self.name, self.cells = block, block.name, block.cells
        self.free_strain: Float | None = None
        self._foretold = np.full(foretold, np.nan)
        self._begin(None if state is None else np.zeros(state))

    @abstractmethod
    def response(self, which: Long, u: Float, want: Want) -> tuple[Float, Float | None]:
        """Internal forces (m,3k), those left after condensation of internal modes, and the
        symmetric tangent (m,3k,3k) if one is wanted, of the elements ``which`` at displacements
        ``u`` (N,3) of all nodes. Raises NotConverged where elements are turned inside out."""

    @abstractmethod
    def advance(self, which: Long, u: Float, du: Float, foretell: bool) -> None:
        """The global step ``du`` (N,3) goes on from ``u``, where ``response`` was asked last: moves
        internal modes. ``foretell``: the geometric part of the next tangent takes the stresses
        foretold by the linear part of the step; laws with a history foretell nothing."""

    def work_of_modes(self, du: Float) -> float:
        """Of the internal forces along the last step, ``du`` (N,3) or a share of it, what those at
        the nodes leave out: the forces on internal modes, which condensation has moved there."""
        return 0.0

    def shorten(self, share: float) -> None:  # noqa: B027  most have no internal modes
        """Of the last step only this share is made: internal modes go back."""

    @abstractmethod
    def point_values(self, which: Long, u: Float) -> PointValues:
        """Stress and strain at the points, of the committed state."""

    def strain_extent(self, which: Long, u: Float) -> Float:
        """(m,) largest principal Biot strain, by size, at the points of each element."""
        return largest_principal_strain(self.point_values(which, u).strain)

    def forget_foretold(self) -> None:
        """The next tangents are those of the state."""
        self._foretold.fill(np.nan)

    def snapshot(self) -> Internal:
        """What may have to be set back with a step."""
        # states aren't written to: a commit puts others in their place
        return Internal(None, self._foretold.copy(), self._state)

    def restore(self, internal: Internal) -> None:
        """As it was at a ``snapshot``."""
        self._foretold = internal.foretold.copy()
        self._begin(internal.state)

    def commit(self, u: Float) -> None:
        """The step has converged at ``u``, where ``response`` was asked last."""
        self._begin(self._trial)

    def _begin(self, state: Float | None) -> None:
        """A step, from a state of the points."""
        self._state, self._trial = state, None if state is None else state.copy()

    def _or_foretold(self, actual: Float, which: Long) -> Float:
        """What is foretold of the elements ``which``, the ``actual`` where nothing is."""
        foretold = self._foretold[which]
        return np.where(np.isnan(foretold), actual, foretold)


def require_upright(name: str, volume_ratio: Float) -> None:
    """Raises NotConverged where a deformed volume over that at rest, (m,) or (m,Q), isn't a
    positive number."""
    good = (volume_ratio > 0.0) & (volume_ratio < np.inf)
    if not good.all():
        count = int((~good.reshape(len(good), -1).all(axis=1)).sum())
        raise NotConverged(
            f"{name}: {count} cells are turned inside out by the step; got a volume of "
            f"{volume_ratio[~good].min():.3g} times that at rest; expected a positive one"
        )
