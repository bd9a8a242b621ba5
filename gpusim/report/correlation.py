"""The summary of a correlation: numbers per image, maps over the picture, and what a page says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.export.field_catalogue import field_maps
from gpusim.files.atomic_files import PathLike
from gpusim.measure import DicResult, Status, StereoResult, StrainResult
from gpusim.report.field_maps import draw_panels
from gpusim.report.model import Figure, Link, Report, Table
from gpusim.report.style import BAD, axis_title
from gpusim.report.text import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLUMNS = {
    "image": "image",
    "time_s": "taken at (s)",
    "measured": "points measured",
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

_CARDS = ("measured", "motion_max", "motion_max_mm", "sigma_median", "sigma_median_mm", "e1_max")
_PICTURE = "Displacements in pixels of the reference image, x right, y down."
_SPACE = (
    "Places and displacements in mm in the frame of the left camera: x right, y down, z forward."
)
DIGITS = 4
MOST_NAMED = 5


def summary(
    image: str, result: DicResult | StereoResult, strain: StrainResult | None, seconds: float
) -> dict[str, Any]:
    """What one image, or pair, gave, in numbers that JSON can hold; None where nothing was
    measured. Lengths in space are in mm, and sigma is that along the worst axis."""
    ok = result.ok
    moved, sigma = result.displacement[ok], result.sigma[ok]
    if isinstance(result, StereoResult):
        axes, unit, quality, sigma = "UVW", "_mm", "residual", sigma.max(axis=1)
    else:
        axes, unit, quality = "uv", "", "zncc"
    values: dict[str, Any] = {
        "image": image,
        "points": len(ok),
        "measured": int(ok.sum()),
        "counts": result.counts(),
    }
    values |= {f"{axis}_mean": _known(np.mean, moved[:, k]) for k, axis in enumerate(axes)}
    values |= {
        f"motion_max{unit}": _known(np.max, np.linalg.norm(moved, axis=1)),
        f"sigma_median{unit}": _known(np.median, sigma),
        f"{quality}_median": _known(np.median, getattr(result, quality)[ok]),
    }
    if strain is not None:
        e1, e2 = strain.principal[strain.ok].T
        # quantiles: a single point at a rough border isn't the strain of the piece
        values |= {
            "e1_max": _known(np.quantile, e1, 0.995),
            "e2_min": _known(np.quantile, e2, 0.005),
            "strain_gauge_px": strain.gauge_px,
        }
    return values | {"seconds": round(seconds, 3)}


def correlation_report(
    rows: Sequence[Mapping[str, Any]],
    settings: Mapping[str, Any],
    warnings: Sequence[str],
    tables: Sequence[Path],
) -> Report:
    """What the page says of all images, whose ``rows`` are as `summary` has them; ``tables``:
    files that it names."""
    names = {key: name for key, name in _COLUMNS.items() if any(key in row for row in rows)}
    cells = [
        [_cell(row.get(key)) for key in names]
        for row in ({**one, "image": Path(one["image"]).name,
                     "measured": f"{one['measured']} of {one['points']}"} for one in rows)
    ]  # fmt: skip
    last = dict(zip(names, cells[-1], strict=True))
    empty = unmeasured(rows)
    facts = {key: f"{value:g}" if isinstance(value, float) else str(value)
             for key, value in settings.items()}  # fmt: skip
    return Report(
        scene=Path(settings["reference"]).name,
        adapter=facts.pop("adapter"),
        version=facts.pop("version"),
        status="failed" if empty else "done",
        failure=f"No point could be measured in {empty}." if empty else "",
        description=_SPACE if "W_mean" in names else _PICTURE,
        warnings=tuple(warnings),
        highlights={names[key]: (last[key], last["image"]) for key in _CARDS if key in names},
        facts=facts,
        tables=(Table("Images", tuple(names.values()), tuple(map(tuple, cells))),),
        links=tuple(Link(path.name, path) for path in tables),
    )


def unmeasured(rows: Sequence[Mapping[str, Any]]) -> str:
    """Images without any point measured, of ``rows`` as `summary` has them: some of them named."""
    names = [row["image"] for row in rows if row["measured"] == 0]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return number(value, DIGITS)
    return "\N{EN DASH}" if value is None else str(value)


def _known(statistic: Callable[..., Any], values: Float, *options: float) -> float | None:
    """A statistic of values; None where there are none."""
    return float(statistic(values, *options)) if values.size else None


_STATUS = {
    Status.OUTSIDE: "#9aa5b1",
    Status.NO_TEXTURE: "#e69f00",
    Status.NOT_CONVERGED: "#cc79a7",
    Status.LOW_CORRELATION: BAD,
    Status.NO_GUESS: "#7a5195",
    Status.MASKED: "#56b4e9",
    Status.SATURATED: "#f0e442",
    Status.EPIPOLAR: "#009e73",
    Status.INCOHERENT: "#8c564b",
}


def draw_maps(
    image: npt.NDArray[Any],
    result: DicResult | StereoResult,
    strain: StrainResult | None,
    path: PathLike,
) -> Figure:
    """Draw displacements, in space with the shape, the strains if any, and what is missing over
    the reference, the left one of a pair."""
    names = ("Z", "U", "V", "W") if isinstance(result, StereoResult) else ("u", "v")
    if strain is None and not isinstance(result, StereoResult):
        names = (*names, "sigma")
    maps = list(field_maps(result, names).values())
    if strain is not None:
        strains = field_maps(strain, ("exx", "eyy", "exy")).items()
        maps += [replace(one, title=f"{name}, {strain.kind}") for name, one in strains]
    columns = 2 if len(maps) < 4 else 3 if len(maps) < 6 else 4
    draw_panels(image, result.points, maps, columns, path, partial(_draw_missing, result))
    counts = ", ".join(f"{number} {_said(name)}" for name, number in result.counts().items())
    caption = f"Over the reference image; {counts}."
    if strain is not None:
        caption += f" Virtual strain gauge {strain.gauge_px:.0f} px."
    return Figure(Path(path), "Measured fields", caption, photo=True)


def _draw_missing(result: DicResult | StereoResult, axes: Axes) -> None:
    for status, colour in _STATUS.items():
        there = result.status == status
        if there.any():
            label = f"{_said(status.name)} ({int(there.sum())})"
            axes.plot(*result.points[there].T, "s", color=colour, markersize=3, label=label)
    if (~result.ok).any():
        axes.legend(loc="upper right", fontsize=7, frameon=True, framealpha=0.85, markerscale=2)
    axis_title(axes, f"not measured: {int((~result.ok).sum())} of {result.ok.size}")


def _said(status: str) -> str:
    return "measured" if status == "OK" else status.lower().replace("_", " ")
