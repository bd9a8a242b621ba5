"""Benchmark results as Markdown, JSON and figures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gpusim.bench.solver import ENOUGH, CaseResult, Point, SolverResult
from gpusim.bench.stability import RIGHT, SILENT, STOPPED, TOLD, Verdict

__all__ = ["solver_markdown", "stability_markdown", "write_solver", "write_stability"]

# gpusim first; enough different ones for every peer
_SERIES = ("black", *(f"C{k}" for k in range(10)), "gold", "lime", "navy", "teal", "salmon")
_VERDICTS = {RIGHT: "C0", TOLD: "C1", STOPPED: "0.5", SILENT: "red"}


def write_solver(result: SolverResult, folder: Path) -> list[Path]:
    """``solver.md``, ``solver.json``, ``solver.png`` in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"solver.{end}" for end in ("md", "json", "png")]
    paths[0].write_text(solver_markdown(result), encoding="utf-8")
    paths[1].write_text(_json(asdict(result)), encoding="utf-8")
    _draw_solver(result, paths[2])
    return paths


def solver_markdown(result: SolverResult) -> str:
    """The whole report."""
    lines = [
        "# Solver: run time against displacement error", "",
        f"Written by `gpusim bench solver`. {result.machine}.", "",
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
        lines += ["", f"## {case.case}: {case.unknowns} unknowns", "", *_case_table(case)]
    return "\n".join(lines) + "\n"


def _summary(cases: Sequence[CaseResult]) -> list[str]:
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


def _bandwidth(cases: Sequence[CaseResult]) -> list[str]:
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


def _host_bandwidth(measured: Sequence[CaseResult]) -> list[str]:
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


def _case_table(case: CaseResult) -> list[str]:
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
            f"| {p.seconds:.2f} | {_precise(p.error)} | {_precise(p.difference)} | {p.iterations} "
            f"| {p.peak_kib / 1024:.0f} |"
        )
    return lines + ([""] if case.failures else []) + [f"- {text}" for text in case.failures]


def _seconds(point: Point | None) -> str:
    return f"{point.seconds:.2f}" if point else "-"


def _error(point: Point | None) -> str:
    return f"{point.error:.0e}" if point else "-"


def _ratio(peer: Point | None, own: Point | None) -> str:
    return f"{peer.seconds / own.seconds:.2f}" if peer and own else "-"


def _json(content: Any) -> str:
    """JSON knows no NaN: what wasn't measured is null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(one) for key, one in value.items()}
        if isinstance(value, list):
            return [plain(one) for one in value]
        return None if isinstance(value, float) and not np.isfinite(value) else value

    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def _precise(value: float) -> str:
    return f"{value:.1e}" if np.isfinite(value) else "-"


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %" if np.isfinite(value) else "-"


def _number(value: float) -> str:
    return f"{value:.0f}" if np.isfinite(value) else "-"


def _draw_solver(result: SolverResult, path: Path) -> None:
    from matplotlib.figure import Figure

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


def write_stability(verdicts: Sequence[Verdict], folder: Path, machine: str) -> list[Path]:
    """``stability.md``, ``stability.json``, ``stability.png`` in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"stability.{end}" for end in ("md", "json", "png")]
    paths[0].write_text(stability_markdown(verdicts, machine), encoding="utf-8")
    paths[1].write_text(_json([asdict(v) for v in verdicts]), encoding="utf-8")
    _draw_stability(verdicts, paths[2])
    return paths


def stability_markdown(verdicts: Sequence[Verdict], machine: str) -> str:
    """Counts, then a table with one row per case and way."""
    kinds = dict.fromkeys(v.verdict for v in verdicts)
    counts = ", ".join(f"{sum(v.verdict == kind for v in verdicts)} {kind}" for kind in kinds)
    lines = [
        "# Stability of the solver", "",
        f"Written by `gpusim bench stability`. {machine}.", "",
        f"{len(verdicts)} solves: {counts}; {sum(v.verdict == SILENT for v in verdicts)} silent "
        "failures.", "",
        "Right: converged, and the greatest error over load cases (max norm, relative) is at most "
        "the tolerance. Told: an error, or a result marked as not converged, that names the "
        "cause. Errors are against an own "
        "assembly and elimination in 80-bit floats, or with 50 digits where those don't suffice.",
        "", "| case | way | unknowns | error | stated | iterations | s | verdict | message |",
        "|---|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for v in verdicts:
        message = "" if v.verdict == RIGHT else v.message.replace("|", "/").replace("\n", " ")
        lines.append(
            f"| {v.case} | {v.way} | {v.unknowns or '-'} | {_short(v.error)} "
            f"| {_short(v.stated)} | {v.iterations} | {v.seconds:.1f} | {v.verdict} | {message} |"
        )
    return "\n".join(lines) + "\n"


def _short(value: float) -> str:
    return f"{value:.0e}" if np.isfinite(value) else "-"


def _draw_stability(verdicts: Sequence[Verdict], path: Path) -> None:
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(v.case for v in verdicts))
    figure = Figure(figsize=(9.0, 1.5 + 0.16 * len(names)), layout="constrained")
    axes = figure.add_subplot()
    marks = dict(zip(dict.fromkeys(v.way for v in verdicts), "ox+^sd", strict=False))
    seen: set[tuple[str, str]] = set()
    for v in verdicts:
        label = f"{v.way}: {v.verdict}" if (v.way, v.verdict) not in seen else None
        seen.add((v.way, v.verdict))
        place = v.error if np.isfinite(v.error) else 1.0
        axes.plot(max(place, 1e-14), names.index(v.case), marks[v.way], markersize=4,
                  color=_VERDICTS[v.verdict], label=label, linestyle="none")  # fmt: skip
    axes.axvline(verdicts[0].tolerance if verdicts else 1e-6, color="0.7", linewidth=0.8)
    axes.set_yticks(range(len(names)), names, fontsize=6)
    axes.set(xscale="log", xlabel="relative displacement error (1: nothing was returned)")
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.legend(fontsize=6)
    figure.savefig(path, dpi=110)
