"""Tables that commands print of what applications have found."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpusim.cli.console import out, size_text, time_text

if TYPE_CHECKING:
    from gpusim.plan.plan import Plan
    from gpusim.report import Report

_WIDEST = 60
"""Letters of a measurement's name from which on what it has in brackets goes below it."""


def print_rows(rows: Iterable[Sequence[str] | str], sides: str) -> None:
    """Rows in columns as wide as they need, whose cells go to these ``sides``, < or >; a text
    alone stands as it is.

    Examples
    --------
    >>> from gpusim.cli.tables import print_rows
    >>> print_rows([("stage", "time"), ("mesh", "10.5 s"), "and more"], "<>")
    stage    time
    mesh   10.5 s
    and more
    """
    rows = list(rows)
    columns = zip(*(row for row in rows if not isinstance(row, str)), strict=True)
    forms = [f"{side}{max(map(len, cells))}" for side, cells in zip(sides, columns, strict=True)]
    for row in rows:
        cells = [row] if isinstance(row, str) else map(format, row, forms)
        out("  ".join(cells).rstrip())


def print_end(warnings: Iterable[str], folder: Path) -> None:
    """What is doubtful, and where the page is."""
    for text in warnings:
        out(f"warning: {text}")
    out(f"\nReport: {folder / 'report.html'}")


def print_correlation(report: Mapping[str, Any], folder: Path) -> None:
    """A line for each picture: how much is measured, mean motions, uncertainty."""
    flat = ("u_mean", "v_mean", "sigma_median")
    keys = flat if flat[0] in report["images"][0] else (
        "U_mean", "V_mean", "W_mean", "sigma_median_mm"
    )  # fmt: skip
    unit, names = "px" if keys == flat else "mm", [key.partition("_")[0] for key in keys]
    heads = [f"{name} {unit}" if name == "sigma" else f"mean {name} {unit}" for name in names]
    rows: list[Sequence[str] | str] = [("image", "measured", *heads)]
    for one in report["images"]:
        numbers = ["" if one[key] is None else f"{one[key]:.4f}" for key in keys]
        rows.append((Path(one["image"]).name, f"{one['measured']} of {one['points']}", *numbers))
        lost = ", ".join(f"{n} {k.lower()}" for k, n in one["counts"].items() if k != "OK")
        rows += [f"    {lost}"] if lost else []
    out()
    print_rows(rows, "<" + ">" * (1 + len(keys)))
    print_end(report["warnings"], folder)


def print_advice(report: Mapping[str, Any], folder: Path | None) -> None:
    """The pattern, the settings with their reason, and the command that uses them."""
    size, slope, noise = (report["pattern"][name] for name in ("speckle_px", "slope", "noise"))
    out(f"speckles {size:.1f} px, slopes {slope:.3g} levels per px, noise {noise:.3g} levels")
    for text in report["warnings"]:
        out(f"warning: {text}")
    words = (f"{name.replace('_', ' ')} {value}" for name, value in report["settings"].items())
    out(f"\n{', '.join(words)}\n{report['reason']}\n\nNext: {report['command']}")
    if folder is not None:
        out(f"Report: {folder / 'report.html'}")


def print_calibration(report: Report, folder: Path) -> None:
    """What the report has on top, parameters of the cameras, pictures that weren't used."""
    print_rows([(label, f"{value}  ({note})")
                for label, (value, note) in report.highlights.items()], "<<")  # fmt: skip
    for table in report.tables:
        print_rows((table.columns, *table.rows), "<" * len(table.columns))
    print_rows(list(report.facts.items()), "<<")
    print_end(report.warnings, folder)


def print_deck(report: Mapping[str, Any], folder: Path) -> None:
    """A line for each static step: unknowns, iterations (of Newton's method where there are load
    steps), largest displacement, reaction; what the others have found below."""
    cells = ", ".join(
        f"{count} {kind} ({report['formulation'][kind]})" for kind, count in report["cells"].items()
    )
    out(f"{report['deck']}: {report['nodes']} nodes, {cells}\n")
    rows: list[Sequence[str] | str] = [
        ("step", "unknowns", "iterations", "error", "largest u", "at node", "energy", "reaction")
    ]
    static = [step for step in report["steps"] if step["kind"] == "static"]
    for step in static:
        energy = step["strain_energy"]
        rows.append((
            f"{step['number']}", f"{step['unknowns']}",
            f"{step['newton_iterations'] or step['iterations']}",
            f"{step['error_estimate']:.1e}", f"{step['largest_displacement']:.6g}",
            f"{step['largest_displacement_node']}", "" if energy is None else f"{energy:.6g}",
            ", ".join(f"{value:.6g}" for value in step["reaction"]),
        ))  # fmt: skip
        if step["load_steps"] > 1:
            rows.append(f"      in {step['load_steps']} load steps")
        if "largest_von_mises" in step:
            rows.append(
                f"      largest von Mises stress {step['largest_von_mises']:.6g} in element "
                f"{step['largest_von_mises_element']}"
            )
    if static:
        print_rows(rows, "<>>>>>><")
    for step in report["steps"]:
        if step["kind"] != "static":
            _print_motion(step)
    if len(static) < len(report["steps"]):
        out(f"mass: rule {report['mass_rule']!r}")
    for warning in report["warnings"]:
        out(f"warning: {warning}")
    if report["ignored"]:
        out(f"read over: {', '.join(report['ignored'])}")
    arrays = "displacements.npz" if static else f"step_{report['steps'][0]['number']:04d}.npz"
    out(f"\nResults: {folder / 'solution.pvd'}, {folder / arrays}")


def _print_motion(step: Mapping[str, Any]) -> None:
    """What a step with modes, buckling or motion has found."""
    head = f"step {step['number']}: {step['kind']}"
    rows: list[Sequence[str] | str] = []
    if step["kind"] == "modes":
        rows.append(("mode", "frequency", "mass x", "mass y", "mass z"))
        pairs = zip(step["frequencies"], step["effective_mass"], strict=True)
        for number, (frequency, masses) in enumerate(pairs, 1):
            wholes = zip(masses[:3], step["total_mass"][:3], strict=True)
            shares = [f"{own / whole:.1%}" for own, whole in wholes]
            rows.append((f"{number}", f"{frequency:.7g}", *shares))
    elif step["kind"] == "buckling":
        rows.append(("mode", "factor"))
        rows += [(f"{k}", f"{factor:.7g}") for k, factor in enumerate(step["factors"], 1)]
    if rows:
        out(f"{head}, estimated error {step['error_estimate']:.1e}")
        print_rows(rows, ">" * len(rows[0]))
    else:
        where = f"at node {step['largest_displacement_node']}"
        when = (
            f"time {step['at_time']:.6g} of {step['instants']} instants"
            if "at_time" in step
            else f"{step['at_frequency']:.6g} of {len(step['frequencies'])} frequencies"
        )
        out(f"{head}, largest u {step['largest_displacement']:.6g} {where}, {when}")


def print_plan(made: Plan) -> None:
    """A line for each stage, equal ones together; what is doubtful; what it costs."""
    from gpusim.report.stage_rows import stage_rows

    rows = [("stage", "", "memory", "time", "reason")]
    for name, stages in stage_rows(made.stages):
        memory = size_text(max(stage.memory_bytes for stage in stages))
        seconds = time_text(sum(stage.seconds for stage in stages))
        pictures = f"{len(stages)} pictures" if len(stages) > 1 else ""
        shared = set.intersection(*(set(stage.detail.split(", ")) for stage in stages))
        detail = ", ".join(word for word in stages[0].detail.split(", ") if word in shared)
        why = "; ".join(word for word in (stages[0].reason, pictures, detail) if word)
        rows.append((name, stages[0].state, memory, seconds, why))
    print_rows(rows, "<<>><")
    out()
    total = time_text(made.seconds) or "no time"
    for warning in made.warnings:
        out(f"warning: {warning}")
    out(f"{made.scene}: valid; about {total} and {size_text(made.memory_bytes) or 'no memory'}.")


def print_report(report: Report, folder: Path) -> None:
    """What was measured beside what is true, warnings, and where the page is."""
    rows: list[Sequence[str] | str] = [("", "measured", "truth", "error", "", "")]
    for item in report.measurements:
        if not item.detail:
            # long reasons in brackets have a line of their own
            name, bracket, reasons = item.name, "", ""
            if len(name) >= _WIDEST:
                name, bracket, reasons = name.partition(" (")
            told = math.isfinite(item.relative_told)
            relative = f"{100 * item.relative_told:+.3f} %" if told else ""
            values = f"{item.measured:.6g}", f"{item.truth:.6g}", f"{item.error:.3g}"
            rows.append((name, *values, item.unit, relative))
            rows += [f"    ({reasons}"] if bracket else []
    if len(rows) > 1:
        out()
        print_rows(rows, "<>>><>")
    print_end(report.warnings, folder)


def print_budget(report: Report, folder: Path) -> None:
    """One column for each error, one line for each state of the images."""
    budget = report.budget
    if budget is None:
        return
    names = [f"{name} / {unit}" if unit else name for name, unit in budget.quantities]
    for number, name in enumerate(names, start=1):
        out(f"({number}) {name}")
    words = {"all": "everything", "none": "none of the effects"}
    rows = [("images with", *(f"({number})" for number in range(1, len(names) + 1)))]
    for row in budget.rows:
        label = words.get(row.state) or f"{row.state} {row.source}"
        rows.append((label, *(f"{value:.3g}" for value in row.errors)))
    print_rows(rows, "<" + ">" * len(names))
    for text in budget.remarks:
        out(text)
    print_end(report.warnings, folder)


def print_explanations(report: Report, folder: Path) -> None:
    """The parts of each measure's error, and what they say."""
    for one in report.explanations:
        out()
        heads = [head for unit in one.units.values() for head in (unit, "share")]
        rows = [(f"{one.measure}, RMS", *heads)]
        for name, sizes in one.parts.items():
            told = [(f"{size.rms:.3g}", size.share) for size in sizes.values()]
            rows.append((name, *chain.from_iterable(told)))
        print_rows(rows, "<" + ">" * len(heads))
        for text in one.remarks:
            out(text)
    print_end(report.warnings, folder)
