"""The summary of a correlation: numbers per image, and a page with its maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gpusim._version import __version__
from gpusim.measure import DicResult, StereoResult, StrainResult
from gpusim.report.model import Figure
from gpusim.report.pages import page_template
from gpusim.report.text import number

__all__ = ["correlation_page", "stereo_summary", "summary"]

_COLUMNS = {
    "image": "image",
    "measured": "measured",
    "points": "points",
    "u_mean": "mean u (px)",
    "v_mean": "mean v (px)",
    "motion_max": "most motion (px)",
    "sigma_median": "sigma, median (px)",
    "U_mean": "mean U (mm)",
    "V_mean": "mean V (mm)",
    "W_mean": "mean W (mm)",
    "motion_max_mm": "most motion (mm)",
    "sigma_median_mm": "sigma, median (mm)",
    "residual_median": "epipolar residual, median (px)",
    "zncc_median": "correlation, median",
    "e1_max": "most strain",
    "e2_min": "least strain",
    "seconds": "time (s)",
}

_PICTURE = "Displacements in pixels of the reference image, x right, y down."
_SPACE = (
    "Places and displacements in mm in the frame of the left camera: x right, y down, z forward."
)
DIGITS = 4


def summary(
    image: str, result: DicResult, strain: StrainResult | None, seconds: float
) -> dict[str, Any]:
    """What one image gave, in numbers that JSON can hold; None where nothing was measured."""
    ok = result.ok
    u, v = result.displacement[ok].T
    values: dict[str, Any] = {
        "image": image,
        "points": len(ok),
        "measured": int(ok.sum()),
        "counts": result.counts(),
        "u_mean": _mean(u),
        "v_mean": _mean(v),
        "motion_max": float(np.hypot(u, v).max()) if u.size else None,
        "sigma_median": float(np.median(result.sigma[ok])) if u.size else None,
        "zncc_median": float(np.median(result.zncc[ok])) if u.size else None,
    }
    return values | _strains(strain) | {"seconds": round(seconds, 3)}


def stereo_summary(
    image: str, result: StereoResult, strain: StrainResult | None, seconds: float
) -> dict[str, Any]:
    """What one pair gave; lengths in mm, ``sigma_median_mm`` along the worst axis."""
    ok = result.ok
    moved = result.displacement[ok]
    some = bool(ok.any())
    values: dict[str, Any] = {
        "image": image,
        "points": len(ok),
        "measured": int(ok.sum()),
        "counts": result.counts(),
    }
    values |= {f"{name}_mean": _mean(moved[:, k]) for k, name in enumerate("UVW")}
    values |= {
        "motion_max_mm": float(np.linalg.norm(moved, axis=1).max()) if some else None,
        "sigma_median_mm": float(np.median(result.sigma[ok].max(axis=1))) if some else None,
        "residual_median": float(np.median(result.residual[ok])) if some else None,
    }
    return values | _strains(strain) | {"seconds": round(seconds, 3)}


def _strains(strain: StrainResult | None) -> dict[str, Any]:
    if strain is None:
        return {}
    known = strain.ok
    # quantiles: a single point at a rough border isn't the strain of the piece
    return {
        "e1_max": _quantile(strain.principal[known, 0], 0.995),
        "e2_min": _quantile(strain.principal[known, 1], 0.005),
        "strain_gauge_px": strain.gauge_px,
    }


def correlation_page(
    title: str,
    rows: Sequence[Mapping[str, Any]],
    figures: Sequence[tuple[str, Figure]],
    settings: Mapping[str, Any],
    warnings: Sequence[str] = (),
) -> str:
    """One self-contained page of all images; raises InputError if a figure can't be read."""
    keys = [key for key in _COLUMNS if any(key in row for row in rows)]
    count = sum(row["measured"] for row in rows)
    total = sum(row["points"] for row in rows)
    return page_template("correlation.html.j2").render(
        title=title,
        version=__version__,
        lead=f"{len(rows)} image{'s' if len(rows) != 1 else ''}, "
        f"{count} of {total} points measured.",
        names=[_COLUMNS[key] for key in keys],
        rows=[[_cell(row.get(key)) for key in keys] for row in rows],
        figures=figures,
        warnings=warnings,
        footer=_SPACE if any("W_mean" in row for row in rows) else _PICTURE,
        settings=[
            (key, f"{value:g}" if isinstance(value, float) else _cell(value))
            for key, value in settings.items()
        ],
    )


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return number(value, DIGITS) if isinstance(value, float) else str(value)


def _mean(values: Any) -> float | None:
    return float(values.mean()) if values.size else None


def _quantile(values: Any, share: float) -> float | None:
    return float(np.quantile(values, share)) if values.size else None
