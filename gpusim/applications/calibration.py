"""Cameras calibrated from pictures of a chessboard or a ChArUco board, and what is written."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim._version import __version__
from gpusim.errors import InputError
from gpusim.export.calibrated_cameras import scene_cameras
from gpusim.field_summary import field_summary
from gpusim.files.atomic_files import PathLike, write_text
from gpusim.files.frame_source import Frames, FrameSource, picture_paths, read_frames
from gpusim.files.output_folder import claim, inside
from gpusim.measure.calibration.bundle_adjustment import LENSES
from gpusim.measure.targets.board_detection import find_board
from gpusim.measure.targets.boards import Board
from gpusim.optics.calibration.formats import COEFFICIENTS, FORMATS, calibration_text
from gpusim.report import Link, Report, Table, write_report
from gpusim.report.measurement_figures import RigCamera, draw_calibration
from gpusim.validation import require_one_of

Image = npt.NDArray[Any]


@dataclass(frozen=True)
class CalibrationOutput:
    """Cameras that have been calibrated, and the files that were written.

    Attributes
    ----------
    calibration : the cameras with their uncertainties; lengths in mm.
    content : what calibration.json holds.
    report : what report.html shows.
    files : calibration.json, a file for each other program, report.json, report.html, figures.
    missed : pictures that weren't used, each with the reason.

    Examples
    --------
    >>> board = gs.measure.Chessboard(7, 6, 30.0)
    >>> pictures = [f"board-{number}.png" for number in range(4)]
    >>> done = gs.applications.calibrate_files([pictures], board, "rig", lens="pinhole")
    >>> done.missed, len(done.calibration.cameras)
    ([], 1)
    """

    calibration: measure.Calibration
    content: dict[str, Any]
    report: Report
    files: Sequence[Path]
    missed: Sequence[str]
    __repr__ = field_summary


def calibrate_files(
    pictures: str | os.PathLike[str] | Image | FrameSource | Sequence[Frames | FrameSource],
    board: Board,
    output: PathLike,
    *,
    lens: str = "brown",
    square_pixels: bool = False,
    formats: Sequence[str] = ("opencv",),
) -> CalibrationOutput:
    """Calibrate and write ``calibration.json``, files for other programs, and ``report.html``.

    Parameters
    ----------
    pictures : a folder, a stack or a sequence of one camera; or a list with what ``read_frames``
        takes for each camera. Pictures k of all cameras show the same pose of the board.
    board : a ``measure.Chessboard`` or ``measure.CharucoBoard``, lengths in mm.
    output : a folder, made if need be.
    lens, square_pixels : as in ``measure.calibrate``.
    formats : of files for other programs: opencv, kalibr, matchid, vic, dice.

    Raises
    ------
    InputError
        What can't be read or calibrated, or has no place in one of the ``formats``.

    Examples
    --------
    >>> board = gs.measure.Chessboard(7, 6, 30.0)
    >>> pictures = [f"board-{number}.png" for number in range(4)]
    >>> done = gs.applications.calibrate_files([pictures], board, "camera", lens="pinhole")
    >>> [path.name for path in done.files[:2]], done.calibration.rms < 0.05
    (['calibration.json', 'calibration-opencv.yml'], True)
    """
    with claim(output):
        folder = Path(output)
        for name in formats:
            require_one_of("`formats`", name, FORMATS)
        single = isinstance(pictures, str | os.PathLike | np.ndarray | FrameSource)
        sources: Any = [pictures] if single else pictures
        frames = {f"camera-{k}": _frames(source) for k, source in enumerate(sources, start=1)}
        counts = {name: len(one) for name, one in frames.items()}
        if len(set(counts.values())) > 1:
            raise InputError(f"calibrate: got pictures {counts}; expected as many of every camera")
        _check_formats(formats, lens, len(frames))
        seen = {name: _sightings(one, board) for name, one in frames.items()}
        missed = [
            f"{Path(picture).name}: {sighting.problem}"
            for name, one in frames.items()
            for picture, sighting in zip(one.names, seen[name], strict=True)
            if sighting.problem
        ]
        found = measure.calibrate(seen, lens=lens, square_pixels=square_pixels)
        content = _content(found, seen, frames, board)
        text = json.dumps(content, indent=1)
        cameras = scene_cameras(found.cameras)
        files = [write_text(inside(folder, "calibration.json"), text + "\n")]
        for name in formats:
            path = inside(folder, f"calibration-{name}{FORMATS[name].ending}")
            files.append(
                write_text(path, calibration_text(cameras, name, FORMATS[name].unit, path.name))
            )
        report = _report(found, seen, missed, files, folder)
        paths = write_report(report, folder)
        files += [paths.json, paths.html, *paths.figures]
        return CalibrationOutput(found, content, report, files, missed)


def _check_formats(formats: Sequence[str], lens: str, cameras: int) -> None:
    """Refuse a format that has no place for the lens, before the work and not after it."""
    for name in formats:
        own = FORMATS[name]
        able = [one for one in LENSES if cameras <= own.most and set(LENSES[one]) <= set(own.lens)]
        if lens in LENSES and lens not in able:
            raise InputError(
                f"`formats` {name}: can't hold {cameras} camera{'s'[: cameras > 1]} with `lens` "
                f"{lens}; expected " + (f"`lens` {' or '.join(able)}" if able else "another format")
            )


def _frames(source: Frames | FrameSource) -> FrameSource:
    """Pictures of one camera; of a run's own folder of images those that show a board."""
    if isinstance(source, FrameSource | np.ndarray):
        return read_frames(source)
    parts: list[Any] = []
    for part in [source] if isinstance(source, str | os.PathLike) else source:
        if isinstance(part, np.ndarray):
            parts.append(part)
        else:
            parts += picture_paths(part, "calibrate", boards=True)
    return read_frames(parts)


def _sightings(frames: FrameSource, board: Board) -> list[measure.Sighting]:
    """What each picture shows of the board. All are of one size, and the board isn't misread."""
    image, name = frames[0], Path(frames.names[0]).name
    shape = image.shape
    first = find_board(image, board)
    if first.problem:
        _check_reading(name, image, board)

    def sighting(number: int) -> measure.Sighting:
        image = frames[number]
        if image.shape != shape:
            raise InputError(
                f"calibrate: {frames.names[number]}: got {image.shape[1]}x{image.shape[0]} px; "
                f"expected {shape[1]}x{shape[0]} as {name}: pictures of one camera have one size"
            )
        return find_board(image, board)

    with ThreadPoolExecutor(max_workers=2) as pool:
        rest = [pool.submit(sighting, number) for number in range(1, len(frames))]
        try:
            return [first, *(one.result() for one in rest)]
        except InputError:
            pool.shutdown(cancel_futures=True)
            raise


def _check_reading(name: str, image: npt.NDArray[Any], board: Board) -> None:
    """Refuse a board that counts inner corners, as OpenCV does, if the picture shows it so."""
    try:
        other = replace(board, columns=board.columns + 1, rows=board.rows + 1)
    except InputError:  # more markers than the dictionary has
        return
    if not find_board(image, other).problem:
        raise InputError(
            f"`board`: got {board.columns}x{board.rows}; {name} shows {other.columns}x{other.rows} "
            f"fields, which have {board.columns}x{board.rows} inner corners; expected fields: "
            f"`board` {other.columns}x{other.rows}"
        )


def _board_notes(board: Board) -> dict[str, Any]:
    fields = {"fields": f"{board.columns}x{board.rows}", "square_mm": board.square}
    if isinstance(board, measure.Chessboard):
        return {"kind": "chessboard"} | fields
    markers = {"marker_mm": board.marker, "dictionary": board.dictionary}
    return {"kind": "charuco"} | fields | markers


def _content(
    found: measure.Calibration,
    seen: dict[str, list[measure.Sighting]],
    frames: Mapping[str, FrameSource],
    board: Board,
) -> dict[str, Any]:
    names = [f"{kind} {number} {name}" for kind, number, name in found.names]
    inner = [i for i, (kind, _, _) in enumerate(found.names) if kind != "view"]
    content: dict[str, Any] = {
        "schema": 1,
        "version": __version__,
        "board": _board_notes(board),
        "lens": found.lens,
        "rms_px": found.rms,
        "points": found.used,
        "outliers": found.outliers,
        "cameras": [],
        "parameters": [names[i] for i in inner],
        "covariance": found.covariance[np.ix_(inner, inner)].tolist(),
    }
    for k, own in enumerate(found.cameras):
        views = zip(frames[own.name].names, found.view_rms[k], seen[own.name], strict=True)
        entry = {
            "name": own.name,
            "resolution_px": list(own.resolution),
            "K": own.K.tolist(),
            "distortion": own.distortion.tolist(),
            "camera_from_first_mm": own.camera_from_rig.tolist(),
            "sigma": own.sigma,
            "rms_px": own.rms,
            "images": [
                {"file": Path(file).name, "rms_px": float(rms) if np.isfinite(rms) else None,
                 "points": len(sighting), "problem": sighting.problem}
                for file, rms, sighting in views
            ],
        }  # fmt: skip
        if k:
            entry["baseline_mm"], entry["baseline_sigma_mm"] = found.baseline(k)
            entry["angle_deg"], entry["angle_sigma_deg"] = np.degrees(found.angle(k)).tolist()
        content["cameras"].append(entry)
    return content


def _report(
    found: measure.Calibration,
    seen: dict[str, list[measure.Sighting]],
    missed: Sequence[str],
    files: Sequence[Path],
    folder: Path,
) -> Report:
    facts = {}
    table = rig_table(found)
    for own in found.cameras:
        statistics = measure.target_statistics(seen[own.name])
        facts[f"{own.name}: images"] = (
            f"{statistics.found} of {statistics.images}; corners {100 * statistics.share:.1f} %, "
            f"blur {statistics.blur:.2f} px, {100 * statistics.covered:.0f} % of the picture"
        )
    cameras = [
        RigCamera(own.name, np.zeros(3), np.zeros(3), points, gaps, own.resolution)
        for own, points, gaps in zip(found.cameras, found.points, found.residuals, strict=True)
    ]
    path = inside(folder, "figures", "calibration.png")
    return Report(
        scene="Calibration",
        adapter="not needed",
        status="done",
        warnings=tuple(f"not used: {text}" for text in missed),
        highlights={
            "Reprojection error": (f"{found.rms:.4f} px", f"RMS over {found.used} points"),
            "Views": (str(found.view_rms.shape[1]), f"{len(found.cameras)} cameras"),
            "Left out": (str(found.outliers), "points far from where they should be"),
        },
        facts=facts,
        tables=(table,),
        figures=(partial(draw_calibration, cameras, found.view_rms, path),),
        links=tuple(Link(file.name, file) for file in files),
    )


UNITS = {"fx": "px", "fy": "px", "cx": "px", "cy": "px"}


def stated(value: float, sigma: float, unit: str = "") -> str:
    """``value ± sigma unit`` with two figures of the uncertainty, and the value to its last."""
    if not (math.isfinite(sigma) and sigma > 0):
        return f"{value:.7g} {unit}".rstrip()
    places = min(max(1 - math.floor(math.log10(sigma)), 0), 12)
    return f"{value:.{places}f} ± {sigma:.{places}f} {unit}".rstrip()


def rig_table(found: measure.Calibration) -> Table:
    """Focal lengths, centre, lens and place of every camera, with standard uncertainties.

    Parameters that the lens model holds at zero have no row.
    """
    rows: dict[str, list[str]] = {}
    for k, own in enumerate(found.cameras):
        values = dict(fx=own.K[0, 0], fy=own.K[1, 1], cx=own.K[0, 2], cy=own.K[1, 2])
        values |= dict(zip(COEFFICIENTS, own.distortion, strict=True))
        for name, value in values.items():
            sigma = own.sigma.get(name, own.sigma.get("f") if name in ("fx", "fy") else None)
            if sigma is not None:
                cells = rows.setdefault(name, [""] * len(found.cameras))
                cells[k] = stated(value, sigma, UNITS.get(name, ""))
        if k:
            length, angle = found.baseline(k), np.degrees(found.angle(k))
            for name, cell in (
                ("distance to the first", stated(length[0], length[1], "mm")),
                ("angle to the first", stated(float(angle[0]), float(angle[1]), "deg")),
            ):
                rows.setdefault(name, [""] * len(found.cameras))[k] = cell
    return Table(
        "Cameras",
        ("parameter", *(own.name for own in found.cameras)),
        tuple((name, *cells) for name, cells in rows.items()),
    )
