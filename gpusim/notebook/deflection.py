"""A deflection line: measured, with its uncertainties, and true."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.measure import DeflectionLine
from gpusim.notebook.axes import flat_axes
from gpusim.report.style import MEASURED, TRUTH
from gpusim.validation import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot(line: DeflectionLine, ax: Axes | None, *, true: Any = None, **style: Any) -> Axes:
    """Deflection along a member, with uncertainties; ``true`` (M,) or (positions, values) in mm."""
    ax = flat_axes(ax)
    if true is not None:
        x, y = true if isinstance(true, tuple) else (line.position_mm, true)
        fits, got = np.shape(x) == np.shape(y), f"shapes {np.shape(x)} and {np.shape(y)}"
        expected = f"({len(line.position_mm)},), or positions and values of one length"
        require(fits and np.ndim(y) == 1, "DeflectionLine.plot: true", got, expected)
        ax.plot(x, y, color=TRUTH, linewidth=2.0, label="true")
    own = {"fmt": "o", "color": MEASURED, "mfc": "none", "capsize": 2.5, "label": "measured"}
    ax.errorbar(line.position_mm, line.displacement_mm[:, 1], line.sigma_mm, **{**own, **style})
    ax.set(xlabel="position along the member (mm)", ylabel="deflection (mm)")
    ax.legend(loc="best")
    return ax
