"""Markdown, JSON and the figure of the stability suite."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.plain_json import plain_json
from benchmarks.stability.nonlinear_suite import WARNED, LargeVerdict
from benchmarks.stability.suite import RIGHT, SILENT, STOPPED, TOLD, Verdict

__all__ = [
    "large_markdown",
    "stability_markdown",
    "vibration_markdown",
    "write_large",
    "write_stability",
    "write_vibration",
]

_VERDICTS = {RIGHT: "C0", TOLD: "C1", STOPPED: "0.5", SILENT: "red"}


def write_stability(verdicts: Sequence[Verdict], folder: Path, machine: str) -> list[Path]:
    """``stability.md``, ``stability.json``, ``stability.png`` in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"stability.{end}" for end in ("md", "json", "png")]
    paths[0].write_text(stability_markdown(verdicts, machine), encoding="utf-8")
    paths[1].write_text(plain_json([asdict(v) for v in verdicts]), encoding="utf-8")
    _draw_stability(verdicts, paths[2])
    return paths


def stability_markdown(verdicts: Sequence[Verdict], machine: str) -> str:
    """Counts, then a table with one row per case and way."""
    kinds = dict.fromkeys(v.verdict for v in verdicts)
    counts = ", ".join(f"{sum(v.verdict == kind for v in verdicts)} {kind}" for kind in kinds)
    lines = [
        "# Stability of the solver", "",
        f"Written by `python -m benchmarks.stability`. {machine}.", "",
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


_LARGE = (
    "# Stability of large displacements", "",
    "Written by `python -m benchmarks.stability --large`. Seconds are of the processor.", "",
    "Right: all load steps are within the case's tolerance (what its mesh reaches) of a closed "
    "form, an integrated bar, or a second program. Warned: solved, and a warning names what is "
    "doubtful; an infinite error means that there is no (stable) equilibrium to compare with. "
    "Told: an error, or `converged` is False, with the cause; steps before are right. Stopped: "
    "the same without the cause. The column says if a case should have ended otherwise.",
)  # fmt: skip
_VIBRATION = (
    "# Stability of vibration", "",
    "Written by `python -m benchmarks.stability --vibration`. Seconds are of the processor, "
    "references included.", "",
    "Right: frequencies, loads of buckling or responses are within the case's tolerance of a "
    "closed form, or of all modes of the same mesh by dense algebra; there, what is stated holds, "
    "too. 80 bits: energies of the found shapes in extended precision. Warned: answered, and a "
    "warning names what is doubtful. Told: an error, or `converged` is False, with the cause. "
    "Stopped: the same without the cause. The column says if a case should have ended otherwise.",
)  # fmt: skip


def write_large(verdicts: Sequence[LargeVerdict], folder: Path) -> Path:
    """``stability_large.md`` in ``folder``."""
    return _write(folder / "stability_large.md", large_markdown(verdicts))


def write_vibration(verdicts: Sequence[LargeVerdict], folder: Path) -> Path:
    """``stability_vibration.md`` in ``folder``."""
    return _write(folder / "stability_vibration.md", vibration_markdown(verdicts))


def _write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def large_markdown(verdicts: Sequence[LargeVerdict]) -> str:
    """Counts, then a table with one row per case."""
    return _endings(_LARGE, verdicts)


def vibration_markdown(verdicts: Sequence[LargeVerdict]) -> str:
    """The same of what vibrates."""
    return _endings(_VIBRATION, verdicts)


def _endings(head: Sequence[str], verdicts: Sequence[LargeVerdict]) -> str:
    """The counts stand before the last paragraph of the ``head``."""
    counts = ", ".join(
        f"{sum(v.verdict == kind for v in verdicts)} {kind}"
        for kind in (RIGHT, WARNED, TOLD, STOPPED, SILENT)
    )
    lines = [
        *head[:-1], f"{len(verdicts)} cases: {counts}.", "", head[-1],
        "", "| case | against | tolerance | error | stated | iterations | s | ends | message |",
        "|---|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for v in verdicts:
        ends = v.verdict if v.verdict == v.wanted else f"**{v.verdict}**, wanted {v.wanted}"
        message = v.message.replace("|", "/").replace("\n", " ")
        lines.append(
            f"| {v.family}: {v.case} | {v.source} | {v.tolerance:g} | {_short(v.error)} "
            f"| {_short(v.stated)} | {v.iterations} | {v.seconds:.1f} | {ends} | {message} |"
        )
    return "\n".join(lines) + "\n"


def _short(value: float) -> str:
    return f"{value:.0e}" if np.isfinite(value) else "-"


def _draw_stability(verdicts: Sequence[Verdict], path: Path) -> None:
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
