"""Modes identified in a video, and what was found written as tables and pictures."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gpusim._version import __version__
from gpusim.applications.correlation_output import Progress, silent
from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.files.atomic_files import PathLike, atomic_path, write_text
from gpusim.files.frame_source import Frames, FrameSource, read_frames
from gpusim.files.hdf5_file import writing_hdf5
from gpusim.files.output_folder import claim, delete, inside
from gpusim.measure import OperationalModes, PointSeries, grid_points, identify_modes, point_series
from gpusim.measure.correlation.matching import Status
from gpusim.measure.images import Image, check_image
from gpusim.measure.vibration.identification import Excitation, Identification, identifiable_band
from gpusim.measure.vibration.operational_modes import amplitudes
from gpusim.measure.vibration.point_series import DisplacementMethod
from gpusim.report import Overlay
from gpusim.report.figures import draw_overlay
from gpusim.validation import Count, Positive, checked

OTHERS, MOST_SIGMA = 8, 0.05  # pictures that tell the noise; px, of points of a grid
SCHEMA = 1


@checked
@dataclass(frozen=True)
class IdentificationSettings:
    """How modes are identified; meanings as in ``point_series`` and ``identify_modes``.

    Attributes
    ----------
    points : (P, 2) x, y px; None: a grid.
    grid : points along the longer side of the grid.
    roi : (x0, y0, x1, y1) px of the grid; None: all of the picture.
    displacements : "lucas-kanade", "gradient" or "phase".
    rate_Hz : pictures a second, if the video doesn't say, or says wrong; a camera of 2000 pictures
        a second may write a file that is played at 25.

    Examples
    --------
    >>> gs.applications.IdentificationSettings(grid=12, band_Hz=(5, 60)).modes
    3
    """

    points: Any = None
    grid: Count = 24
    roi: tuple[int, int, int, int] | None = None
    displacements: DisplacementMethod = "lucas-kanade"
    subset: int = 21
    rate_Hz: Positive | None = None
    band_Hz: tuple[float, float] | None = None
    modes: Count = 3
    method: Identification = "ssi"
    excitation: Excitation = "ambient"
    __repr__ = field_summary


@dataclass(frozen=True)
class IdentificationOutput:
    """Displacements, modes, what report.json holds, and the files that were written.

    Examples
    --------
    >>> times = np.arange(200) / 100
    >>> y, x = np.mgrid[:50, :60]
    >>> wave = np.exp(-times) * np.sin(2 * np.pi * 12 * times)
    >>> film = [90 + 40 * np.sin((x - one) / 3) * np.cos(y / 4) for one in wave]
    >>> settings = gs.applications.IdentificationSettings(
    ...     grid=3, rate_Hz=100, modes=1, excitation="release")
    >>> done = gs.applications.identify_files(np.array(film), "modes", settings)
    >>> done.modes.frequency_Hz.round(2), [path.name for path in done.files]
    (array([12.]), ['modes.csv', 'shapes.csv', 'modes.h5', 'mode_1.png', 'report.json'])
    """

    series: PointSeries
    modes: OperationalModes
    report: dict[str, Any]
    files: list[Path]
    __repr__ = field_summary


USUAL = IdentificationSettings()


def timed(frames: Frames | FrameSource, rate_Hz: float | None) -> FrameSource:
    """Pictures at the times of their file, or at those of a rate."""
    source = read_frames(frames)
    return source if rate_Hz is None else read_frames(source, np.arange(len(source)) / rate_Hz)


def identify_files(
    video: Frames | FrameSource,
    output: PathLike,
    settings: IdentificationSettings = USUAL,
    *,
    progress: Progress = silent,
) -> IdentificationOutput:
    """Identify modes in a video; write tables and shapes over its first picture.

    ``modes.csv``: frequencies, damping and their standard uncertainties; ``shapes.csv``: of each
    mode and point; ``modes.h5``: these and the displacements of all points, with units and times.

    Parameters
    ----------
    video : as ``read_frames`` takes it: a file, a folder, arrays.
    output : a folder, made if need be.
    settings : how modes are identified.
    progress : called with ("identify", how much is done 0..1, a text).

    Raises
    ------
    InputError
        Files or settings that are wrong; no point measured throughout, no mode in the band.

    Examples
    --------
    >>> y, x = np.mgrid[:50, :60]
    >>> film = [90 + 40 * np.sin((x - np.sin(one)) / 3) * np.cos(y / 4) for one in np.arange(99.0)]
    >>> settings = gs.applications.IdentificationSettings(grid=3, rate_Hz=100, modes=1)
    >>> gs.applications.identify_files(np.array(film), "sway", settings).report["measured"]
    4
    """
    with claim(output):
        source = timed(video, settings.rate_Hz)
        identifiable_band(source.times, settings.band_Hz, settings.method, settings.excitation)
        first = check_image(source[0], source.names[0])
        points = _points(source, first, settings)

        def measured(number: int, displacement: Float) -> None:
            done, text = (number + 1) / len(source), f"frame {number + 1} of {len(source)}"
            progress("identify", done, text)

        series = point_series(
            source, points, method=settings.displacements, subset=settings.subset, progress=measured
        )
        if not series.ok.any():
            lost = ", ".join(f"{count} {reason}" for reason, count in _lost(series).items())
            raise InputError(f"points: none found in all pictures ({lost}); expected at least one")
        modes = identify_modes(
            series, modes=settings.modes, band_Hz=settings.band_Hz, method=settings.method,
            excitation=settings.excitation,
        )  # fmt: skip
        report = _report(source, series, modes, settings)
        folder = Path(output)
        for drawn in folder.glob("mode_[0-9]*.png"):  # of more modes than there are now
            delete(folder, drawn.name)
        files = [
            write_text(inside(folder, "modes.csv"), _table(_mode_columns(modes))),
            write_text(inside(folder, "shapes.csv"), _table(_shape_columns(modes))),
            _write_hdf5(inside(folder, "modes.h5"), series, modes, report),
            *_drawn(folder, first, series, modes),
            write_text(inside(folder, "report.json"), json.dumps(report, indent=2) + "\n"),
        ]  # fmt: skip
        return IdentificationOutput(series, modes, report, files)


def _points(source: FrameSource, first: Image, settings: IdentificationSettings) -> Float:
    """Those of a grid that show where they are by more than noise, if there are any."""
    if settings.points is not None:
        return np.asarray(settings.points, dtype=np.float64)
    height, width = first.shape
    x0, y0, x1, y1 = settings.roi or (0, 0, width - 1, height - 1)
    step = max((max(x1 - x0, y1 - y0) + 1 - settings.subset) // max(settings.grid - 1, 1), 1)
    places = grid_points(first.shape, subset=settings.subset, step=step, roi=settings.roi)
    others = [source[int(k)] for k in np.linspace(1, len(source) - 1, OTHERS)]
    shown = _expected_sigma(first, others, places, settings.subset) <= MOST_SIGMA
    return places[shown] if shown.any() else places


def _expected_sigma(first: Image, others: list[Image], points: Float, subset: int) -> Float:
    """(P,) px, standard uncertainty of a shift in the direction which a subset shows worst: noise
    over slopes that are more than noise. Noise is the least of what changes from the first picture
    to ``others``, and of what is rough in the first (Immerkær 1996): motion changes pictures, fine
    texture is rough."""
    column, row = points.T.astype(np.int64)
    grey = np.asarray(first, dtype=np.float64)

    def mean(values: Float) -> Float:
        return np.asarray(cv2.blur(values, (subset, subset))[row, column])

    changes: list[Float] = [grey - other for other in others if other.shape == grey.shape]
    mixed = np.outer([1, -2, 1], [1, -2, 1]) / np.sqrt(18.0)
    rough: Float = np.asarray(cv2.filter2D(grey, -1, mixed), dtype=np.float64)
    spreads = [mean(one * one) - mean(one) ** 2 for one in [*changes, rough]]
    noise = np.min(spreads, axis=0) / 2
    down, across = (np.asarray(one, dtype=np.float64) for one in np.gradient(grey))
    xx, yy, xy = (
        mean(one * other) for one, other in ((across, across), (down, down), (across, down))
    )
    least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy) - noise / 2  # of noise's own slopes
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.sqrt(noise / least) / subset
    return np.where(least > 0, sigma, np.where(noise > 0, np.inf, 0.0))


def _lost(series: PointSeries) -> dict[str, int]:
    """How many points were first not found for which reason."""
    return dict(Counter(Status(one).name.lower() for one in series.status[~series.ok].tolist()))


def _report(
    source: FrameSource, series: PointSeries, modes: OperationalModes, s: IdentificationSettings
) -> dict[str, Any]:
    """What report.json holds."""
    columns = {name: values.tolist() for name, values in _mode_columns(modes).items()}
    found = len(modes.damping)
    fewer = f"{found} of {s.modes} modes found, with excitation {s.excitation!r}"
    return {
        "schema": SCHEMA,
        "version": __version__,
        "video": source.names[0].removesuffix("#1"),
        "frames": len(source),
        "rate_Hz": series.rate_Hz,
        "points": len(series.points),
        "measured": int(series.ok.sum()),
        "lost": _lost(series),
        "displacements": s.displacements,
        "method": s.method,
        "modes": [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ],
        "warnings": [
            *source.notes,
            *([source.times_guessed] if source.times_guessed else []),
            *([fewer] if found < s.modes else []),
        ],
    }


def _mode_columns(modes: OperationalModes) -> dict[str, Float]:
    names = ("frequency_Hz", "frequency_sigma_Hz", "damping", "damping_sigma", "complexity")
    return {"mode": np.arange(1, len(modes.damping) + 1)} | {n: getattr(modes, n) for n in names}


def _shape_columns(modes: OperationalModes) -> dict[str, Float]:
    count, points = len(modes.damping), len(modes.points)
    shape, sigma = (each.reshape(-1, 2).T for each in (modes.shapes, modes.shape_sigma))
    x, y = np.tile(modes.points, (count, 1)).T
    names = ("mode", "x_px", "y_px", "shape_x", "shape_y", "sigma_x", "sigma_y")
    mode = np.repeat(np.arange(1, count + 1), points)
    return dict(zip(names, (mode, x, y, *shape, *sigma), strict=True))


def _table(columns: Mapping[str, Float]) -> str:
    """CSV with a line of names."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join([",".join(columns), *lines]) + "\n"


def _drawn(
    folder: Path, first: Image, series: PointSeries, modes: OperationalModes
) -> Iterator[Path]:
    """Each shape as arrows over the first picture."""
    sizes = amplitudes(modes.shapes, series.displacement[:, series.ok])
    for number, (size, shape) in enumerate(zip(sizes, modes.shapes, strict=True), 1):
        overlay = Overlay(f"mode {number}", first, modes.points, size * shape)
        yield draw_overlay(overlay, inside(folder, f"mode_{number}.png")).path


def _write_hdf5(
    path: Path, series: PointSeries, modes: OperationalModes, report: Mapping[str, Any]
) -> Path:
    arrays = {
        "times": (series.times, "s"),
        "points": (series.points, "px"),
        "displacement": (series.displacement, "px"),
        "status": (series.status, "1"),
        **{f"modes/{name.removesuffix('_Hz')}": (values, "Hz" if name.endswith("_Hz") else "1")
           for name, values in _mode_columns(modes).items()},
        "modes/points": (modes.points, "px"),
        "modes/shapes": (modes.shapes, "1"),
        "modes/shape_sigma": (modes.shape_sigma, "1"),
    }  # fmt: skip
    with atomic_path(path) as part, writing_hdf5(part) as file:
        for name, (values, unit) in arrays.items():
            file.create_dataset(name, data=values, compression="gzip").attrs["unit"] = unit
        file.attrs["frame"] = "pixels of the first picture, x right, y down"
        file.attrs.update({k: v for k, v in report.items() if isinstance(v, str | int | float)})
    return path
