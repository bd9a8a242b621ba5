"""``[video]``: films of the cameras' pictures, and how fast and how long they are taken."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import Field

from gpusim.scene.tables.table import SeveralNames, Table, tables_of

from .analysis.analysis_table import TABLES
from .camera import CameraTable

VideoFormat = Literal["ffv1", "mraw", "tiff", "png", "mp4"]


class VideoTable(Table):
    """Films of the cameras' pictures, with the time of each frame, and how they are taken.

    Example::

        frame_rate_Hz = 2000.0
        exposure_us = 100.0
        format = "ffv1"
    """

    format: VideoFormat = "ffv1"
    """"ffv1": without loss, video/<camera>.mkv; "mraw": Photron's, video/<camera>.cih; "tiff" or
    "png": pictures in video/<camera>/; "mp4": H.264 of 8 bits, with loss."""
    cameras: SeveralNames | None = None
    """Names of those that film; without it all."""
    frame_rate_Hz: Annotated[float, Field(gt=0)] | None = None
    """How fast frames follow each other: ``analysis.frame_rate_Hz``, said here or there. Of frames
    that aren't in time, modes and phases, how fast the film is to be played."""
    exposure_us: Annotated[float, Field(ge=0)] | None = None
    """The ``shutter.exposure_ms`` of cameras without a ``shutter``."""


def filming(video: VideoTable | None, cameras: Iterable[CameraTable]) -> tuple[str, ...]:
    """Names of the ``cameras`` that film."""
    every = tuple(camera.name for camera in cameras)
    return () if video is None else video.cameras or every


def has_frame_rate(analysis: str) -> bool:
    """Whether frames of a type of analysis are in time."""
    return analysis in TABLES and "frame_rate_Hz" in TABLES[analysis].model_fields


def complete_from_video(document: dict[str, Any], earlier: Any = None) -> None:
    """Put the frame rate and the exposure of [video] where tables don't say their own, in place.

    ``earlier``: [video] before it was overridden; what tables have from there gives way.
    """
    video = document.get("video")
    if not isinstance(video, dict):
        return
    earlier = earlier if isinstance(earlier, dict) else {}
    rate, exposure = video.get("frame_rate_Hz"), video.get("exposure_us")
    analysis = document.setdefault("analysis", {})
    if rate is not None and isinstance(analysis, dict):
        kind = analysis.get("type", "static")
        if isinstance(kind, str) and has_frame_rate(kind):
            own = analysis.setdefault("frame_rate_Hz", rate)
            analysis["frame_rate_Hz"] = rate if own == earlier.get("frame_rate_Hz") else own
    if isinstance(exposure, int | float):
        before, exposed = earlier.get("exposure_us"), {"exposure_ms": 1e-3 * exposure}
        for _, camera in tables_of(document, "camera"):
            shutter = camera.setdefault("shutter", dict(exposed))
            if isinstance(before, int | float) and isinstance(shutter, dict):
                shutter |= exposed if shutter.get("exposure_ms") == 1e-3 * before else {}
