"""Markdown, JSON and the figure of the solver benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.plain_json import plain_json
from benchmarks.solver.measure import ENOUGH, PeerCaseResult, SolverResult
from gpusim.bench.solver import Point, solver_table

__all__ = ["solver_markdown", "write_solver"]

# gpusim first; enough different ones for every peer
_SERIES = ("black", *(f"C{k}" for k in range(10)), "gold", "lime", "navy", "teal", "salmon")


def write_solver(result: SolverResult, folder: Path) -> list[Path]:
    """``solver.md``, ``solver.json``, ``solver.png`` in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"solver.{end}" for end in ("md", "json", "png")]
    paths[0].write_text(solver_markdown(result), encoding="utf-8")
    paths[1].write_text(plain_json(asdict(result)), encoding="utf-8")
    _draw_solver(result, paths[2])
    return paths


def solver_markdown(result: SolverResult) -> str:
    """The whole report."""
    lines = [
        "# Solver: run time against displacement error", "",
        f"Written by `python -m benchmarks.solver`. {result.machine}.", "",
        "Each run is cold, in a fresh process, wall-clock seconds. gpusim's time holds everything "
        "from the model to displacements and reactions: checks, assembly, set-up, compiling "
        "kernels, iterations. Peers are given the assembled matrix; their assembly isn't counted "
        "(CalculiX: the whole run, from the deck to the printed displacements). Errors are the "
        "greatest difference to the reference (gpusim at tolerance 1e-10) over the greatest "
        "displacement; for peers on beams, to the exact solution (80-bit residuals) of the matrix "
        "that they were given, whose rounding to float64 moves a slender body: the column "
        "\"to reference\" shows that. \"Best peer\" is the fastest run "
        f"with an error of at most {ENOUGH:g}; gpusim is taken at its default tolerance. \"Second "
        "load case\" is what it adds to the time of the first: least of several alternating runs "
        "of both.", "",
        *_summary(result.cases), "",
    ]  # fmt: skip
    for family, exponent in result.exponents().items():
        lines.append(f"Time of `{family}` grows as N^{exponent:.2f}.")
    lines += ["", *_bandwidth(result.cases)]
    for case in result.cases:
        lines += ["", f"## {case.case}: {case.unknowns} unknowns", "", *solver_table(case)]
    return "\n".join(lines) + "\n"


def _summary(cases: Sequence[PeerCaseResult]) -> list[str]:
    lines = [
        "| case | unknowns | gpusim s | error | best peer | s | peer / gpusim | CalculiX / gpusim "
        "| second load case | bytes per unknown |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for case in cases:
        own, peer, whole = case.own(), case.best_peer(), case.best_peer(whole_runs=True)
        lines.append(
            f"| {case.case} | {case.unknowns} | {_seconds(own)} | {_error(own)} "
            f"| {peer.solver if peer else '-'} | {_seconds(peer)} | {_ratio(peer, own)} "
            f"| {_ratio(whole, own)} | {_percent(case.second_case)} "
            f"| {_number(case.bytes_per_unknown)} |"
        )
    return lines


def _bandwidth(cases: Sequence[PeerCaseResult]) -> list[str]:
    measured = [case for case in cases if "share" in case.operator]
    if not measured:
        return []
    lines = [
        "Operator y = K u on the device against a copy between two buffers:", "",
        "| case | copy GB/s | NumPy copy GB/s | operator ms | bytes moved per unknown "
        "| share of the copy bandwidth | as if the matrix were assembled |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for case in measured:
        found = case.operator
        lines.append(
            f"| {case.case} | {found['copy_bytes_per_s'] / 1e9:.1f} "
            f"| {found['host_copy_bytes_per_s'] / 1e9:.1f} | {1e3 * found['operator_seconds']:.2f} "
            f"| {found['operator_bytes'] / found['unknowns']:.0f} | {_percent(found['share'])} "
            f"| {_percent(found['assembled_share'])} |"
        )
    return [*lines, "", *_host_bandwidth(measured)]


def _host_bandwidth(measured: Sequence[PeerCaseResult]) -> list[str]:
    found = [(case.case, case.operator) for case in measured if "host_share" in case.operator]
    if not found:
        return []
    lines = [
        "The same on the host, as conjugate gradients do it there on all cores (runs of nodes on a "
        "lattice whose rows repeat, blocks of 3x3 elsewhere), against NumPy's copy on one core:",
        "",
        "| case | product ms | bytes moved per unknown | share of the copy bandwidth "
        "| as if the matrix were assembled |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {1e3 * one['host_operator_seconds']:.2f} "
        f"| {one['host_bytes'] / one['unknowns']:.0f} | {_percent(one['host_share'])} "
        f"| {_percent(one['host_assembled_share'])} |"
        for name, one in found
    ]
    return lines


def _seconds(point: Point | None) -> str:
    return f"{point.seconds:.2f}" if point else "-"


def _error(point: Point | None) -> str:
    return f"{point.error:.0e}" if point else "-"


def _ratio(peer: Point | None, own: Point | None) -> str:
    return f"{peer.seconds / own.seconds:.2f}" if peer and own else "-"


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %" if np.isfinite(value) else "-"


def _number(value: float) -> str:
    return f"{value:.0f}" if np.isfinite(value) else "-"


def _draw_solver(result: SolverResult, path: Path) -> None:
    cases = [case for case in result.cases if case.points]
    columns = min(3, max(1, len(cases)))
    rows = -(-len(cases) // columns) or 1
    figure = Figure(figsize=(5.2 * columns, 4.0 * rows), layout="constrained")
    names = list(dict.fromkeys(p.solver for case in cases for p in case.points))
    colours = {name: _SERIES[k % len(_SERIES)] for k, name in enumerate(names)}
    for k, case in enumerate(cases):
        axes = figure.add_subplot(rows, columns, k + 1)
        for name in names:
            points = [p for p in case.points if p.solver == name and np.isfinite(p.error)]
            if points:
                axes.plot([max(p.error, 1e-13) for p in points], [p.seconds for p in points],
                          "o-" if name == "gpusim" else ".--", color=colours[name], label=name,
                          linewidth=2.0 if name == "gpusim" else 0.9)  # fmt: skip
        axes.axvline(ENOUGH, color="0.7", linewidth=0.8, zorder=0)
        axes.set(xscale="log", yscale="log", title=f"{case.case}, {case.unknowns} unknowns",
                 xlabel="relative displacement error", ylabel="seconds")  # fmt: skip
        axes.invert_xaxis()
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=6)
    figure.savefig(path, dpi=110)
