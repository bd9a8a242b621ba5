"""Points in space on a flat panel: parallel projection from beside and above, in a named box."""

from __future__ import annotations

import numpy as np

from gpusim.report.panel import Floats, Panel
from gpusim.report.style import GRID

__all__ = ["flat", "space_panel"]

_TURN, _RISE = np.radians(-60.0), np.radians(25.0)
_RIGHT = np.array([-np.sin(_TURN), np.cos(_TURN), 0.0])
_UP = np.array([-np.sin(_RISE) * np.cos(_TURN), -np.sin(_RISE) * np.sin(_TURN), np.cos(_RISE)])
_TO_EYE = np.cross(_RIGHT, _UP)
_ROOM = 0.22  # of the box's width, on both sides, for words


def flat(points: Floats) -> tuple[Floats, Floats]:
    """Where points (…, 3) are on the panel: to the right and up, each (…)."""
    return points @ _RIGHT, points @ _UP


def space_panel(points: Floats, unit: str, title: str = "") -> Panel:
    """A panel for `flat` places, with the box around ``points`` (N, 3) and how far it reaches."""
    panel = Panel(title, equal=True, bare=True)
    fine = points[np.isfinite(points).all(axis=1)]
    low, high = fine.min(axis=0), fine.max(axis=0)
    ends = np.stack([low, high])
    bits = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
    corners = np.take_along_axis(ends, bits, axis=0)
    edges = [(a, a | 1 << axis) for a in range(8) for axis in range(3) if not a >> axis & 1]
    x, y = flat(corners[np.array(edges)])
    panel.segments(x, y, GRID, 1.2)
    room = _ROOM * float(np.ptp(x))
    panel.x_range = float(x.min()) - room, float(x.max()) + room
    middle = flat(corners.mean(axis=0))
    front = int(np.argmax(corners @ _TO_EYE - 1e9 * bits[:, 2]))
    upright = int(np.argmin(flat(corners)[0] + 1e9 * bits[:, 2]))
    for axis, corner in enumerate((front, front, upright)):
        at = flat(corners[[corner, corner ^ 1 << axis]].mean(axis=0))
        text = f"{'xyz'[axis]} {low[axis]:.0f} … {high[axis]:.0f} {unit}".replace("-", "\u2212")
        panel.note(float(at[0]), float(at[1]), text, right=bool(at[0] < middle[0]), ahead=8.0)
    return panel
