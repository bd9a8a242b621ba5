"""Advice on settings: what it says in words and numbers, the curves it comes from, and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.export.images import Picture, write_image
from gpusim.files.atomic_files import PathLike
from gpusim.measure import Advice, gauge_filter
from gpusim.measure.advice.settings_advice import RatedSettings
from gpusim.report.html import page_template
from gpusim.report.model import Figure
from gpusim.report.style import MEASURED, MUTED, TRUTH, axis_title, drawn
from gpusim.report.text import number, percent, plain_data

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

SHAPE_COLOURS = {"affine": "#009e73", "quadratic": TRUTH}
CAPTION = (
    "Each dot is a setting, the star the one chosen; resolution is the period of which a tenth "
    "is lost. Lines: on the left what a least-squares subset can do at best, in the middle the "
    "settings that no other beats."
)
TICKS = (10, 20, 50, 100, 200, 500, 1000, 2000)


def advice_summary(advice: Advice) -> dict[str, Any]:
    """What JSON has of it: all but the settings that others beat in noise and in resolution."""
    told = plain_data(vars(advice) | {"table": best_curve(advice), "trials": len(advice.trials)})
    ideal = advice.pixel_px * advice.chosen.filters[0].noise
    words = {"settings": advice.settings, "reason": reason(advice), "ideal_noise_px": ideal}
    moved, strained = (one.resolution for one in advice.chosen.filters)
    words |= {"resolution_px": moved, "strain_resolution_px": strained}
    return {**words, "warnings": advice.pattern.warnings, "compared": len(advice.table), **told}


def reason(advice: Advice) -> str:
    """Why these settings, in a sentence or two."""
    error, waves = advice.chosen.strain, advice.motion
    total, noise = (f"{number(1e6 * one, 3)} µm/m" for one in (error.total, error.noise))
    return (
        f"Of {len(advice.table)} settings these err least on strains in waves of "
        f"{waves.period:.0f} px and {percent(waves.peak_strain, 2)}: by {total} RMS, which is "
        f"{noise} of noise and {percent(max(error.loss, 0.0), 2)} lost of the waves. Smaller ones "
        "would be noisier, larger ones would lose more."
    )


def best_curve(advice: Advice) -> list[RatedSettings]:
    """The settings of which no other has both less noise and finer resolution of strain."""
    best: list[RatedSettings] = []
    for one in sorted(advice.table, key=lambda one: (one.filters[1].resolution, one.strain.noise)):
        if not best or one.strain.noise < best[-1].strain.noise:
            best.append(one)
    return best


def draw_advice(advice: Advice, path: PathLike) -> Figure:
    """Draw noise against resolution of displacements and of strains, and the error on the waves."""
    write_image(path, advice_curves(advice))
    return Figure(Path(path), "Noise against resolution", CAPTION)


def advice_curves(advice: Advice) -> Picture:
    """The same as a picture."""

    def draw(canvas: Canvas) -> None:
        left, middle, right = canvas.subplots(1, 3)
        for shape, colour in SHAPE_COLOURS.items():
            some = [one for one in advice.table if one.shape == shape]
            filters = [gauge_filter(subset, shape) for subset in sorted({s.subset for s in some})]
            ideal = [(one.resolution, advice.pixel_px * one.noise) for one in filters]
            left.plot(*np.transpose(ideal), color=colour, linewidth=1)
            for axes, values in zip((left, middle, right), _places(some), strict=True):
                axes.plot(*values, ".", color=colour, markersize=3, alpha=0.5, label=shape)
        middle.plot(*_places(best_curve(advice))[1], color=MUTED)
        waves = f"Error on waves of {advice.motion.period:.0f} px (µm/m)"
        titles = "Noise of displacements (px)", "Noise of strains (µm/m)", waves
        places = _places([advice.chosen])
        for axes, place, title in zip((left, middle, right), places, titles, strict=True):
            axes.plot(*place, "*", color=MEASURED, markersize=13, label="chosen")
            axes.set(xscale="log", yscale="log", xlabel="Resolution (px)")
            low, high = axes.get_xlim()
            axes.set_xticks([tick for tick in TICKS if low < tick < high], minor=False)
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter("")
            axis_title(axes, title)
        left.legend()

    return drawn((11.0, 3.6), draw)


def _places(rated: Sequence[RatedSettings]) -> list[Float]:
    """Of settings in each of the three plots: x and y (2, N)."""
    filters = [one.filters for one in rated]
    moved = [f.resolution for f, _ in filters], [one.displacement.noise for one in rated]
    strain = [
        [f.resolution for _, f in filters],
        [1e6 * one.strain.noise for one in rated],
        [1e6 * one.strain.total for one in rated],
    ]
    return [np.array(moved), np.array(strain[:2]), np.array(strain[::2])]


def advice_page(report: Mapping[str, Any], figure: Figure) -> str:
    """One self-contained page of what report.json holds."""
    return page_template("advice.html.j2").render(figure=figure, **report)
