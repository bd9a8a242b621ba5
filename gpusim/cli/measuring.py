"""The commands that measure pictures: ``gpusim dic`` and ``gpusim calibrate``."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gpusim.choices import LengthUnit, LensModel, Shape, Start, StrainKind, Update
from gpusim.cli.console import (
    BackendOption,
    Json,
    Output,
    ProgressDisplay,
    Quiet,
    exit_codes,
    finish,
    folder_name,
    importing,
)
from gpusim.cli.tables import print_advice, print_calibration, print_correlation
from gpusim.errors import InputError, NotConverged, require

if TYPE_CHECKING:
    from gpusim import measure
    from gpusim.applications import CorrelationOutput, CorrelationSettings

Board = Literal["chessboard", "charuco"]


class Format(StrEnum):
    """How tables are written; options that are given repeatedly take no Literal."""

    csv = "csv"
    npz = "npz"
    h5 = "h5"


Reference = Annotated[
    Path, typer.Argument(metavar="REF", help="The picture before; of a stack or video: FILE#1.")
]
Deformed = Annotated[
    list[Path] | None,
    typer.Argument(metavar="DEF...", help="Pictures after it; of a stack or video all."),
]
Advise = Annotated[
    bool, typer.Option("--advise", help="Find settings for REF; DEF: another still, for its noise.")
]
DetailPx = Annotated[float | None, typer.Option(help="--advise: finest waves to be seen, px.")]
PeakStrain = Annotated[float, typer.Option(help="--advise: largest strain of these waves.")]
Noise = Annotated[float | None, typer.Option(help="--advise: of REF, if known, grey levels.")]
OptionalOutput = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="OUT", help="Output folder.", parser=folder_name),
]
Region = Annotated[str | None, typer.Option(metavar="X0,Y0,X1,Y1", help="Region of interest, px.")]
Mask = Annotated[Path | None, typer.Option(metavar="IMAGE", help="Black pixels aren't used.")]
UpdateOption = Annotated[
    Update, typer.Option(help="When to renew the reference; auto: as strains get large.")
]
ApartPx = Annotated[
    float, typer.Option(help="Jump within a subset that makes it incoherent, px; or inf.")
]
Formats = Annotated[
    list[Format] | None, typer.Option("--format", help="Of the tables (repeatable).")
]
CalibrationFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Undo the lens: opencv, kalibr, matchid, vic, dice."),
]
RigFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Calibration of two cameras: pictures are pairs."),
]
CalibrationUnit = Annotated[
    LengthUnit | None,
    typer.Option(help="Of a calibration file that doesn't say (Kalibr: m, all others: mm)."),
]


def dic(
    reference: Reference,
    deformed: Deformed = None,
    output: OptionalOutput = None,
    advise: Advise = False,
    detail_px: DetailPx = None,
    peak_strain: PeakStrain = 0.002,
    noise: Noise = None,
    subset: Annotated[int, typer.Option(help="Odd width of the subsets, px.")] = 31,
    step: Annotated[int, typer.Option(help="Distance of the points, px.")] = 10,
    shape: Annotated[Shape, typer.Option(help="How a subset may deform.")] = "affine",
    roi: Region = None,
    mask: Mask = None,
    calibration: CalibrationFile = None,
    stereo: RigFile = None,
    calibration_unit: CalibrationUnit = None,
    update: UpdateOption = "never",
    start: Annotated[Start, typer.Option(help="How the motion is found first.")] = "auto",
    search_px: Annotated[int, typer.Option(help="Reach of the search, px.")] = 20,
    blur_px: Annotated[float, typer.Option(help="Gaussian over the pictures first, px.")] = 0.0,
    min_zncc: Annotated[float, typer.Option(help="Least correlation of a match.")] = 0.8,
    apart_px: ApartPx = 0.1,
    tolerance: Annotated[float, typer.Option(help="Where the iteration stops, px.")] = 1e-4,
    strain: Annotated[
        Literal[StrainKind, "none"], typer.Option(help="Which strain.")
    ] = "green-lagrange",
    strain_window: Annotated[int, typer.Option(help="Points across the strain gauge.")] = 5,
    formats: Formats = None,
    backend: BackendOption = "auto",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Measure how pictures moved against the first one: displacement and strain (DIC).

    gpusim dic ref.tif load_*.tif -o out --subset 31 --step 10

    gpusim dic film.mkv#1 film.mkv -o out

    gpusim dic ref.tif load_*.tif -o out --calibration camera.yml     (in px without distortion)

    gpusim dic --stereo rig.caldat left0.tif right0.tif left1.tif right1.tif … -o out     (in mm)

    gpusim dic --advise ref.tif     (which settings? with -o a page that says why)
    """
    with exit_codes(), options_named():
        if advise:
            stills = deformed or []
            require(len(stills) <= 1, "--advise", f"{len(stills)} stills", "at most one")
            _advise(
                reference, output, as_json, still=next(iter(stills), None), mask=mask,
                roi=roi_of(roi), noise=noise, detail_px=detail_px, peak_strain=peak_strain,
                backend=backend,
            )  # fmt: skip
            return
        if not deformed or output is None:
            missing = "--output" if deformed else "DEF..."
            raise InputError(
                f"{missing}: missing; expected REF DEF... -o OUT (of a video FILM#1 FILM), or "
                "--advise REF"
            )
        with importing():
            from gpusim.applications import CorrelationSettings
        settings = CorrelationSettings(
            subset=subset, step=step, shape=shape, roi=roi_of(roi), mask=mask,
            calibration=calibration, calibration_unit=calibration_unit, update=update, start=start,
            search_px=search_px, blur_px=blur_px, min_zncc=min_zncc, apart_px=apart_px,
            tolerance=tolerance, strain=strain, strain_window=strain_window, backend=backend,
            formats=tuple(one.value for one in formats or [Format.csv]),
        )  # fmt: skip
        _correlate([reference, *deformed], stereo, output, settings, quiet=quiet, as_json=as_json)


def calibrate(
    images: Annotated[
        list[Path], typer.Argument(metavar="IMAGES...", help="Pictures of a board, or a folder.")
    ],
    output: Output,
    board: Annotated[str, typer.Option(metavar="COLSxROWS", help="Fields, not inner corners.")],
    square_mm: Annotated[float, typer.Option(help="Side of a field.")],
    kind: Annotated[Board, typer.Option(help="What is on the board.")] = "chessboard",
    marker_mm: Annotated[
        float | None, typer.Option(help="Side of a marker of a ChArUco board.")
    ] = None,
    dictionary: Annotated[str, typer.Option(help="Of its markers, as OpenCV says.")] = "4X4_50",
    others: Annotated[
        list[Path] | None,
        typer.Option("--with", metavar="FOLDER", help="One more camera's pictures (repeatable)."),
    ] = None,
    lens: Annotated[LensModel, typer.Option(help="Which distortion is found.")] = "brown",
    square_pixels: Annotated[
        bool, typer.Option("--square-pixels", help="One focal length for both directions.")
    ] = False,
    formats: Annotated[
        list[str] | None,
        typer.Option("--format", help="opencv, kalibr, matchid, vic, dice (repeatable)."),
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Calibrate one camera or a rig from pictures of a chessboard or a ChArUco board.

    gpusim calibrate left/ --with right/ --board 9x8 --square-mm 40 -o out --format matchid

    gpusim calibrate photos/ --kind charuco --board 7x5 --square-mm 30 --marker-mm 22 -o out
    """
    with exit_codes(), options_named():
        with importing():
            from gpusim.applications import calibrate_files

        pictures = [images, *([folder] for folder in others or [])]
        target = _board(board, square_mm, kind, marker_mm, dictionary)
        options: dict[str, Any] = {"lens": lens, "formats": formats or ["opencv"]}
        done = calibrate_files(pictures, target, output, square_pixels=square_pixels, **options)
        text = json.dumps(done.content, indent=2)
        finish(text, as_json, quiet, partial(print_calibration, done.report, output))


def _correlate(
    pictures: list[Path],
    stereo: Path | None,
    output: Path,
    settings: CorrelationSettings,
    *,
    quiet: bool,
    as_json: bool,
) -> None:
    from gpusim.applications import correlate_files, correlate_pairs

    lefts, rights = ([], []) if stereo is None else _pairs(pictures)
    with ProgressDisplay(quiet, stream_is_result=as_json) as progress:
        if stereo is None:
            done = correlate_files(
                pictures[0], pictures[1:], output, settings, progress=progress, keep_results=False
            )
        else:
            done = correlate_pairs(
                lefts, rights, stereo, output, settings, progress=progress, keep_results=False
            )
    tell(done, output, quiet, as_json)


def tell(done: CorrelationOutput, output: Path, quiet: bool, as_json: bool) -> None:
    """Print what was measured; NotConverged if nothing was in a picture."""
    text = json.dumps(done.report, indent=2)
    finish(text, as_json, quiet, partial(print_correlation, done.report, output))
    if done.failure:
        raise NotConverged(done.failure)


def _advise(picture: Path, output: Path | None, as_json: bool, **options: Any) -> None:
    with importing():
        from gpusim.applications import advise_files
    report = advise_files(picture, output, **options)
    finish(json.dumps(report, indent=2), as_json, False, partial(print_advice, report, output))


OPTIONS = {"formats": "format", "rig": "stereo", "points": "point", "markers_px": "markers"}
"""Options that have another name than the argument of the application."""


@contextmanager
def options_named() -> Iterator[None]:
    """Errors name options, where those of the applications name `arguments`."""
    try:
        yield
    except InputError as error:

        def option(found: re.Match[str]) -> str:
            return "--" + OPTIONS.get(found[1], found[1]).replace("_", "-")

        raise InputError(re.sub(r"`(\w+)`", option, str(error))) from error


def _pairs(files: list[Path]) -> tuple[list[Path], list[Path]]:
    """Pictures of the left and of the right camera."""
    expected = "pairs: LEFT_REF RIGHT_REF LEFT_1 RIGHT_1 …"
    require(len(files) % 2 == 0, "--stereo", f"{len(files)} pictures", expected)
    return files[::2], files[1::2]


def numbers_of(option: str, text: str, expected: str, count: int = 2) -> Any:
    """So many numbers with commas between."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count:
        raise InputError(f"{option}: got {text!r}; expected {expected}")
    return values


def roi_of(text: str | None) -> tuple[int, int, int, int] | None:
    if text is None:
        return None
    try:
        x0, y0, x1, y1 = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--roi: got {text!r}; expected X0,Y0,X1,Y1 in whole pixels") from None
    return x0, y0, x1, y1


def _board(
    fields: str, square_mm: float, kind: Board, marker_mm: float | None, dictionary: str
) -> measure.Chessboard | measure.CharucoBoard:
    from gpusim import measure

    match = re.fullmatch(r"(\d+)[xX](\d+)", fields)
    if not match:
        raise InputError(f"--board: got {fields!r}; expected fields, COLUMNSxROWS like 9x8")
    columns, rows = int(match[1]), int(match[2])
    if kind == "chessboard":
        if marker_mm is not None:
            raise InputError("--marker-mm: a chessboard has no markers; expected --kind charuco")
        return measure.Chessboard(columns, rows, square_mm)
    if marker_mm is None:
        raise InputError("--marker-mm: missing; a ChArUco board needs the side of its markers")
    return measure.CharucoBoard(columns, rows, square_mm, marker_mm, dictionary)
