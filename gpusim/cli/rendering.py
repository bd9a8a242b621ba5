"""``gpusim render``: pictures and truth of a displacement file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

import typer

from gpusim.cli.console import (
    BackendOption,
    Json,
    Output,
    ProgressDisplay,
    Quiet,
    exit_codes,
    importing,
    out,
    starting,
)
from gpusim.errors import require
from gpusim.files.output_folder import check_folder


def render(
    field: Annotated[
        Path,
        typer.Option(metavar="FILE", help="Displacements: .frd, .vtu, .pvd, Exodus or .npz."),
    ],
    output: Output,
    unit: Annotated[
        Literal["m", "cm", "mm", "um", "in"], typer.Option(help="Of the file's lengths.")
    ] = "mm",
    displacement: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of the file's variable, if it isn't usual.")
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A calibration file; else the body fills the image."),
    ] = None,
    resolution: Annotated[
        str | None, typer.Option(metavar="COLSxROWS", help="Of its pictures, px.")
    ] = None,
    speckle_mm: Annotated[
        float | None, typer.Option(help="Mean diameter of the speckles; else four pixels.")
    ] = None,
    step: Annotated[
        Literal["last", "all"], typer.Option(help="The states that are shown after the first.")
    ] = "last",
    backend: BackendOption = "auto",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Render what another program has computed: pictures and truth, nothing is solved.

    gpusim render --field result.frd -o out

    gpusim render --field result.vtu --unit m --camera rig.caldat --resolution 2448x2048 -o out
    """
    with exit_codes():
        check_folder(output)
        with importing(), starting(output, backend):
            from gpusim.pipeline import run
            from gpusim.pipeline.field_scene import field_scene

            scene = field_scene(
                field, unit=unit, displacement=displacement, camera=camera,
                resolution=_size(resolution), speckle_mm=speckle_mm, step=step,
            )  # fmt: skip
        with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
            report = run(scene, output, backend=backend, progress=progress)
        if as_json:
            out(report.to_json().rstrip())
        elif not quiet:
            for warning in report.warnings:
                out(f"warning: {warning}")
            out(f"\nReport: {output / 'report.html'}")
            made = output / "scene.toml"
            out(f"To change camera, speckle or light, or to measure: edit {made}, then")
            out(f"  gpusim run {made} -o {output}")


def _size(text: str | None) -> tuple[int, int] | None:
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text or "")
    require(text is None or found is not None, "--resolution", repr(text), "like 2448x2048")
    return None if found is None else (int(found[1]), int(found[2]))
