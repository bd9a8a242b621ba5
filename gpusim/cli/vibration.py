"""The commands that look at vibration in videos: ``gpusim identify`` and ``gpusim magnify``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from gpusim.cli.console import (
    Json,
    Output,
    ProgressDisplay,
    Quiet,
    exit_codes,
    finish,
    importing,
    out,
)
from gpusim.cli.measuring import Region, numbers_of, options_named, roi_of
from gpusim.cli.tables import print_rows

Video = Annotated[
    Path, typer.Argument(metavar="VIDEO", help="A video, a folder of pictures, a TIFF stack.")
]
Rate = Annotated[
    float | None, typer.Option("--rate-hz", help="Pictures a second, if VIDEO doesn't say.")
]


def identify(
    video: Video,
    output: Output,
    points: Annotated[
        list[str] | None,
        typer.Option(
            "--point", metavar="X,Y", help="A point, px (repeatable), in place of the grid."
        ),
    ] = None,
    grid: Annotated[int, typer.Option(help="Points along the longer side of a grid.")] = 24,
    roi: Region = None,
    band: Annotated[
        str | None, typer.Option(metavar="LOW,HIGH", help="Where modes are looked for, Hz.")
    ] = None,
    modes: Annotated[int, typer.Option(help="How many modes at most.")] = 3,
    method: Annotated[Literal["ssi", "fdd"], typer.Option(help="Subspaces, or spectra.")] = "ssi",
    excitation: Annotated[
        Literal["ambient", "release"], typer.Option(help="Random all the time; or let go, or hit.")
    ] = "ambient",
    displacements: Annotated[
        Literal["lucas-kanade", "gradient", "phase"], typer.Option(help="How points are followed.")
    ] = "lucas-kanade",
    subset: Annotated[int, typer.Option(help="Odd width of the subsets, px.")] = 21,
    rate_hz: Rate = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Identify modes in a video: frequencies, damping, shapes.

    gpusim identify film.mkv -o out --band 5,60 --modes 4

    gpusim identify frames/ -o out --rate-hz 2000 --excitation release
    """
    with exit_codes(), options_named():
        with importing():
            from gpusim.applications import IdentificationSettings, identify_files
        places = [numbers_of("--point", one, "X,Y in pixels") for one in points or []]
        settings = IdentificationSettings(
            points=places or None, grid=grid, roi=roi_of(roi), displacements=displacements,
            subset=subset, rate_Hz=rate_hz, modes=modes, method=method, excitation=excitation,
            band_Hz=None if band is None else numbers_of("--band", band, "LOW,HIGH in Hz"),
        )  # fmt: skip
        with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
            done = identify_files(video, output, settings, progress=progress)
        text = json.dumps(done.report, indent=2)
        finish(text, as_json, quiet, partial(_print_modes, done.report, output))


def magnify(
    video: Video,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="OUT", help="FILM.mkv, .cih, .mp4, .gif, or a folder."
        ),
    ],
    band: Annotated[str, typer.Option(metavar="LOW,HIGH", help="Frequencies, Hz.")],
    factor: Annotated[float, typer.Option(help="How many times larger.")],
    rate_hz: Rate = None,
    quiet: Quiet = False,
) -> None:
    """Show motions of some frequencies several times as large.

    gpusim magnify film.mkv --band 10,40 --factor 20 -o large.mkv
    """
    with exit_codes(), options_named():
        with importing():
            from gpusim.applications import magnify_files
        limits = numbers_of("--band", band, "LOW,HIGH in Hz")
        with ProgressDisplay(quiet, stream_is_result=False) as progress:
            path = magnify_files(video, output, limits, factor, rate_Hz=rate_hz, progress=progress)
        if not quiet:
            out(f"{path}")


def _print_modes(report: Mapping[str, Any], folder: Path) -> None:
    from gpusim.report.text import uncertain

    rows: list[tuple[str, ...] | str] = [("mode", "frequency Hz", "damping %")]
    for one in report["modes"]:
        hertz = uncertain(one["frequency_Hz"], one["frequency_sigma_Hz"])
        share = uncertain(100 * one["damping"], 100 * one["damping_sigma"])
        rows.append((str(int(one["mode"])), hertz, share))
    lost = "".join(f", {count} {reason}" for reason, count in report["lost"].items())
    out(f"{report['measured']} of {report['points']} points in {report['frames']} frames{lost}")
    print_rows(rows, "<>>")
    for text in report["warnings"]:
        out(f"warning: {text}")
    out(f"\nTables and shapes: {folder}")
