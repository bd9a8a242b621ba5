"""Markers and points followed through a video, or a pair of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from itertools import tee
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from gpusim.applications.correlation import alike, cameras_of, prepared, undistorted
from gpusim.applications.correlation_output import (
    CorrelationOutput,
    CorrelationSettings,
    Progress,
    ResultWriter,
    silent,
)
from gpusim.applications.identification import timed
from gpusim.arrays.array_types import Float
from gpusim.errors import require
from gpusim.export.correlation import frame_of, result_columns, unit_of, write_columns
from gpusim.files.atomic_files import PathLike
from gpusim.files.frame_source import Frames, FrameSource
from gpusim.files.output_folder import claim, inside
from gpusim.measure import (
    CalibratedCamera,
    DicResult,
    Status,
    StereoResult,
    match_epipolar,
    stereo_shape,
)
from gpusim.measure.correlation.sequence import followed
from gpusim.measure.images import Image, check_image
from gpusim.measure.stereo.stereo_correlation import moved_pairs, paired_result
from gpusim.measure.structures.marker_crosses import CrossFits
from gpusim.measure.structures.marker_series import first_markers, followed_markers
from gpusim.report.charts import Chart, draw_chart
from gpusim.report.model import Figure
from gpusim.report.style import MEASURED, PAGE, draw_png
from gpusim.validation import Positive, as_float64, checked

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

USUAL = CorrelationSettings()
WIDTHS = (10.0, 100.0)  # px of markers, if nobody says
EPIPOLAR_PX = 1.0  # from which on two cameras don't see the same
NO_MARKERS = CrossFits(
    np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0), np.empty(0), np.empty(0, bool)
)
UNTOLD = ("step", "roi", "shape", "strain", "strain_window", "start", "search_px", "update")
COLUMNS = ("x", "y", "u", "v", "sigma", "x_right", "y_right", "X", "Y", "Z", "U", "V", "W",
           "sigma_X", "sigma_Y", "sigma_Z", "status")  # fmt: skip
Result = TypeVar("Result", DicResult, StereoResult)


@checked
def track_files(
    video: Frames | FrameSource,
    output: PathLike,
    settings: CorrelationSettings = USUAL,
    *,
    points: npt.ArrayLike = (),
    markers_px: tuple[float, float] | None = None,
    mm_per_px: Positive | None = None,
    right: Frames | FrameSource | None = None,
    rate_Hz: Positive | None = None,
    progress: Progress = silent,
) -> CorrelationOutput:
    """Follow markers and points through a video; write tables, plots over time and ``report.html``.

    ``tracks.csv`` (or other formats) has a row for each picture and each of them: where it was in
    the first picture, how far it has gone, the standard uncertainty of that; what isn't found is
    empty, with the reason in ``status``, and said.

    Parameters
    ----------
    video : as ``read_frames`` takes it: a file, a folder, a stack, arrays.
    output : a folder, made if need be.
    settings : how the subsets of points are correlated, as in ``correlate_files``; camera or rig.
    points : (N, 2) x, y in the first picture, px.
    markers_px : lowest and highest width of checker markers, all of which are followed; None: 10 to
        100 px if there are no points, else no markers.
    mm_per_px : of a plane that is seen squarely, for displacements in mm.
    right : pictures of a second camera, taken at the same times; with a calibration of both, places
        and displacements are mm in space.
    rate_Hz : pictures a second, if the video doesn't say, or says wrong.
    progress : called with ("track", how much is done 0..1, a text).

    Returns
    -------
    CorrelationOutput
        A result for each picture, the first one included; markers before points, row by row.

    Raises
    ------
    InputError
        Files or settings that are wrong, points outside the picture, no marker in the first one.

    Examples
    --------
    >>> done = gs.applications.track_files(["markers.png", "markers-1.png"], "tracks")
    >>> done.results[1].displacement.round(2) + 0.0, done.files[0].name
    (array([[1.5, 0. ],
           [1.5, 0. ]]), 'tracks.csv')
    """
    with claim(output):
        views = [timed(one, rate_Hz) for one in (video, right) if one is not None]
        counts = [len(view) for view in views]
        require(min(counts) == max(counts), "videos", f"{counts} pictures", "as many of both")
        firsts = [check_image(view[0], view.names[0]) for view in views]
        lenses: list[CalibratedCamera] = []
        if settings.calibration is not None:
            shapes = [first.shape for first in firsts]
            lenses = cameras_of(settings, settings.calibration, shapes, "calibration")
        require(len(lenses) > 0 or right is None, "`calibration`", "none", "one of both cameras")
        given = as_float64(points, "`points`", "x, y of each, px").reshape(-1, 2)
        height, width = firsts[0].shape
        for x, y in given:
            inner = 0 <= x <= width - 1 and 0 <= y <= height - 1
            require(inner, "`points`", f"{x:g},{y:g}", f"places in {width} x {height} px")
        widths = markers_px or (None if len(given) else WIDTHS)
        markers = [NO_MARKERS if widths is None else first_markers(one, widths) for one in firsts]
        options, notes = prepared(firsts[0], views[0].names[0], settings)
        notes = {name: value for name, value in notes.items() if name not in UNTOLD}
        pictures = dict(zip(("video", "right"), views, strict=False))
        writer = ResultWriter(Path(output), firsts[0], pictures, notes, settings.formats, progress)
        for number, result in enumerate(_followed(views, firsts, lenses, markers, given, options)):
            writer.results.append(result)
            writer.sum_up(number, result, None)
            progress("track", (number + 1) / counts[0], f"frame {number + 1} of {counts[0]}")
        return _written(writer, mm_per_px)


def _followed(
    views: Sequence[FrameSource],
    firsts: Sequence[Image],
    lenses: Sequence[CalibratedCamera],
    markers: Sequence[CrossFits],
    points: Float,
    options: dict[str, Any],
) -> Iterator[DicResult | StereoResult]:
    """Markers, then points in each picture, or pair."""
    if len(views) == 1:
        tracks = _tracks(views[0], firsts[0], markers[0], points, options)
        return tracks if not lenses else (undistorted(one, lenses[0])[0] for one in tracks)
    rig, (left, right) = (lenses[0], lenses[1]), markers
    pairs = match_epipolar(*rig, left.points, right.points).pairs
    require(len(pairs) + len(points) > 0, "markers", "none that both cameras see", "some")
    left, right = left.rows(pairs[:, 0]), right.rows(pairs[:, 1])
    sigma, status = np.stack([left.sigma, right.sigma]), np.zeros(len(pairs), np.int8)
    starts = [paired_result(rig, left.points, left.points, right.points, sigma, status, None, 0)]
    seen = points, points
    if len(points):
        starts.append(stereo_shape(firsts[0], firsts[1], rig, points=points, **options))
        seen = starts[1].left[starts[1].ok], starts[1].right[starts[1].ok]
    ones = _tracks(views[0], firsts[0], left, seen[0], options)
    twos = _tracks(views[1], firsts[1], right, seen[1], {**options, "mask": None})
    return moved_pairs(rig, _joined(starts), ones, twos, EPIPOLAR_PX)


def _tracks(
    view: FrameSource, first: Image, markers: CrossFits, points: Float, options: dict[str, Any]
) -> Iterator[DicResult]:
    """Of one camera."""
    pictures = alike(view, first.shape, view.names[0])
    if not len(points):
        return followed_markers(pictures, markers)
    if not len(markers.points):
        return followed(first, pictures, points, **options)
    ours, theirs = tee(pictures)
    both = followed_markers(ours, markers), followed(first, theirs, points, **options)
    return map(_joined, zip(*both, strict=True))


def _joined(results: Sequence[Result]) -> Result:
    """The points of all results, one after the other."""
    arrays = [one.name for one in fields(results[0]) if one.name != "subset"]
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(one, name) for one in results]) for name in arrays
    }
    return replace(results[0], **joined)


def _written(writer: ResultWriter, mm_per_px: float | None) -> CorrelationOutput:
    """Tables, plots and the page."""
    results, folder = writer.results, writer.folder
    tables = [result_columns(one) for one in results]
    columns = {name: np.stack([t[name] for t in tables]) for name in COLUMNS if name in tables[0]}
    if mm_per_px is not None:
        columns |= {name.upper(): mm_per_px * columns[name] for name in "uv"}
    view, lost = writer.pictures["video"], columns["status"] != Status.OK
    frame, item = np.indices(lost.shape)
    rows = {"frame": frame, "time": view.times[frame], "id": item + 1, **columns}
    rows = {name: values.ravel() for name, values in rows.items()}
    writer.files += [
        write_columns(
            inside(folder, f"tracks.{suffix}"), rows, writer.settings, frame_of(results[0])
        )
        for suffix in writer.formats
    ]
    writer.figures.append(_draw_places(inside(folder, "places.png"), writer.reference, columns))
    known = bool(np.isfinite(view.times).all())
    label, x = ("Time (s)", view.times) if known else ("Frame", np.arange(len(view)))
    for name in (one for one in "uvUVW" if one in columns):
        curves = {str(k + 1): values for k, values in enumerate(columns[name].T.tolist())}
        y = f"{name}_{unit_of(name)}"
        chart = Chart(f"{name} over time", "", label, y, x.tolist(), curves)
        writer.figures.append(draw_chart(chart, inside(folder, f"{y}.png")))
    missing = [f"{k + 1} in {n}" for k, n in enumerate(lost.sum(axis=0)) if n]
    text = f"not found in some of {len(lost)} pictures: {', '.join(missing)}"
    return writer.finished([text] if missing else [])


def _draw_places(path: Path, first: Image, columns: Mapping[str, Float]) -> Figure:
    """Numbers over the first picture, and the ways that they went."""
    (x, y), (height, width) = (columns[name] for name in "xy"), first.shape

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.imshow(first, cmap="gray", interpolation="nearest")
        if "u" in columns:
            axes.plot(x + columns["u"], y + columns["v"], color=MEASURED, linewidth=1)
        box = {"facecolor": PAGE, "alpha": 0.6, "pad": 1}
        for number, place in enumerate(zip(x[0], y[0], strict=True), 1):
            axes.annotate(str(number), place, (4, 4), textcoords="offset points", bbox=box)
        axes.set_axis_off()

    draw_png(path, (7.2, 7.2 * min(max(height / width, 0.25), 1.5)), draw)
    return Figure(path, "What was followed", "Numbered over the first picture.", photo=True)
