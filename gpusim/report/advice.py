"""Advice on settings: what it says in words and numbers, the curves it comes from, and a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpusim._version import __version__
from gpusim.files.atomic_files import PathLike
from gpusim.measure import Advice, RatedSettings
from gpusim.report.html import page_template
from gpusim.report.model import Figure
from gpusim.report.style import MEASURED, MUTED, TRUTH, axis_title, draw_png
from gpusim.report.text import number, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

SHAPE_COLOURS = {"affine": "#009e73", "quadratic": TRUTH}
_NUMBERS = ("gauge_px", "resolution_px", "strain_resolution_px")


def advice_summary(advice: Advice) -> dict[str, Any]:
    """What JSON has of it: settings, why, what they err by as predicted and as measured, and the
    settings that no other beats in noise and resolution of strain."""

    def rated(one: RatedSettings) -> dict[str, Any]:
        parts = {"displacement": one.displacement._asdict(), "strain": one.strain._asdict()}
        return one._asdict() | parts | {name: getattr(one, name) for name in _NUMBERS}

    check, efficiency = advice.check, advice.efficiency
    return {
        "settings": advice.settings,
        "reason": reason(advice),
        "warnings": advice.pattern.warnings,
        "goal": advice.goal,
        "detail_px": advice.motion.period,
        "peak_strain": advice.motion.peak_strain,
        "expected": rated(advice.chosen),
        "measured_again": {
            "displacement": check.displacement._asdict(),
            "strain": check.strain._asdict(),
            "bias_px": check.bias_px,
            "measured": check.measured,
        },
        "efficiency_px2": {"measured": efficiency[0], "theory": efficiency[1]},
        "pattern": vars(advice.pattern),
        "noise_variance": vars(advice.noise),
        "compared": len(advice.table),
        "correlated": len(advice.trials),
        "curve": [rated(one) for one in best_curve(advice)],
    }


def reason(advice: Advice) -> str:
    """Why these settings, in a sentence or two."""
    error, factor, unit = advice.chosen.displacement, 1.0, "px"
    if advice.goal == "strain":
        error, factor, unit = advice.chosen.strain, 1e6, "µm/m"
    total, noise = (f"{number(factor * one, 3)} {unit}" for one in (error.total, error.noise))
    waves, strain = advice.motion.period, percent(advice.motion.peak_strain, 2)
    return (
        f"Of {len(advice.table)} settings these err least on {advice.goal}s in waves of "
        f"{waves:.0f} px and {strain} strain: by {total} RMS, which is {noise} of noise and "
        f"{percent(max(error.loss, 0.0), 2)} lost of the waves. Smaller subsets and windows would "
        "be noisier, larger ones would lose more."
    )


def best_curve(advice: Advice) -> list[RatedSettings]:
    """The settings of which no other has both less noise and finer resolution of strain."""
    best: list[RatedSettings] = []
    for one in sorted(advice.table, key=lambda one: (one.strain_resolution_px, one.strain.noise)):
        if not best or one.strain.noise < best[-1].strain.noise:
            best.append(one)
    return best


def draw_advice(advice: Advice, path: PathLike) -> Figure:
    """Draw noise against resolution of displacements and of strains, and the error by gauge."""

    def draw(canvas: Canvas) -> None:
        left, middle, right = canvas.subplots(1, 3)
        _draw_displacements(left, advice)
        best, chosen = best_curve(advice), advice.chosen
        for axes, x, y in (
            (middle, "strain_resolution_px", "noise"),
            (right, "strain_resolution_px", "total"),
        ):
            for shape, colour in SHAPE_COLOURS.items():
                some = [one for one in advice.table if one.shape == shape]
                values = [(getattr(one, x), 1e6 * getattr(one.strain, y)) for one in some]
                axes.plot(*zip(*values, strict=True), ".", color=colour, markersize=2, alpha=0.5)
            curve = [(getattr(one, x), 1e6 * getattr(one.strain, y)) for one in best]
            axes.plot(*zip(*curve, strict=True), color=MUTED, label="least noise")
            axes.plot(getattr(chosen, x), 1e6 * getattr(chosen.strain, y), "*", color=MEASURED,
                      markersize=13)  # fmt: skip
            axes.set(xscale="log", yscale="log", xlabel="Resolution (px)")
        axis_title(middle, "Noise of strains (µm/m)")
        axis_title(right, f"Error on waves of {advice.motion.period:.0f} px (µm/m)")

    draw_png(path, (11.0, 3.6), draw)
    caption = (
        "Each dot is a setting, the star the one chosen; resolution is the period of which a tenth "
        "is lost. Lines on the left: what a least-squares subset can do at best. In the middle and "
        "on the right: strains, and the settings with least noise for their resolution as a line."
    )
    return Figure(Path(path), "Noise against resolution", caption)


def _draw_displacements(axes: Axes, advice: Advice) -> None:
    from gpusim.measure import gauge_filter

    for shape, colour in SHAPE_COLOURS.items():
        some = {one.matching: one for one in advice.table if one.shape == shape}.values()
        axes.plot([one.resolution_px for one in some], [one.displacement.noise for one in some],
                  ".", color=colour, label=shape)  # fmt: skip
        filters = [gauge_filter(subset, shape) for subset in sorted({one.subset for one in some})]
        axes.plot([f.resolution for f in filters], [advice.pixel_px * f.noise for f in filters],
                  color=colour, linewidth=1)  # fmt: skip
    axes.plot(advice.chosen.resolution_px, advice.chosen.displacement.noise, "*", color=MEASURED,
              markersize=13, label="chosen")  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="Resolution (px)")
    axes.legend()
    axis_title(axes, "Noise of displacements (px)")


def advice_page(report: Mapping[str, Any], figure: Figure) -> str:
    """One self-contained page; ``report``: an `advice_summary` with ``picture`` and ``command``."""
    return page_template("advice.html.j2").render(version=__version__, figure=figure, **report)
