"""Plastic bodies that depend on one coordinate, solved for themselves: a tube by its radius, bars
and plates in bending fibre by fibre.

The law is J2 with linear hardening, elastic volume, in logarithmic strain along axes that don't
turn, integrated by the implicit Euler method; nothing here is taken from the package.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_banded
from scipy.optimize import brentq

Float = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Metal:
    """``H``: slope of the yield stress ``Y`` over the plastic strain."""

    E: float
    nu: float
    Y: float
    H: float

    @property
    def shear(self) -> float:
        return self.E / (2.0 * (1.0 + self.nu))

    @property
    def bulk(self) -> float:
        return self.E / (3.0 * (1.0 - 2.0 * self.nu))

    def flow(self, strain: Float, plastic: Float, p: Float) -> tuple[Float, Float, Float]:
        """Principal stresses (P,3), plastic strains (P,3) and their accumulated size (P,) at
        principal strains (P,3), from those at the end of the last step."""
        elastic = strain - plastic
        mean = elastic.sum(axis=1, keepdims=True) / 3.0
        deviator = 2.0 * self.shear * (elastic - mean)
        size = np.sqrt(1.5 * (deviator**2).sum(axis=1))
        over = (size - self.Y - self.H * p) / (3.0 * self.shear + self.H)
        # not by `maximum`: strains may be complex, for derivatives
        over = np.where(over.real > 0.0, over, 0.0)
        direction = 1.5 * deviator / np.where(size.real > 0.0, size, 1.0)[:, None]
        flow = over[:, None] * direction
        stress = deviator - 2.0 * self.shear * flow + 3.0 * self.bulk * mean
        return stress, plastic + flow, p + over


@dataclass
class Tube:
    """Thick-walled, in plane strain, at any displacement: equilibrium d P_r/dR + (P_r - P_t)/R = 0
    of nominal stresses by the midpoint rule on ``cells`` rings of equal thickness."""

    metal: Metal
    inner: float
    outer: float
    cells: int = 400
    u: Float = field(init=False)
    plastic: Float = field(init=False)
    p: Float = field(init=False)

    def __post_init__(self) -> None:
        self.u = np.zeros(self.cells + 1)
        self.plastic, self.p = np.zeros((self.cells, 3)), np.zeros(self.cells)

    @property
    def radii(self) -> Float:
        """(cells + 1,) of the rings' borders, at rest."""
        return np.linspace(self.inner, self.outer, self.cells + 1)

    @property
    def middles(self) -> Float:
        """(cells,) radii of the rings, at rest."""
        return 0.5 * (self.radii[1:] + self.radii[:-1])

    def stretches(self, u: Float) -> Float:
        """(cells,3) radial, tangential, axial."""
        radial = 1.0 + np.diff(u) / np.diff(self.radii)
        tangential = 1.0 + 0.5 * (u[1:] + u[:-1]) / self.middles
        return np.stack([radial, tangential, np.ones_like(radial)], axis=1)

    def cauchy(self) -> Float:
        """(cells,3) Cauchy stress radial, tangential, axial, of the state reached."""
        stretch = self.stretches(self.u)
        stress = self.metal.flow(np.log(stretch), self.plastic, self.p)[0]
        return np.asarray(stress / stretch.prod(axis=1)[:, None])

    def _residual(self, u: Float, pressure: float | None, bore: float) -> Float:
        """(cells + 1,) forces out of balance; at the bore by the pressure on the deformed wall, or
        by what ``bore`` lacks where that is given."""
        stretch = self.stretches(u)
        kirchhoff = self.metal.flow(np.log(stretch), self.plastic, self.p)[0]
        nominal = kirchhoff[:, :2] / stretch[:, :2]
        half = 0.5 * np.diff(self.radii) * (nominal[:, 1] - nominal[:, 0]) / self.middles
        before, after = nominal[:, 0] - half, nominal[:, 0] + half
        result = np.zeros_like(u)
        result[1:-1] = before[1:] - after[:-1]
        result[-1] = -after[-1]
        if pressure is None:
            result[0] = (bore - u[0]) * self.metal.E / self.inner
        else:
            result[0] = before[0] + pressure * (1.0 + u[0] / self.inner)
        self._wall = -before[0] / (1.0 + u[0] / self.inner)
        return result

    def step(self, pressure: float | None = None, bore: float = 0.0) -> float:
        """On to an inner ``pressure``, or to a displacement of the ``bore``; the inner pressure."""
        u = self.u.copy()
        if pressure is None:
            u += (bore - u[0]) * self.inner / self.radii
        residual = self._residual(u, pressure, bore)
        for _ in range(60):
            if np.abs(residual).max() <= 1e-10 * self.metal.Y:
                break
            step, share = self._correction(u, pressure, bore, residual), 1.0
            left = self._residual(u - step, pressure, bore)
            # points that begin to flow, or stop: not all the way where that leads astray
            while not np.linalg.norm(left) < np.linalg.norm(residual) and share > 1e-3:
                share *= 0.5
                left = self._residual(u - share * step, pressure, bore)
            u, residual = u - share * step, left
        else:
            raise AssertionError("the tube's equation isn't solved")
        self.u = u
        _, self.plastic, self.p = self.metal.flow(np.log(self.stretches(u)), self.plastic, self.p)
        return float(self._wall)

    def _correction(self, u: Float, pressure: float | None, bore: float, residual: Float) -> Float:
        """By Newton's method; derivatives by a complex step, of every third unknown at once."""
        bands = np.zeros((3, len(u)))
        for colour in range(3):
            moved = u.astype(complex)
            moved[colour::3] += 1e-30j
            slope = self._residual(moved, pressure, bore).imag / 1e-30
            for column in range(colour, len(u), 3):
                rows = np.arange(max(column - 1, 0), min(column + 2, len(u)))
                bands[1 + rows - column, column] = slope[rows]
        return np.asarray(solve_banded((1, 1), bands, residual))


@dataclass
class Bent:
    """A bar or a plate in pure bending, ``height`` high: fibres at distances z from the middle
    strain by z times the curvature, and carry a stress along; through the height there is none.
    Across, a bar's fibres are free, those of a plate don't strain (``plate``)."""

    metal: Metal
    height: float
    plate: bool
    fibres: int = 200
    curvature: float = 0.0
    plastic: Float = field(init=False)
    p: Float = field(init=False)

    def __post_init__(self) -> None:
        self.plastic, self.p = np.zeros((self.fibres, 3)), np.zeros(self.fibres)

    @property
    def z(self) -> Float:
        """(fibres,) of the upper half; the lower one mirrors it."""
        return 0.5 * self.height * (np.arange(self.fibres) + 0.5) / self.fibres

    @property
    def bending(self) -> float:
        """Moment over curvature of a unit of width while it is elastic."""
        modulus = self.metal.E / (1.0 - self.metal.nu**2) if self.plate else self.metal.E
        return modulus * self.height**3 / 12.0

    def _fibres(self, curvature: float) -> tuple[Float, Float, Float]:
        """Stress along (F,), plastic strains (F,3), their size (F,): along, across, through."""
        strain = np.zeros((self.fibres, 3), dtype=complex)
        strain[:, 0] = curvature * self.z
        free = (2,) if self.plate else (1, 2)
        for _ in range(60):
            stress, plastic, p = self.metal.flow(strain, self.plastic, self.p)
            if np.abs(stress[:, free]).max() <= 1e-11 * self.metal.Y:
                return stress[:, 0].real, plastic.real, p.real
            slope = np.empty((self.fibres, len(free), len(free)))
            for column, axis in enumerate(free):
                moved = strain.copy()
                moved[:, axis] += 1e-30j
                found = self.metal.flow(moved, self.plastic, self.p)[0]
                slope[:, :, column] = found[:, free].imag / 1e-30
            step = np.linalg.solve(slope, stress[:, free].real[..., None])[..., 0]
            strain[:, free] -= step
        raise AssertionError("fibres aren't free")

    def moment(self, curvature: float) -> float:
        """Of a unit of width at a curvature, from the state reached, by the midpoint rule."""
        stress = self._fibres(curvature)[0]
        return float(self.height * (self.z * stress).mean())

    def step(self, moment: float) -> float:
        """On to a moment of a unit of width; the curvature."""
        least = self.curvature + (moment - self.moment(self.curvature)) / self.bending
        # flow adds to the elastic change
        most = least + 20.0 * (least - self.curvature)
        if abs(moment - self.moment(least)) > 1e-10 * self.bending * abs(least):
            least = float(
                brentq(lambda k: self.moment(k) - moment, least, most, xtol=1e-13 * abs(least))
            )
        self.curvature = least
        _, self.plastic, self.p = self._fibres(least)
        return least


def bar_stress(metal: Metal, strains: Sequence[float]) -> Float:
    """Stress (Kirchhoff's) along a bar that goes from one logarithmic strain to the next: elastic
    from where it stopped until it meets the yield stress, then along the closed curve."""
    stress, strain, limit = 0.0, 0.0, metal.Y
    slope = metal.E * metal.H / (metal.E + metal.H)
    result = []
    for wanted in strains:
        way = np.sign(wanted - strain)
        elastic = stress + metal.E * (wanted - strain)
        if way * elastic > limit:
            flowing = wanted - strain - (way * limit - stress) / metal.E
            elastic = way * limit + slope * flowing
            limit = way * elastic
        stress, strain = elastic, wanted
        result.append(stress)
    return np.array(result)
