"""The command line: ``gpusim run | solve | dic | track | calibrate | plan | schema | doctor`` …

Exit codes: 0 good, 1 unexpected, 2 bad scene or usage, 3 not converged, 4 no usable adapter or
device lost, 5 twin mismatch, 130 interrupted. Heavy modules are imported by the command that needs
them, so that help and plan are quick.

The other commands are below. Its modules:

- `help`: What the help of commands says of options and of effects, and how words are listed.
- `console`: Options, messages, progress, and errors as one message with an exit code.
- `tables`: Tables that commands print of what applications have found.
- `init`: ``gpusim init``: a first scene, of a part of the user's own or from a template.
- `scene_templates`: Commented scenes made from templates.
- `keys`: Tables and keys of the scene file, for ``gpusim schema``.
- `measuring`: ``gpusim dic`` and ``gpusim calibrate``.
- `vibration`: ``gpusim identify`` and ``gpusim magnify``.
- `tracking`: ``gpusim track``.
- `rendering`: ``gpusim render``.
- `study`: ``gpusim study``.
- `view`: ``gpusim view``.
- `diagnosis`: ``gpusim doctor`` and ``gpusim check``.
- `bench`: ``gpusim bench``.
"""

from __future__ import annotations

import io
import json
import logging
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gpusim._version import __version__
from gpusim.cli.bench import bench_app
from gpusim.cli.console import (
    BackendOption,
    Json,
    Output,
    PrintableGroup,
    ProgressDisplay,
    Quiet,
    exit_codes,
    finish,
    folder_name,
    importing,
    out,
    starting,
    waiting,
)
from gpusim.cli.help import CommandLine, EffectCommand, effect_names
from gpusim.cli.init import init
from gpusim.cli.keys import print_tables, table_names
from gpusim.cli.measuring import calibrate, dic
from gpusim.cli.rendering import render
from gpusim.cli.study import study
from gpusim.cli.tables import (
    print_budget,
    print_deck,
    print_explanations,
    print_plan,
    print_report,
)
from gpusim.cli.tracking import track
from gpusim.cli.vibration import identify, magnify
from gpusim.cli.view import view
from gpusim.errors import Fault, InputError, NotConverged, SceneError
from gpusim.files.output_folder import check_folder, inside
from gpusim.interrupts import INTERRUPTED

if TYPE_CHECKING:
    from gpusim.scene import Scene

__all__ = ["app", "main"]

app = CommandLine(
    name="gpusim",
    cls=PrintableGroup,
    help="From a loaded structure to camera images, measured and compared with the truth.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.add_typer(bench_app, name="bench")


ScenePath = Annotated[Path, typer.Argument(metavar="SCENE.toml", help="The scene file.")]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key of the scene: camera.front.focal_mm=35 (repeatable).",
    ),
]
EarlierOutput = Annotated[
    Path | None,
    typer.Option(
        "-o", "--output", metavar="OUT", help="Folder of an earlier run.", parser=folder_name
    ),
]
Only = Annotated[
    list[str] | None,
    typer.Option(
        "--only",
        metavar="EFFECT",
        autocompletion=effect_names,
        help="Leave other effects out: noise (repeatable).",
    ),
]
No = Annotated[
    list[str] | None,
    typer.Option(
        "--no",
        metavar="EFFECT",
        autocompletion=effect_names,
        help="Leave an effect out: distortion (repeatable).",
    ),
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Reuse nothing of an earlier run.")]
StoreOption = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        parser=folder_name,
        help="Results that runs into several folders share; by default OUT has its own.",
    ),
]
Verify = Annotated[bool, typer.Option("--verify", help="Look at earlier results byte by byte.")]
NoSkip = Annotated[bool, typer.Option("--no-skip", help="Switch every shortcut off.")]


def main() -> int:
    """Run the command line and return the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names in a scene may not fit a narrow terminal
            stream.reconfigure(errors="replace")
    if logging.lastResort is not None:  # what libraries tell their developers
        logging.lastResort.setLevel(logging.ERROR)
    try:
        app()
    except KeyboardInterrupt:
        return INTERRUPTED
    except MemoryError:  # before the command, or while it says what is wrong
        sys.stderr.write("error: out of memory\n")
        return 1
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(bool(end.code))
    return 0


def _print_version(wanted: bool) -> None:
    if wanted:
        out(f"gpusim {__version__}")
        raise typer.Exit


@app.callback()
def _app(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """See the help of each command."""


@app.command(cls=EffectCommand)
def run(
    scene: ScenePath,
    output: Output,
    sets: Sets = None,
    only: Only = None,
    no: No = None,
    backend: BackendOption = "auto",
    fresh: Fresh = False,
    no_skip: NoSkip = False,
    store: StoreOption = None,
    verify: Verify = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Solve, render, measure, report; reuse what is unchanged in OUT."""
    with exit_codes():
        check_folder(output)
        with importing(), starting(output, backend):
            loaded = _load(scene, sets).with_effects(only or (), no or ())
            from gpusim.pipeline import run as run_scene

        with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
            report = run_scene(
                loaded,
                output,
                backend=backend,
                fresh=fresh,
                skip=not no_skip,
                store=store,
                verify=verify,
                progress=progress,
            )
        finish(report.to_json(), as_json, quiet, partial(print_report, report, output))


@app.command()
def budget(
    scene: ScenePath,
    output: Output,
    sets: Sets = None,
    backend: BackendOption = "auto",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Run a scene, then with and without each effect: what each adds to the measured error."""
    with exit_codes():
        with importing():
            loaded = _load(scene, sets)
            check_folder(output)
            from gpusim.pipeline.runner.error_budget import run_budget

        with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
            report = run_budget(loaded, output, backend=backend, progress=progress)
        finish(report.to_json(), as_json, quiet, partial(print_budget, report, output))


@app.command()
def explain(
    scene: Annotated[Path, typer.Argument(help="A scene file, or the folder of a run.")],
    output: EarlierOutput = None,
    sets: Sets = None,
    backend: BackendOption = "auto",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Why DIC differs from the truth: run a scene with and without each effect, and map parts."""
    with exit_codes():
        with importing():
            folder = output or (scene if scene.is_dir() else None)
            if folder is None:
                raise InputError("explain -o; got none for a scene file; expected -o OUT")
            loaded = _load(inside(scene, "scene.toml") if scene.is_dir() else scene, sets)
            check_folder(folder)
            from gpusim.pipeline.runner.explanation import explain as explain_fields

        with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
            report = explain_fields(loaded, folder, backend=backend, progress=progress)
        finish(report.to_json(), as_json, quiet, partial(print_explanations, report, folder))


@app.command()
def solve(
    deck: Annotated[Path, typer.Argument(metavar="FILE.inp", help="An Abaqus or CalculiX deck.")],
    output: Output,
    backend: BackendOption = "auto",
    tolerance: Annotated[
        float, typer.Option(help="Relative error of the displacement to reach.")
    ] = 1e-6,
    stress: Annotated[bool, typer.Option("--stress", help="Write stresses too.")] = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Solve the steps of an input deck and write displacements, reactions, modes and motions."""
    with exit_codes():
        with importing():
            from gpusim.applications.decks import solve_deck

        options: dict[str, Any] = {"backend": backend, "tolerance": tolerance}
        with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
            done = solve_deck(deck, output, stress=stress, progress=progress, **options)
        text = json.dumps(done.report, indent=2)
        finish(text, as_json, quiet, partial(print_deck, done.report, output))
        if done.failure:
            raise NotConverged(done.failure)


app.command()(dic)
app.command()(track)
app.command()(calibrate)
app.command()(identify)
app.command()(magnify)
app.command()(render)
app.command()(study)
app.command()(view)
app.command()(init)


@app.command()
def plan(
    scene: ScenePath,
    output: EarlierOutput = None,
    sets: Sets = None,
    backend: BackendOption = "auto",
    fresh: Fresh = False,
    no_skip: NoSkip = False,
    store: StoreOption = None,
    verify: Verify = False,
    as_json: Json = False,
) -> None:
    """Validate a scene and tell what a run would do, why, and what it costs; run nothing."""
    with exit_codes():
        if output is not None:
            check_folder(output)
        with importing():
            loaded = _load(scene, sets)
            from gpusim.pipeline.checks.resources import check_files, memory_fault, waits_for_cad
            from gpusim.pipeline.checks.warnings import scene_warnings
            from gpusim.plan.machine_speed import Speed
            from gpusim.plan.plan import make_plan
            from gpusim.scene.cost import Counts

        strange = check_files(loaded) if loaded.reads_files else []
        speed = Speed.read(backend)
        planned = partial(
            make_plan, loaded, output, backend, fresh=fresh, skip=not no_skip, store=store,
            verify=verify, speed=speed,
        )  # fmt: skip
        waits = waits_for_cad(loaded)
        beforehand: list[str] = []
        counts: Counts = {}
        # a part that needs no mesh any more is left alone
        if not waits or any(s.runs and s.name.endswith("mesh") for s in planned().stages):
            with waiting("meshing CAD with Gmsh" if waits else ""):
                beforehand = scene_warnings(loaded, counts)
        made = planned(made=counts)
        short = memory_fault(made)
        found = (*made.warnings, *strange, *beforehand, *([short] if short else []))
        made = replace(made, warnings=tuple(dict.fromkeys(found)))
        finish(json.dumps(made.to_dict(), indent=2), as_json, False, partial(print_plan, made))


@app.command()
def schema(
    table: Annotated[
        str | None,
        typer.Argument(
            metavar="TABLE",
            autocompletion=table_names,
            help="A table or key, in words: camera, body.load.force, focal_mm.",
        ),
    ] = None,
) -> None:
    """Print what a table or a key of a scene file means; without one the JSON schema, for editors.

    docs/scene.md has all of it on one page.
    """
    with exit_codes():
        from gpusim.scene import json_schema

        if table is None:
            out(json.dumps(json_schema(), indent=2))
        else:
            print_tables(table)


@app.command()
def doctor(as_json: Json = False) -> None:
    """Look at the adapter and compare every kernel with its NumPy twin."""
    _diagnose(None, as_json)


@app.command()
def check(
    stage: Annotated[
        str, typer.Argument(help="A stage as `gpusim doctor` names it: fem/krylov/cg.")
    ],
    as_json: Json = False,
) -> None:
    """Compare the kernels of one stage with their NumPy twin."""
    _diagnose(stage, as_json)


def _diagnose(stage: str | None, as_json: bool) -> None:
    with exit_codes():
        from gpusim.cli.diagnosis import diagnose

        found = diagnose(stage)
        out(json.dumps(found.to_dict(), indent=2) if as_json else "\n".join(found.lines()))
        raise typer.Exit(found.exit_code)


def _load(path: Path, sets: list[str] | None) -> Scene:
    """The scene with the ``--set`` changes; raises SceneError with every fault."""
    from gpusim.scene import load_scene, parse_value

    overrides: dict[str, Any] = {}
    for entry in sets or ():
        key, equals, value = entry.partition("=")
        if not equals or not key.strip():
            raise SceneError("--set", [Fault("--set", "no value", entry, "KEY=VALUE")])
        overrides[key.strip()] = parse_value(value.strip())
    return load_scene(path, overrides)
