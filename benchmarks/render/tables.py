"""Tables and figure of the render benchmark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.render.measure import RenderResult
from gpusim.bench.images import ImagePoint, ImageResult, image_table

__all__ = ["ratios", "write_render"]


def write_render(result: RenderResult, folder: Path) -> list[Path]:
    """``render.md`` and ``render.png`` in ``folder``; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["# Images: run time against error", "", result.machine, ""]
    lines += [
        "Warm seconds of a frame: gpusim until the image lies on the device, peers until it is an",
        "array. Errors in windows around targets: RMS of the grey range, least-squares shift of",
        "32-px blocks, largest mean shift. References: 48 x 48 float64 samples a pixel (unlit),",
        "the converged image of Mitsuba (lit), each window in mm about its middle: Mitsuba's",
        "shadow rays start 9e-5 (1 + the largest coordinate) off the surface, which in m would",
        "move shadows by 0.04 px, and does in its own rows. Its own noise there is 5e-3 per pixel.",
        "",
    ]
    for case in result.cases:
        notes = [f"- {text}" for text in (*ratios(case), *case.failures)]
        lines += [*image_table(case), "", *notes, ""]
    path = folder / "render.md"
    path.write_text("\n".join(lines), encoding="utf-8")
    return [path, _figure(result, folder / "render.png")]


def ratios(case: ImageResult) -> list[str]:
    """What each family of renderers needs for gpusim's error, in words."""
    own = case.own()
    if own is None or not np.isfinite(own.rms):
        return []
    told = []
    for name in dict.fromkeys(p.renderer.split(",")[0] for p in case.points if p is not own):
        mine = [p for p in case.points if p.renderer.split(",")[0] == name]
        equal = [p for p in mine if p.rms <= own.rms]
        if equal:
            best = min(equal, key=lambda p: p.seconds)
            told.append(
                f"{best.renderer} reaches gpusim's image RMS in {best.seconds / own.seconds:.2g} "
                "times its time"
            )
        else:
            best = min(mine, key=lambda p: p.rms)
            told.append(
                f"{name} doesn't reach gpusim's image RMS: {best.rms / own.rms:.2g} times it in "
                f"{best.seconds / own.seconds:.2g} times its time ({best.renderer})"
            )
    return told


def _figure(result: RenderResult, path: Path) -> Path:
    cases = [
        case
        for case in result.cases
        if not case.case.startswith("faces") and any(np.isfinite(p.rms) for p in case.points)
    ]
    scaling = [case for case in result.cases if case.case.startswith("faces")]
    count = len(cases) + bool(scaling)
    columns = min(3, max(1, count))
    rows = -(-max(1, count) // columns)
    figure = Figure(figsize=(4.6 * columns, 3.6 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis, case in zip(axes, cases, strict=False):
        for family, points in _families(case.points).items():
            known = sorted((p for p in points if np.isfinite(p.rms)), key=lambda p: p.seconds)
            if not known:
                continue
            style = {"marker": "o"} if family != "gpusim" else {"marker": "*", "markersize": 14}
            axis.plot([p.seconds for p in known], [p.rms for p in known], label=family, **style)
        axis.set(xscale="log", yscale="log", xlabel="s per frame", ylabel="image RMS",
                 title=f"{case.case}, {case.width} x {case.height}")  # fmt: skip
        axis.grid(True, which="major", alpha=0.3)
        axis.legend(fontsize=8)
    if scaling:
        axis = axes[len(cases)]
        lines: dict[str, list[tuple[int, float]]] = {}
        for case in scaling:
            for p in case.points:
                lines.setdefault(p.renderer, []).append((case.triangles, p.seconds))
        for name, pairs in lines.items():
            x, y = zip(*sorted(pairs), strict=True)
            axis.plot(x, y, marker="*" if name == "gpusim" else "o", label=name)
        axis.set(xscale="log", yscale="log", xlabel="triangles", ylabel="s per frame",
                 title="against the number of faces")  # fmt: skip
        axis.grid(True, which="major", alpha=0.3)
        axis.legend(fontsize=7)
    for axis in axes[count:]:
        axis.set_axis_off()
    figure.savefig(path, dpi=80)
    return path


def _families(points: list[ImagePoint]) -> dict[str, list[ImagePoint]]:
    found: dict[str, list[ImagePoint]] = {}
    for point in points:
        found.setdefault(point.renderer.split(",")[0], []).append(point)
    return found
