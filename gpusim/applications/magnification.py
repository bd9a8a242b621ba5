"""A video in which the motions of some frequencies are larger."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpusim.applications.correlation_output import Progress, silent
from gpusim.applications.identification import timed
from gpusim.errors import require
from gpusim.export.video import DEPTHS, WRITERS, VideoSink
from gpusim.files.atomic_files import PathLike
from gpusim.files.frame_source import VIDEOS, Frames, FrameSource
from gpusim.files.output_folder import inside
from gpusim.measure import magnify
from gpusim.measure.vibration.sampling import sampling_rate

PREVIEWS = (".mp4", ".gif")  # of 8 bits, as bright as the depth of a film's first picture allows


def magnify_files(
    video: Frames | FrameSource,
    output: PathLike,
    band_Hz: tuple[float, float],
    factor: float,
    *,
    rate_Hz: float | None = None,
    progress: Progress = silent,
) -> Path:
    """Write a video in which motions of some frequencies are ``factor`` times as large.

    Parameters
    ----------
    video : as ``read_frames`` takes it: a file, a folder, arrays of uint8 or uint16.
    output : ``film.mkv`` or anything else that `VideoSink` writes; or a folder, for PNG.
    band_Hz, factor : as in ``measure.magnify``.
    rate_Hz : pictures a second, if the video doesn't say, or says wrong.
    progress : called with ("magnify", how much is done 0..1, a text).

    Examples
    --------
    >>> film = np.full((70, 60, 80), 90, np.uint8)
    >>> gs.applications.magnify_files(film, "large.mkv", (20, 40), 20, rate_Hz=200).name
    'large.mkv'
    """
    source = timed(video, rate_Hz)
    path = Path(output)
    suffix = path.suffix.lower()
    expected = f"a folder, or one of {', '.join(WRITERS)}"
    require(suffix not in VIDEOS.keys() - WRITERS.keys(), "output", path.name, expected)
    if suffix not in WRITERS:
        path = inside(path, "*.png")
    pictures, bits = magnify(source, band_Hz, factor), None
    if suffix in PREVIEWS:
        brightest = source[0].max()
        bits = next((depth for depth in DEPTHS if brightest < 1 << depth), DEPTHS[-1])
        most = brightest.dtype.type((1 << bits) - 1)
        pictures = (np.minimum(one, most) for one in pictures)
    with VideoSink(path, frame_rate=sampling_rate(source.times), bits=bits) as sink:
        for number, (picture, time) in enumerate(zip(pictures, source.times, strict=True)):
            sink.append(picture, float(time))
            progress("magnify", (number + 1) / len(source), f"frame {number + 1} of {len(source)}")
    return path
