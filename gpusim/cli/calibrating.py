"""``gpusim calibrate``: cameras calibrated from pictures of a chessboard or a ChArUco board."""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim._version import __version__
from gpusim.cli.console import Destination, out
from gpusim.errors import InputError
from gpusim.files.atomic_files import atomic_path, write_text
from gpusim.files.output_folder import inside
from gpusim.files.picture_file import pages_of, picture_file, read_grey
from gpusim.measure.calibration.bundle_adjustment import LENSES
from gpusim.optics.calibration.formats import write_calibration
from gpusim.optics.camera.pinhole import Camera
from gpusim.report import Link, Report, Table, write_report
from gpusim.report.measurement_figures import RigCamera, draw_calibration

__all__ = ["Settings", "calibrate_files", "stated"]

Board = measure.Chessboard | measure.CharucoBoard

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")
BOARD_FRAMES = "calib-"  # as runs name the pictures of a [calibration]
ENDINGS = {
    "opencv": "yml", "kalibr": "yaml", "matchid": "caldat", "vic": "xml", "dice": "xml",
}  # fmt: skip


@dataclass(frozen=True)
class Settings:
    """What the command line says beside the pictures."""

    board: str
    square_mm: float
    kind: str
    marker_mm: float | None
    dictionary: str
    lens: str
    square_pixels: bool
    formats: tuple[str, ...]


def calibrate_files(
    first: Sequence[Path],
    others: Sequence[Path],
    settings: Settings,
    destination: Destination,
) -> None:
    """Calibrate and write ``calibration.json``, files for other programs, and ``report.html``.

    ``first`` are pictures, or a folder of them; every path of ``others`` is the folder of one more
    camera, whose pictures in the order of their names belong to those of the first. Raises
    InputError for what can't be read or calibrated.
    """
    board, folder = _board(settings), destination.folder
    unknown = [name for name in settings.formats if name not in ENDINGS]
    if unknown:
        raise InputError(f"--format: got {unknown[0]!r}; expected one of {', '.join(ENDINGS)}")
    pictures = {"camera-1": _pictures(first)}
    for number, path in enumerate(others, start=2):
        pictures[f"camera-{number}"] = _pictures([path])
    counts = {name: len(files) for name, files in pictures.items()}
    if len(set(counts.values())) > 1:
        raise InputError(f"calibrate: got pictures {counts}; expected as many of every camera")
    _check_formats(settings, len(pictures))
    seen = {name: _sightings(files, board) for name, files in pictures.items()}
    missed = [
        f"{file.name}: {sighting.problem}"
        for name, files in pictures.items()
        for file, sighting in zip(files, seen[name], strict=True)
        if sighting.problem
    ]
    found = measure.calibrate(seen, lens=settings.lens, square_pixels=settings.square_pixels)
    content = _content(found, seen, pictures, settings)
    files = [write_text(inside(folder, "calibration.json"), json.dumps(content, indent=1) + "\n")]
    for name in settings.formats:
        path = inside(folder, f"calibration-{name}.{ENDINGS[name]}")
        with atomic_path(path) as part:
            write_calibration(part, _cameras(found), name, "mm" if name == "opencv" else None)
        files.append(path)
    report = _report(found, seen, missed, files, folder)
    write_report(report, folder)
    if destination.as_json:
        out(json.dumps(content, indent=2))
    elif not destination.quiet:
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


def _check_formats(settings: Settings, cameras: int) -> None:
    """Refuse a format that has no place for the lens, before the work and not after it."""
    for name in settings.formats:
        able = [lens for lens in LENSES if _holds(name, lens, cameras)]
        if settings.lens in LENSES and settings.lens not in able:
            raise InputError(
                f"--format {name}: can't hold {cameras} camera{'s'[: cameras > 1]} with --lens "
                f"{settings.lens}; expected "
                + (f"--lens {' or '.join(able)}" if able else "another format")
            )


def _holds(name: str, lens: str, cameras: int) -> bool:
    """Whether a format takes so many cameras with all the coefficients of a lens."""
    free = LENSES[lens]
    distortion = np.zeros(14)
    distortion[list(free)] = 1e-3
    used = next(count for count in (5, 8, 12, 14) if not free or max(free) < count)
    K, pose = np.array([[1e3, 0, 320], [0, 1e3, 240], [0, 0, 1]]), np.eye(4)
    rig = []
    for number in range(cameras):
        pose = pose.copy()
        pose[0, 3] = -float(number)
        rig.append(Camera(640, 480, K, distortion[:used], pose, f"camera-{number + 1}"))
    with tempfile.TemporaryDirectory() as folder:
        try:
            write_calibration(Path(folder) / f"probe.{ENDINGS[name]}", rig, name)
        except InputError:
            return False
    return True


def _board(settings: Settings) -> Board:
    match = re.fullmatch(r"(\d+)[xX](\d+)", settings.board)
    if not match:
        raise InputError(f"--board: got {settings.board!r}; expected fields, COLUMNSxROWS like 9x8")
    columns, rows = int(match[1]), int(match[2])
    if settings.kind == "chessboard":
        if settings.marker_mm is not None:
            raise InputError("--marker-mm: a chessboard has no markers; expected --kind charuco")
        return measure.Chessboard(columns, rows, settings.square_mm)
    if settings.marker_mm is None:
        raise InputError("--marker-mm: missing; a ChArUco board needs the side of its markers")
    return measure.CharucoBoard(
        columns, rows, settings.square_mm, settings.marker_mm, settings.dictionary
    )


def _pictures(paths: Sequence[Path]) -> list[Path]:
    """Files as given, with all pages of a stack; folders as the pictures in them by name."""
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            own = sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES)
            # a run's own folder of images: the frames of the scene show no board
            own = [p for p in own if p.name.startswith(BOARD_FRAMES)] or own
            if not own:
                raise InputError(f"calibrate: {path}: no pictures ({', '.join(SUFFIXES)})")
            files += own
        elif picture_file(path)[0].exists():
            files += pages_of(path)
        else:
            raise InputError(f"calibrate: {path}: not found")
    return files


def _sightings(files: Sequence[Path], board: Board) -> list[measure.Sighting]:
    """What each picture shows of the board. All are of one size, and the board isn't misread."""
    image = read_grey(files[0])
    shape = image.shape
    first = _found(image, board)
    if first.problem:
        _check_reading(files[0], image, board)

    def sighting(file: Path) -> measure.Sighting:
        image = read_grey(file)
        if image.shape != shape:
            raise InputError(
                f"calibrate: {file}: got {image.shape[1]}x{image.shape[0]} px; expected "
                f"{shape[1]}x{shape[0]} as {files[0].name}: pictures of one camera have one size"
            )
        return _found(image, board)

    with ThreadPoolExecutor(max_workers=2) as pool:
        rest = [pool.submit(sighting, file) for file in files[1:]]
        try:
            return [first, *(one.result() for one in rest)]
        except InputError:
            pool.shutdown(cancel_futures=True)
            raise


def _found(image: npt.NDArray[Any], board: Board) -> measure.Sighting:
    if isinstance(board, measure.CharucoBoard):
        return measure.find_charuco(image, board)
    return measure.find_chessboard(image, board)


def _check_reading(file: Path, image: npt.NDArray[Any], board: Board) -> None:
    """Refuse a --board that counts inner corners, as OpenCV does, if the picture shows it so."""
    try:
        other = replace(board, columns=board.columns + 1, rows=board.rows + 1)
    except InputError:  # more markers than the dictionary has
        return
    if not _found(image, other).problem:
        raise InputError(
            f"--board: got {board.columns}x{board.rows}; {file.name} shows {other.columns}x"
            f"{other.rows} fields, which have {board.columns}x{board.rows} inner corners; expected "
            f"fields: --board {other.columns}x{other.rows}"
        )


def _cameras(found: measure.Calibration) -> list[Camera]:
    """The rig with the first camera at the origin; lengths in metres."""
    cameras = []
    for own in found.cameras:
        pose = own.camera_from_rig.copy()
        pose[:3, 3] /= 1000.0
        width, height = own.resolution
        used = 14 if own.distortion[8:].any() else 8 if own.distortion[5:].any() else 5
        cameras.append(Camera(width, height, own.K, own.distortion[:used], pose, own.name))
    return cameras


def _board_notes(settings: Settings) -> dict[str, Any]:
    notes = {"kind": settings.kind, "fields": settings.board, "square_mm": settings.square_mm}
    if settings.kind == "charuco":
        notes |= {"marker_mm": settings.marker_mm, "dictionary": settings.dictionary}
    return notes


def _content(
    found: measure.Calibration,
    seen: dict[str, list[measure.Sighting]],
    pictures: dict[str, list[Path]],
    settings: Settings,
) -> dict[str, Any]:
    names = [f"{kind} {number} {name}" for kind, number, name in found.names]
    inner = [i for i, (kind, _, _) in enumerate(found.names) if kind != "view"]
    content: dict[str, Any] = {
        "schema": 1,
        "version": __version__,
        "board": _board_notes(settings),
        "lens": found.lens,
        "rms_px": found.rms,
        "points": found.used,
        "outliers": found.outliers,
        "cameras": [],
        "parameters": [names[i] for i in inner],
        "covariance": found.covariance[np.ix_(inner, inner)].tolist(),
    }
    for k, own in enumerate(found.cameras):
        views = zip(pictures[own.name], found.view_rms[k], seen[own.name], strict=True)
        entry = {
            "name": own.name,
            "resolution_px": list(own.resolution),
            "K": own.K.tolist(),
            "distortion": own.distortion.tolist(),
            "camera_from_first_mm": own.camera_from_rig.tolist(),
            "sigma": own.sigma,
            "rms_px": own.rms,
            "images": [
                {"file": file.name, "rms_px": float(rms) if np.isfinite(rms) else None,
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
COEFFICIENTS = tuple("k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y".split())


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
