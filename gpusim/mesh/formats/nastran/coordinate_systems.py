"""Nastran's coordinate systems, and nodes that are given in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.mesh.formats.coordinate_systems import Frame, from_cylindrical, from_spherical
from gpusim.mesh.formats.nastran.cards import BdfCard
from gpusim.mesh.formats.nastran.values import integer, real

__all__ = ["Systems"]

Float = npt.NDArray[np.float64]

_LONGEST_CHAIN = 100


@dataclass(frozen=True, eq=False)
class _System:
    """``kind`` R, C or S; three points in the system ``reference``, or at three grid points."""

    card: BdfCard
    kind: str
    reference: int
    points: Float | None
    grids: tuple[int, ...] = ()


class Systems:
    """CORD1R, CORD1C, CORD1S, CORD2R, CORD2C and CORD2S; 0 is the basic system.

    ``grids`` maps a grid point to its system and its coordinates there.
    """

    def __init__(self) -> None:
        self.known: dict[int, _System] = {}
        self.grids: Mapping[int, tuple[int, Float]] = {}
        self._frames: dict[int, Frame] = {}

    def read(self, card: BdfCard) -> None:
        """One card; CORD1 may define two systems. Raises InputError."""
        kind = card.name[5]
        if card.name[4] == "1":
            for start in (0, 4):
                if card.field(start):
                    numbers = [integer(card.field(start + k), card) for k in range(4)]
                    one = _System(card, kind, 0, None, tuple(numbers[1:]))
                    self._add(numbers[0], one)
            return
        points = np.array([real(card.field(k), card) for k in range(2, 11)]).reshape(3, 3)
        reference = integer(card.field(1) or "0", card)
        self._add(integer(card.field(0), card), _System(card, kind, reference, points))

    def _add(self, number: int, system: _System) -> None:
        if number in self.known or number == 0:
            system.card.fail(f"a second coordinate system {number}; expected numbers of their own")
        self.known[number] = system

    def place(
        self, number: int, points: Float, card: BdfCard, chain: tuple[int, ...] = ()
    ) -> Float:
        """Basic coordinates (N,3) of points (N,3) in a system, for ``card``. Raises InputError."""
        if number == 0:
            return points
        if number not in self.known:
            card.fail(f"in coordinate system {number}; expected 0 or one that a CORD card defines")
        if number in chain or len(chain) > _LONGEST_CHAIN:
            card.fail(
                f"coordinate system {number} is defined by itself; expected a chain that ends"
            )
        system = self.known[number]
        if system.kind == "C":
            points = from_cylindrical(points)
        elif system.kind == "S":
            points = from_spherical(points)
        if number not in self._frames:
            self._frames[number] = self._frame(system, (*chain, number))
        return self._frames[number].place(points)

    def _frame(self, system: _System, chain: tuple[int, ...]) -> Frame:
        if system.points is not None:
            corners = self.place(system.reference, system.points, system.card, chain)
        else:
            rows = []
            for grid in system.grids:
                if grid not in self.grids:
                    system.card.fail(f"names node {grid}, which isn't there")
                number, point = self.grids[grid]
                rows.append(self.place(number, point[None], system.card, chain)[0])
            corners = np.array(rows)
        return Frame.from_z(corners[0], corners[1], corners[2], system.card.where)
