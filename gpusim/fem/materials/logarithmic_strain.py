"""Logarithmic strain H = ln(C) / 2 with its two derivatives, for laws that are written in it.

A law in H gives a stress T = d energy / dH and moduli D = dT / dH as at small strain; the second
Piola-Kirchhoff stress is T : dH/dE, and its derivative (dH/dE) D (dH/dE) + T : d2H/dE2 (Miehe,
Apel & Lambrecht, Comput. Methods Appl. Mech. Engrg. 191 (2002) 5383).

They write the derivatives by eigenvectors and divided differences. Here the logarithm is the
integral of a resolvent,

    ln(1 + X) = integral over t from 0 to 1 of X R(t),    R = (1 + t X)^-1,

whose derivatives are the integrals of R dX R and -t (R dX R dX R) twice; Gauss' rule makes all
three sums (of the logarithm it is Padé's approximant, exact to rounding with 5 nodes at strains of
0.5 %, 7 at 5 %, 17 at stretches of 2), and equal eigenvalues are no special case. As R of symmetric
3x3 tensors without trace is (1 - t X + t^2 cof X) / det(1 + t X), only numbers are summed over the
nodes: how many there are hardly matters.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.materials.cauchy_green import tensor_components
from gpusim.fem.materials.symmetric_tensors import (
    COLUMN,
    ENGINEERING,
    FULL,
    ROW,
    cofactors,
    components_last,
    first_row_product,
    sandwich_product,
    symmetric_sum,
)

_FLATTEST = 1e-3  # eigenvalue of C over the mean of its three
_FAR = 0.5  # below, the exact eigenvalue is worth its arc cosine
_DIGITS = 37.0  # -ln of what is left of the error: 1e-16
_POWERS = np.arange(3)[:, None] + np.arange(5)
"""(3,5) sums of two powers of t."""


class LogarithmicStrain:
    """H at some points, and what is needed to bring stress and moduli back from there.

    ``strain`` is Green-Lagrange's, (…,6) with engineering shear; inside, the P points are one
    axis, the last one as long as numbers are worked on component by component. Raises
    NotConverged where the strain is none of a body, or pressed to less than some thirtieth.

    Examples
    --------
    >>> from gpusim.fem.materials.logarithmic_strain import LogarithmicStrain
    >>> stretched = np.array([[0.5 * (1.5**2 - 1), 0, 0, 0, 0, 0]])
    >>> float(LogarithmicStrain(stretched).components[0, 0] - np.log(1.5)) < 1e-15
    True
    """

    components: Float
    """(6,P) of the tensors H, shear not doubled."""

    def __init__(self, strain: Float) -> None:
        E, self._shape = tensor_components(strain), strain.shape
        mean = 2.0 / 3.0 * E[:3].sum(axis=0)
        # ln C = ln c + ln(1 + X) with c = 1 + mean, so that X has no trace
        self._centre = 1.0 + mean
        X = 2.0 * E / self._centre
        X[:3] -= mean / self._centre
        cof = cofactors(X)
        second, third = cof[:3].sum(axis=0), first_row_product(X, cof)
        t, weight = _gauss_rule(_node_count(second, third))
        powers = t ** np.arange(8)[:, None] * weight
        resolvent = 1.0 / (1.0 + np.outer(t**2, second) + np.outer(t**3, third))
        h = powers[:3] @ resolvent
        self.components = 0.5 * (h[0] * X - h[1] * cof)
        self.components[:3] += 0.5 * (np.log1p(mean) + h[1] * second + h[2] * third)
        squared = resolvent * resolvent
        self._first = powers[:5] @ squared / self._centre
        self._cubed = squared * resolvent
        self._powers = powers[1:]
        self._basis = np.empty((3, *X.shape))
        self._basis[0] = (ROW == COLUMN)[:, None]
        np.negative(X, out=self._basis[1])
        self._basis[2] = cof

    def pulled_back(self, stress: Float, moduli: Float | None) -> tuple[Float, Float | None]:
        """Second Piola-Kirchhoff stress (…,6) and moduli (…,6,6) by E, of a law in H.

        ``stress`` (6,P) components of T; ``moduli`` (6,6) or (P,6,6) dT/dH, plain components as
        of a stiffness; None if not wanted.
        """
        sums = self._two_sided(stress)
        pulled_back = np.einsum("sn,sxn->xn", self._first, sums)
        pulled_back = components_last(pulled_back, self._shape[:-1])
        if moduli is None:
            return pulled_back, None
        half = np.einsum("pqn,qxn->pxn", self._first[_POWERS[:, :3]], self._basis)
        derivative = sandwich_product(half, self._basis)
        second = (self._powers @ self._cubed * (-2.0 / self._centre**2))[_POWERS]
        half = np.einsum("rsn,sxn->rxn", second, sums)
        both = np.concatenate([half, self._basis]), np.concatenate([self._basis, half])
        matrices = sandwich_product(*both)
        doubled = moduli * np.outer(ENGINEERING, ENGINEERING)
        if moduli.ndim == 2:
            left = (derivative.reshape(-1, 6) @ doubled).reshape(-1, 6, 6)
        else:
            left = derivative @ doubled
        matrices += left @ derivative
        return pulled_back, matrices.reshape(*self._shape, 6)

    def _two_sided(self, stress: Float) -> Float:
        """(5,6,P) sums of B_p T B_q over p + q = 0 … 4: of equal powers of t in R T R."""
        basis = self._basis[1:][:, FULL]
        left = np.einsum("pijn,jkn->pikn", basis, stress[FULL])
        both = np.einsum("pijn,qjkn->pqikn", left, basis)
        return np.stack(
            [
                stress,
                symmetric_sum(left[0]),
                both[0, 0][ROW, COLUMN] + symmetric_sum(left[1]),
                symmetric_sum(both[0, 1]),
                both[1, 1][ROW, COLUMN],
            ]
        )


def _node_count(second: Float, third: Float) -> int:
    """Nodes with which Gauss' rule is exact to rounding, from the invariants of X.

    Padé's error falls by ((1 - sqrt y) / (1 + sqrt y))^2 a node, with y the smallest eigenvalue
    of 1 + X, at least 1 - 2 radius; exactly (Smith 1961) where that says too little.
    """
    radius = np.sqrt(np.maximum(-second / 3.0, 0.0))
    flattest = 1.0 - 2.0 * float(radius.max(initial=0.0))
    if flattest < _FAR:
        far = radius > 0.5 * (1.0 - _FAR)
        radius, third = radius[far], third[far]
        angle = np.arccos(np.clip(0.5 * third / radius**3, -1.0, 1.0)) + 2.0 * np.pi
        flattest = min(_FAR, float((1.0 + 2.0 * radius * np.cos(angle / 3.0)).min()))
    if flattest < _FLATTEST:
        raise NotConverged(
            "law: a cell is pressed flat; got a smallest eigenvalue of C down to "
            f"{flattest:.3g} of their mean; expected at least {_FLATTEST:g}"
        )
    root = np.sqrt(min(flattest, 1.0 - 1e-6))
    return int(np.ceil(_DIGITS / np.log((1.0 + root) / (1.0 - root)) / 2.0)) + 1


@cache
def _gauss_rule(count: int) -> tuple[Float, Float]:
    """Nodes and weights on 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1.0), 0.5 * weights
