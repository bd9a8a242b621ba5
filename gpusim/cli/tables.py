"""Tables that commands print of what applications have found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpusim.cli.console import out, size_text, time_text

if TYPE_CHECKING:
    from gpusim.plan.plan import Plan
    from gpusim.report import Budget, Explanation, Report


def print_correlation(report: Mapping[str, Any], folder: Path) -> None:
    """A line for each picture: how much is measured, mean motions, uncertainty."""
    rows = report["images"]
    wide = max(5, max(len(Path(row["image"]).name) for row in rows)) + 2
    flat = ("u_mean", "v_mean", "sigma_median")
    keys = flat if flat[0] in rows[0] else ("U_mean", "V_mean", "W_mean", "sigma_median_mm")
    heads = [key.replace("_mean", "").replace("_median", "").replace("_", " ") for key in keys]
    out()
    unit = "px" if keys == flat else "mm"
    titles = "".join(f"{head if 'sigma' in head else f'mean {head} {unit}':>11}" for head in heads)
    out(f"{'image':<{wide}}{'measured':>16}{titles}")
    for row in rows:
        name, share = Path(row["image"]).name, f"{row['measured']} of {row['points']}"
        numbers = "".join(f"{'':>11}" if row[key] is None else f"{row[key]:>11.4f}" for key in keys)
        out(f"{name:<{wide}}{share:>16}{numbers}")
        lost = {k: n for k, n in row["counts"].items() if k != "OK"}
        if lost:
            out(f"{'':<{wide}}  " + ", ".join(f"{n} {k.lower()}" for k, n in lost.items()))
    out()
    out(f"Report: {folder / 'report.html'}")
    for warning in report["warnings"]:
        out(f"warning: {warning}")


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


def print_calibration(report: Report, missed: Sequence[str], folder: Path) -> None:
    """What the report has on top, parameters of the cameras, pictures that weren't used."""
    for label, (value, note) in report.highlights.items():
        out(f"{label:<24}{value}  ({note})")
    for table in report.tables:
        for row in (table.columns, *table.rows):
            out("".join(f"{cell:<26}" for cell in row).rstrip())
    for label, value in report.facts.items():
        out(f"{label:<24}{value}")
    for text in missed:
        out(f"not used: {text}")
    out(f"\nReport: {folder / 'report.html'}")


def print_deck(report: Mapping[str, Any], folder: Path) -> None:
    """A line for each step: unknowns, iterations, largest displacement, reaction."""
    cells = ", ".join(
        f"{count} {kind} ({report['formulation'][kind]})" for kind, count in report["cells"].items()
    )
    out(f"{report['deck']}: {report['nodes']} nodes, {cells}")
    out()
    out(
        f"{'step':<6}{'unknowns':>10}{'iterations':>12}{'error':>10}"
        f"{'largest u':>14}{'at node':>10}{'energy':>14}  reaction"
    )
    for step in report["steps"]:
        reaction = ", ".join(f"{value:.6g}" for value in step["reaction"])
        out(
            f"{step['number']:<6}{step['unknowns']:>10}{step['iterations']:>12}"
            f"{step['error_estimate']:>10.1e}{step['largest_displacement']:>14.6g}"
            f"{step['largest_displacement_node']:>10}{step['strain_energy']:>14.6g}  {reaction}"
        )
        if "largest_von_mises" in step:
            out(
                f"      largest von Mises stress {step['largest_von_mises']:.6g} in element "
                f"{step['largest_von_mises_element']}"
            )
    for warning in report["warnings"]:
        out(f"warning: {warning}")
    if report["ignored"]:
        out(f"read over: {', '.join(report['ignored'])}")
    out()
    out(f"Results: {folder / 'solution.pvd'}, {folder / 'displacements.npz'}")


def print_plan(made: Plan) -> None:
    """A line for each stage, equal ones together; what is doubtful; what it costs."""
    from gpusim.report.stage_rows import stage_rows

    rows = stage_rows(made.stages)
    wide = max(len(name) for name, _ in rows) + 2
    out(f"{'stage':<{wide}}{'':<9}{'memory':>8}{'time':>9}  reason")
    for name, stages in rows:
        memory = size_text(max(stage.memory_bytes for stage in stages))
        seconds = time_text(sum(stage.seconds for stage in stages))
        pictures = f"{len(stages)} pictures" if len(stages) > 1 else ""
        shared = set.intersection(*(set(stage.detail.split(", ")) for stage in stages))
        detail = ", ".join(word for word in stages[0].detail.split(", ") if word in shared)
        why = "; ".join(word for word in (stages[0].reason, pictures, detail) if word)
        out(f"{name:<{wide}}{stages[0].state:<9}{memory:>8}{seconds:>9}  {why}")
    out()
    total = time_text(made.seconds) or "no time"
    for warning in made.warnings:
        out(f"warning: {warning}")
    if made.busy >= 1.5:
        out(f"This machine is busy: everything takes about {made.busy:.2g} times as long now.")
    out(f"{made.scene}: valid; about {total} and {size_text(made.memory_bytes) or 'no memory'}.")


def print_report(report: Report, folder: Path) -> None:
    """What was measured beside what is true, warnings, and where the page is."""
    shown = [item for item in report.measurements if not item.detail]
    if shown:
        out()
        # reasons in brackets are on the page
        names = [n if len(n) < 60 else n.partition(" (")[0] for n in (item.name for item in shown)]
        wide = max(map(len, names)) + 2
        out(f"{'':<{wide}}{'measured':>12}{'truth':>12}{'error':>12}{'':>10}")
        for name, item in zip(names, shown, strict=True):
            # of a truth that is zero but for rounding no share says anything
            known = abs(item.error_relative) < 1e3
            relative = f"{100 * item.error_relative:+.3f} %" if known else ""
            out(
                f"{name:<{wide}}{item.measured:12.6g}{item.truth:12.6g}{item.error:12.3g} "
                f"{item.unit:<4}{relative:>12}"
            )
    for warning in report.warnings:
        out(f"warning: {warning}")
    out()
    out(f"Report: {folder / 'report.html'}")


def print_budget(budget: Budget, folder: Path) -> None:
    """One column for each error, one line for each state of the images."""
    names = [f"{name} / {unit}" if unit else name for name, unit in budget.quantities]
    for number, name in enumerate(names, start=1):
        out(f"({number}) {name}")
    columns = range(1, len(names) + 1)
    out(f"{'images with':<28}" + "".join(f"{f'({number})':>12}" for number in columns))
    words = {"all": "everything", "none": "none of the effects"}
    for row in budget.rows:
        label = words.get(row.state) or f"{row.state} {row.source}"
        out(f"{label:<28}" + "".join(f"{value:12.3g}" for value in row.errors))
    for text in budget.remarks:
        out(text)
    out()
    out(f"Report: {folder / 'report.html'}")


def print_explanations(explanations: Sequence[Explanation]) -> None:
    """The parts of each measure's error, and what they say."""
    for one in explanations:
        out()
        heads = (f"{unit:>13}{'share':>13}" for unit in one.units.values())
        out(f"{f'{one.measure}, RMS':<28}" + "".join(heads))
        for name, sizes in one.parts.items():
            told = (f"{size.rms:13.3g}{size.share_percent:z11.1f} %" for size in sizes.values())
            out(f"{name:<28}" + "".join(told))
        for text in one.remarks:
            out(text)
    out()
