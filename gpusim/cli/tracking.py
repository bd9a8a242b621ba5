"""The command that follows markers and points: ``gpusim track``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from gpusim.cli.console import (
    BackendOption,
    Json,
    Output,
    ProgressDisplay,
    Quiet,
    exit_codes,
    importing,
)
from gpusim.cli.measuring import (
    CalibrationFile,
    CalibrationUnit,
    Format,
    Formats,
    RigFile,
    numbers_of,
    options_named,
    tell,
)
from gpusim.cli.vibration import Rate
from gpusim.errors import require

Videos = Annotated[
    list[Path],
    typer.Argument(metavar="VIDEO...", help="A video, folder or stack; with --stereo two."),
]
Markers = Annotated[
    str | None,
    typer.Option(metavar="LOW,HIGH", help="Widths, px; without points 10,100 is usual."),
]
Points = Annotated[
    list[str] | None,
    typer.Option("--point", metavar="X,Y", help="In the first picture, px (repeatable)."),
]
Lines = Annotated[
    list[str] | None,
    typer.Option("--line", metavar="X0,Y0,X1,Y1,N", help="N points on a line (repeatable)."),
]


def track(
    videos: Videos,
    output: Output,
    markers: Markers = None,
    points: Points = None,
    lines: Lines = None,
    subset: Annotated[int, typer.Option(help="Odd width of the points' subsets, px.")] = 31,
    mm_per_px: Annotated[float | None, typer.Option(help="Of a plane seen squarely.")] = None,
    calibration: CalibrationFile = None,
    stereo: RigFile = None,
    calibration_unit: CalibrationUnit = None,
    rate_hz: Rate = None,
    formats: Formats = None,
    backend: BackendOption = "auto",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Follow markers and points through a video: how far they are from where they were first.

    gpusim track film.mkv -o out     (all checker markers of the first picture)

    gpusim track film.mkv -o out --point 120,80 --line 40,60,400,60,25 --mm-per-px 0.2

    gpusim track --stereo rig.caldat left.mkv right.mkv -o out     (in mm, in space)
    """
    with exit_codes(), options_named():
        expected = "a video, with --stereo two"
        require(len(videos) == 1 + (stereo is not None), "VIDEO...", len(videos), expected)
        with importing():
            from gpusim.applications import CorrelationSettings, track_files
        places = [numbers_of("--point", one, "X,Y in pixels") for one in points or []]
        for line in lines or []:
            *ends, count = numbers_of("--line", line, "X0,Y0,X1,Y1,N in pixels", 5)
            require(count in range(2, 1001), "--line N", f"{count:g}", "2 to 1000 points")
            places += np.linspace(ends[:2], ends[2:], int(count)).tolist()
        settings = CorrelationSettings(
            subset=subset, calibration=stereo or calibration, calibration_unit=calibration_unit,
            backend=backend, formats=tuple(one.value for one in formats or (Format.csv, Format.h5)),
        )  # fmt: skip
        sizes = None if markers is None else numbers_of("--markers", markers, "LOW,HIGH in pixels")
        with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
            done = track_files(
                videos[0], output, settings, points=places, markers_px=sizes, mm_per_px=mm_per_px,
                right=videos[1] if stereo else None, rate_Hz=rate_hz, progress=progress,
            )  # fmt: skip
        tell(done, output, quiet, as_json)
