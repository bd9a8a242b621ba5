"""What may hide a lamp from the receivers of each surface, as the lamp sees it.

A surface that hides nothing of itself (`gpusim.optics.lamp_layer`) needn't be looked at for its own
receivers: what lies beside them on a bent sheet would be in doubt there, everywhere.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters, LampFaces
from gpusim.optics.emitters import Lamp
from gpusim.optics.lamp_grid import LampGrid
from gpusim.optics.lamp_sheets import Sheets
from gpusim.optics.lamp_view import LampView
from gpusim.optics.receivers import Receivers

__all__ = ["CasterSet", "CasterSets"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

CasterSet = tuple[LampFaces, list[LampGrid]]
MANY = 12
"""Entries of cells that receivers would look at, for each one there is, which are worth a look at
sheets."""


class CasterSets:
    """The faces of ``casters`` that may hide a ``lamp``, for each half space before it: all of
    them, and those of other surfaces for receivers that are ``free`` (T,), which nothing of their
    own hides. Filed once for all that look for shadows of a lamp. ``among`` (F,): None but these
    casters, and for receivers on surfaces ``whole`` all of their own."""

    def __init__(
        self,
        receivers: Receivers,
        lamp: Lamp,
        casters: Casters,
        free: Flags,
        among: Flags | None = None,
        whole: Collection[int] = (),
    ) -> None:
        self.lamp, self.casters = lamp, casters
        self._among = np.ones(len(casters.body), bool) if among is None else among
        body, self._face = receivers.view.body, receivers.view.face
        own = np.isin(body, list(whole)) if whole else np.zeros(len(body), bool)
        self._whole = frozenset(whole)
        self.apart = free | own
        """(T,): receivers that don't look at the same casters as most."""
        self._alone, number = np.unique(body[self.apart], return_inverse=True)
        self._sets: list[CasterSet | None] = [None] * (1 + len(self._alone))
        # (T,): the set for receivers on each triangle
        self._number = np.zeros(len(body), np.int64)
        self._number[self.apart] = 1 + number
        self._sheets: dict[LampGrid, Sheets] = {}
        self._faces = casters.seen_by(lamp, receivers.shown)
        self._views: list[tuple[LampView, float]] = []
        faces = np.moveaxis(casters.corners[self._faces.face], 2, 0)
        for view in () if self.empty else LampView.of(lamp, faces):
            s = view.place(*receivers.shown)[2]
            s = s[np.isfinite(s)]
            self._views.append((view, float(s.min(initial=np.inf))))

    @property
    def empty(self) -> bool:
        """Whether nothing hides the lamp from anything."""
        return not len(self._faces.face)

    def _set(self, number: int) -> CasterSet:
        found = self._sets[number]
        if found is None:
            kept = self._among
            if number:
                body = self._alone[number - 1]
                own = self.casters.body == body
                kept = kept | own if body in self._whole else kept & ~own
            faces = self._faces if kept.all() else self._faces[kept[self._faces.face]]
            grids = [LampGrid(view, self.casters, faces, low) for view, low in self._views]
            self._sets[number] = found = faces, grids
        return found

    def number(self, triangle: Numbers, apart: Flags | None = None) -> Numbers:
        """(n,) which set there is for receivers on triangles (n,); on several, of which it is one:
        all of these are ``apart`` (n,), or some look at all casters."""
        number = self._number[triangle]
        return number if apart is None else np.where(apart, number, 0)

    def each(self, number: Numbers) -> Iterator[tuple[Numbers | None, CasterSet]]:
        """Rows of receivers of which each has such a set (n,), None for all, with what may hide the
        lamp there."""
        if len(self._sets) == 1 or not len(number):
            yield None, self._set(0)
            return
        for own in np.flatnonzero(np.bincount(number, minlength=1)):
            rows = np.flatnonzero(number == own)
            yield (None if len(rows) == len(number) else rows), self._set(int(own))

    def may_hide(self, points: Array, number: Numbers) -> Flags:
        """(n,) whether something of such sets may lie between the lamp and points (k, 3, n)."""
        result = np.zeros(points.shape[2], bool)
        for rows, (_, grids) in self.each(number):
            own = points if rows is None else np.take(points, rows, axis=2)
            found = np.zeros(own.shape[2], bool)
            for grid in grids:
                found |= grid.may_hide(grid.view.reach(own))
            result[slice(None) if rows is None else rows] = found
        return result

    def plain(self, points: Array, triangle: Numbers) -> tuple[Flags, Flags]:
        """(n,) whether all of the lamp is hidden from all of the points (4, 3, n) of triangles, and
        whether nothing of it; where many casters may be before them. Never wrong."""
        number = self.number(triangle)
        dark, lit = np.zeros((2, points.shape[2]), bool)
        for rows, (_, grids) in self.each(number):
            if rows is None:
                rows = np.arange(points.shape[2])
            own = np.take(points, rows, axis=2)
            own_lit = np.ones(len(rows), bool)
            for grid in grids:
                reach = grid.view.reach(own)
                if grid.asked(reach) > MANY * len(grid.entry):
                    if grid not in self._sheets:
                        self._sheets[grid] = Sheets(grid, self.casters)
                    sheets = self._sheets[grid]
                    dark[rows] |= sheets.hides(reach)
                    own_lit &= sheets.shows(reach, self._face[triangle[rows]])
                else:
                    own_lit &= np.isneginf(reach.s[0]) if grid.count else True
            lit[rows] = own_lit
        return dark, lit
