"""``gpusim study``: many states of a scene, and the table of what was measured in them."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gpusim.cli.console import (
    Backend,
    Json,
    ProgressDisplay,
    Quiet,
    exit_codes,
    finish,
    folder_name,
    importing,
    out,
    size_text,
    time_text,
)
from gpusim.cli.tables import print_report, print_rows
from gpusim.errors import InputError, require
from gpusim.files.input_file import read_input
from gpusim.files.output_folder import LOCK, check_folder, inside

if TYPE_CHECKING:
    from gpusim.studies import StudyPlan

_MOST_ERRORS = 10
Name = Annotated[Path, typer.Argument(metavar="STUDY.toml|OUT", help="A study, or its folder.")]
Folder = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="OUT", help="Output folder.", parser=folder_name),
]
Workers = Annotated[int, typer.Option(min=1, metavar="N", help="Processes of this machine.")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Of Dask: tcp://host:8786; or a file of it.")
]
PlanOnly = Annotated[bool, typer.Option("--plan", help="Tell what would be made; make nothing.")]
Status = Annotated[
    bool, typer.Option("--status", help="Tell how far a study is; it may be running.")
]
Sample = Annotated[
    int | None, typer.Option(metavar="N", help="Run one sample whole, into OUT/samples/N.")
]
Budget = Annotated[
    bool, typer.Option("--budget", help="Of a scene, in place of a study: its uncertainty budget.")
]
BackendOption = Annotated[Backend | None, typer.Option(help="In place of the study's.")]


def study(
    study: Name,
    output: Folder = None,
    workers: Workers = 1,
    scheduler: Scheduler = None,
    plan: PlanOnly = False,
    status: Status = False,
    sample: Sample = None,
    budget: Budget = False,
    backend: BackendOption = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Make the samples of a study; what is there is kept: a study that was ended goes on.

    gpusim study STUDY.toml --plan

    gpusim study STUDY.toml -o OUT --workers 4

    gpusim study OUT --status

    gpusim study --budget SCENE.toml -o OUT
    """
    with exit_codes():
        if output is not None:
            check_folder(output)
        with importing():
            from gpusim.studies import load_study, samples_of
            from gpusim.studies.study_tables import COPY

            if not status:
                from gpusim.studies.plan import study_plan
                from gpusim.studies.study import checked_samples
                from gpusim.studies.study import study as work_off

            folder = output or (study if study.is_dir() else None)
            file = inside(study, COPY) if study.is_dir() else study
            loaded = load_study(file, backend, budget=budget and file == study)
        if plan:
            samples = checked_samples(loaded)
            made, refused = study_plan(loaded, samples), dict(Counter(s.refused for s in samples))
            refused.pop("", None)
            told = json.dumps(made.to_dict() | {"refused": refused}, indent=2)
            finish(told, as_json, quiet, partial(_print_plan, made, refused))
            return
        if folder is None:
            raise InputError("study -o; got none; expected -o OUT, or the folder of a study")
        if sample is not None:
            from gpusim.pipeline import run
            from gpusim.studies.budget.budget_study import with_rig

            samples = samples_of(loaded)
            require(0 <= sample < len(samples), "--sample", sample, f"0 to {len(samples) - 1}")
            place = inside(folder, "samples", str(sample))
            with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
                report = run(
                    samples[sample].scene(with_rig(loaded, folder)), place, backend=loaded.backend,
                    store=inside(folder, ".gpusim"), progress=progress,
                )  # fmt: skip
            finish(report.to_json(), as_json, quiet, partial(print_report, report, place))
            return
        if not status:
            with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
                work_off(loaded, folder, workers=workers, scheduler=scheduler, progress=progress)
        content = _content(folder, loaded)
        finish(json.dumps(content, indent=2), as_json, quiet, partial(_print, content, folder))


def _content(folder: Path, study: Any) -> dict[str, Any]:
    """What has become of the samples of a study."""
    from gpusim.studies import samples_of
    from gpusim.studies.rows import read_rows

    samples = samples_of(study)
    rows = read_rows(folder, samples).values()
    made: Counter[str] = Counter()
    for row in rows:
        made.update(row["made"])
    report = inside(folder, "report.json")
    told = json.loads(read_input(report).text("JSON")) if report.is_file() else {}
    return {
        "samples": len(samples),
        "dataset": study.tables.dataset is not None,
        "running": inside(folder, LOCK).exists(),
        "status": dict(Counter(row["status"] for row in rows)),
        "seconds": round(sum(row["seconds"] for row in rows), 2),
        "made": dict(made),
        "errors": dict(Counter(row["error"] for row in rows if row["error"]).most_common()),
        "budget": [one["advice"] for one in told.get("quantities", ())],
    }


def _print(content: dict[str, Any], folder: Path) -> None:
    """Counts, and the errors that came most often."""
    counts = content["status"]
    words = [f"{count} {name}" for name, count in counts.items()]
    rest = content["samples"] - sum(counts.values())
    words += [f"{rest} to be made"] if rest else []
    out(f"{content['samples']} samples{' (running)' * content['running']}: {', '.join(words)}")
    made = ", ".join(f"{count} {name}" for name, count in content["made"].items())
    if made:
        out(f"made in {time_text(content['seconds'])} of work: {made}")
    errors = list(content["errors"].items())
    for text, count in errors[:_MOST_ERRORS]:
        out(f"{count:6}  {text}")
    if len(errors) > _MOST_ERRORS:
        out(f"and {len(errors) - _MOST_ERRORS} other errors, in samples.csv")
    for advice in content["budget"]:
        out(f"\n{advice}")
    if (table := inside(folder, "samples.csv")).exists():
        out(f"\nTable: {table}")
        if (page := inside(folder, "report.html")).is_file():
            out(f"Report: {page}")
        card = inside(folder, "dataset/README.md")
        if content["dataset"] and card.is_file():
            out(f"Data set: {card}")


def _print_plan(plan: StudyPlan, refused: Mapping[str, int]) -> None:
    """What would be made, and how many samples aren't, by what they don't fulfil."""
    rows = [("samples", f"{plan.samples:,}")]
    rows += [(f"refused: {why}", f"{count:,}") for why, count in refused.items()]
    rows += [(name, f"{count:,}") for name, count in plan.distinct.items()]
    rows += [("time of one worker, about", time_text(plan.seconds)),
             ("disk, about", size_text(plan.bytes)),
             ("memory of a worker, about", size_text(plan.memory_bytes))]  # fmt: skip
    print_rows(rows, "<>")
