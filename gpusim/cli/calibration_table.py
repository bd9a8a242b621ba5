"""A calibrated rig as a table: a row for each parameter, a column for each camera."""

from __future__ import annotations

import math

import numpy as np

from gpusim import measure
from gpusim.report import Table

__all__ = ["rig_table", "stated"]

UNITS = {"fx": "px", "fy": "px", "cx": "px", "cy": "px"}
COEFFICIENTS = tuple("k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y".split())


def stated(value: float, sigma: float, unit: str = "") -> str:
    """``value ± sigma unit`` with two figures of the uncertainty, and the value to its last."""
    if not (math.isfinite(sigma) and sigma > 0):
        return f"{value:.7g} {unit}".rstrip()
    places = min(max(1 - math.floor(math.log10(sigma)), 0), 12)
    return f"{value:.{places}f} ± {sigma:.{places}f} {unit}".rstrip()


def rig_table(found: measure.Calibration) -> Table:
    """Focal lengths, centre, lens and place of every camera, with standard uncertainties.

    Parameters that the lens model holds at zero have no row.
    """
    rows: dict[str, list[str]] = {}
    for k, own in enumerate(found.cameras):
        values = dict(fx=own.K[0, 0], fy=own.K[1, 1], cx=own.K[0, 2], cy=own.K[1, 2])
        values |= dict(zip(COEFFICIENTS, own.distortion, strict=True))
        for name, value in values.items():
            sigma = own.sigma.get(name, own.sigma.get("f") if name in ("fx", "fy") else None)
            if sigma is not None:
                cells = rows.setdefault(name, [""] * len(found.cameras))
                cells[k] = stated(value, sigma, UNITS.get(name, ""))
        if k:
            length, angle = found.baseline(k), np.degrees(found.angle(k))
            for name, cell in (
                ("distance to the first", stated(length[0], length[1], "mm")),
                ("angle to the first", stated(float(angle[0]), float(angle[1]), "deg")),
            ):
                rows.setdefault(name, [""] * len(found.cameras))[k] = cell
    return Table(
        "Cameras",
        ("parameter", *(own.name for own in found.cameras)),
        tuple((name, *cells) for name, cells in rows.items()),
    )
