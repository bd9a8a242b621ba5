"""Tables of the benchmarks, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gpusim.bench.images import ImageResult
from gpusim.bench.solver import CaseResult, machine

__all__ = ["image_table", "solver_table", "write_images", "write_solver"]


def write_solver(cases: Sequence[CaseResult], folder: Path) -> Path:
    """``solver.md`` in ``folder``."""
    lines = [
        "# Solver: run time against displacement error", "", machine(), "",
        "Each run is cold, in a fresh process, wall-clock seconds of everything from the model to "
        "displacements and reactions. Errors are the greatest difference to the reference (gpusim "
        "at tolerance 1e-10) over the greatest displacement.",
    ]  # fmt: skip
    for case in cases:
        lines += ["", f"## {case.case}: {case.unknowns} unknowns", "", *solver_table(case)]
    return _write(lines, folder / "solver.md")


def solver_table(case: CaseResult) -> list[str]:
    """Every run of one case."""
    parts = ", ".join(f"{name} {seconds:.2f}" for name, seconds in case.timings.items())
    lines = [
        f"gpusim: {case.path}; seconds: {parts}.", "",
        "| solver | tolerance | set-up s | solve s | total s | error | to reference | iterations "
        "| peak MB |",
        "|---|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for p in case.points:
        note = f" ({p.note})" if p.note else ""
        lines.append(
            f"| {p.solver}{note} | {p.tolerance:g} | {p.setup_s:.2f} | {p.solve_s:.2f} "
            f"| {p.seconds:.2f} | {_error(p.error)} | {_error(p.difference)} | {p.iterations} "
            f"| {p.peak_kib / 1024:.0f} |"
        )
    return lines + ([""] if case.failures else []) + [f"- {text}" for text in case.failures]


def write_images(cases: Sequence[ImageResult], folder: Path) -> Path:
    """``render.md`` in ``folder``."""
    lines = [
        "# Images: run time against error", "", machine(), "",
        "Warm seconds of a frame until the image lies on the device. Errors in windows around "
        "targets, against 48 x 48 float64 samples a pixel (unlit images): RMS of the grey range, "
        "least-squares shift of 32-px blocks, largest mean shift.", "",
    ]  # fmt: skip
    for case in cases:
        lines += [*image_table(case), ""]
    return _write(lines, folder / "render.md")


def image_table(case: ImageResult) -> list[str]:
    """Every renderer at one case."""
    light = "lit" if case.lit else "unlit"
    lines = [
        f"## {case.case}: {case.width} x {case.height} px, {case.triangles:,} triangles, {light}",
        "", "| renderer | s/frame | ns/px | image RMS | shift RMS px | bias px | time / gpusim |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    own, pixels = case.own(), case.width * case.height
    for p in case.points:
        ratio = f"{p.seconds / own.seconds:.1f}" if own else ""
        lines.append(
            f"| {p.renderer} | {p.seconds:.3f} | {1e9 * p.seconds / pixels:.0f} | {_error(p.rms)} "
            f"| {_error(p.shift_rms)} | {_error(p.bias)} | {ratio} |"
        )
    return lines


def _error(value: float) -> str:
    return f"{value:.1e}" if np.isfinite(value) else "-"


def _write(lines: Sequence[str], path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
