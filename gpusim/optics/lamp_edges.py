"""Edges of casters in a lamp's view, and which of them receivers have to look at.

Along a ray from X through the lamp's point l, p = p_X + l (s - s_X), so that the ray passes an edge
from D (relative to X) along w on the side that (D x w) . (l, 1) has. This is linear in X and in l
by themselves: its least over a box of receivers and the lamp's face is known in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import parts
from gpusim.optics.lamp_view import LampView, Reach

__all__ = ["EVERY_EDGE", "LampEdges"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
EVERY_EDGE = 0b1111


@dataclass(frozen=True, eq=False)
class LampEdges:
    """``corners`` (n, 4) each: p, q and s of those of n casters' outlines, NaN behind the lamp;
    ``turn`` (n,): the sign by which what edges enclose is on their positive side; ``known`` (n,):
    false where that isn't sure.

    ``half``: half the lamp's size.
    """

    corners: tuple[Array, Array, Array]
    turn: Array
    known: npt.NDArray[np.bool_]
    half: tuple[float, float]

    @staticmethod
    def of(
        view: LampView,
        corners: tuple[Array, Array, Array],
        side: Numbers,
        both_sides: npt.NDArray[np.bool_],
    ) -> LampEdges:
        """Of casters whose p, q, s are ``corners`` (n, 4) each; ``side`` (n,): see `LampFaces`.

        Closed bodies hide the lamp from what is before their faces, open ones from what their face
        parts from all of the lamp: which way round it sees their outline follows from that.
        """
        # what is behind the lamp is NaN, all of p, q and s
        known = np.isfinite(corners[2]).all(axis=1) & ~(both_sides & (side == 0))
        turn = np.sign(np.cross(view.across, view.along) @ view.axis)
        return LampEdges(corners, np.where(side == 1, -turn, turn), known, view.half)

    @np.errstate(invalid="ignore")
    def needed(self, reach: Reach, box: Numbers, caster: Numbers) -> npt.NDArray[np.uint8]:
        """(n,) a bit for each edge of the casters (n,) on whose outer side some ray from the boxes
        ``box`` (n,) of ``reach`` may pass to the lamp; one at least."""
        result = np.empty(len(caster), np.uint8)
        boxes = np.stack([
            values for low, high in (reach.p, reach.q, reach.s)
            for values in (0.5 * (low + high), 0.5 * (high - low))
        ])  # fmt: skip
        for part in parts(len(caster)):
            result[part] = self._needed(np.take(boxes, box[part], axis=1), caster[part])
        result[~self.known[caster]] = EVERY_EDGE
        return np.maximum(result, 1)

    def _needed(self, boxes: Array, caster: Numbers) -> npt.NDArray[np.uint8]:
        """As `needed`, pair by pair; ``boxes`` (6, n): middle and half the size in p, q and s."""
        p, ep, q, eq, s, es = boxes
        corners = [np.take(values, caster, axis=0).T for values in self.corners]
        turn = self.turn[caster]
        half_p, half_q = self.half
        result = np.zeros(len(caster), np.uint8)
        for k in range(4):
            at = [values[k] for values in corners]
            wp, wq, ws = (turn * (v[(k + 1) % 4] - own) for v, own in zip(corners, at, strict=True))
            dp, dq, ds = at[0] - p, at[1] - q, at[2] - s
            sp, sq, ss = np.abs(wp), np.abs(wq), np.abs(ws)
            across = np.abs(dq * ws - ds * wq) + eq * ss + es * sq
            along = np.abs(ds * wp - dp * ws) + ep * ss + es * sp
            least = dp * wq - dq * wp - ep * sq - eq * sp - half_p * across - half_q * along
            # NaN for boxes that reach behind the lamp
            result |= np.asarray(~(least >= 0.0)).view(np.uint8) << np.uint8(k)
        return result
