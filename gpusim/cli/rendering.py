"""``gpusim render``: pictures and truth of a displacement file."""

from __future__ import annotations

import re
import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gpusim.choices import LengthUnit
from gpusim.cli.console import (
    BackendOption,
    Json,
    Output,
    ProgressDisplay,
    Quiet,
    exit_codes,
    finish,
    importing,
    out,
    starting,
)
from gpusim.cli.tables import print_end
from gpusim.errors import require
from gpusim.files.output_folder import check_folder

if TYPE_CHECKING:
    from gpusim.report import Report

Unit = Annotated[LengthUnit, typer.Option(help="Of its lengths.")]
Step = Annotated[Literal["last", "all"], typer.Option(help="States that follow the first one.")]


def render(
    field: Annotated[Path, typer.Option(metavar="FILE", help=".frd .vtu .pvd .npz or Exodus.")],
    output: Output,
    unit: Unit = "mm",
    displacement: Annotated[str | None, typer.Option(help="Name of its nodal variable.")] = None,
    camera: Annotated[Path | None, typer.Option(help="Calibration file; else one is made.")] = None,
    resolution: Annotated[str | None, typer.Option(metavar="WxH", help="Of pictures, px.")] = None,
    speckle_mm: Annotated[float | None, typer.Option(help="Mean diameter; else 4 px.")] = None,
    step: Step = "last",
    backend: BackendOption = "auto",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Render what another program has computed: pictures and truth; nothing is solved.

    gpusim render --field result.frd -o out

    gpusim render --field result.vtu --unit m --camera rig.caldat --resolution 2448x2048 -o out
    """
    with exit_codes():
        check_folder(output)
        sides = re.fullmatch(r"(\d{1,5})x(\d{1,5})", resolution or "1x1")
        require(sides is not None, "--resolution", repr(resolution), "like 2448x2048")
        size = (int(sides[1]), int(sides[2])) if sides and resolution else None
        with importing(), starting(output, backend):
            from gpusim.applications.field_scene import field_scene
            from gpusim.pipeline import run

            scene = field_scene(
                field, unit=unit, displacement=displacement, camera=camera, resolution=size,
                speckle_mm=speckle_mm, step=step,
            )  # fmt: skip
        with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
            report = run(scene, output, backend=backend, progress=progress)
        finish(report.to_json(), as_json, quiet, partial(_print_next, report, output))


def _print_next(report: Report, folder: Path) -> None:
    """Warnings, where the page is, and how to go on."""
    print_end(report.warnings, folder)
    made = f"{folder / 'scene.toml'}"
    out(f"To change camera, paint or light, or to measure: edit {made}, then")
    out("  " + shlex.join(["gpusim", "run", made, "-o", str(folder)]))
