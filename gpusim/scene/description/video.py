"""``[video]``: films of the cameras' pictures, and how fast and how long they are taken."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from gpusim.scene.tables.table import Names, Table, table_of

from .analysis.analysis_table import TABLES, AnalysisTable
from .camera import CameraTable
from .lens import ShutterTable

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
    cameras: Names | None = None
    """Names of those that film; without it all, of [] none: then it says how pictures are taken."""
    frame_rate_Hz: Annotated[float, Field(gt=0)] | None = None
    """How fast frames follow each other: ``analysis.frame_rate_Hz``, said here or there. Of frames
    that aren't in time, modes and phases, how fast the film is to be played."""
    exposure_us: Annotated[float, Field(ge=0)] | None = None
    """The ``shutter.exposure_ms`` of cameras without a ``shutter``."""

    def exposed(self, camera: CameraTable) -> CameraTable:
        """A camera with a shutter of this exposure if it has none of its own."""
        if camera.shutter is not None or self.exposure_us is None:
            return camera
        shutter = ShutterTable.model_construct(exposure_ms=1e-3 * self.exposure_us)
        return camera.model_copy(update={"shutter": shutter})


def filming(video: VideoTable | None, cameras: Iterable[CameraTable]) -> tuple[str, ...]:
    """Names of the ``cameras`` that film."""
    if video is None:
        return ()
    return tuple(one.name for one in cameras) if video.cameras is None else video.cameras


def frame_rate_in(document: Mapping[str, Any]) -> Any:
    """How fast frames of a plain document follow each other (Hz): None where they aren't in time,
    or nobody says it; no number where a key that nobody knows may say it."""
    analysis, video = (table_of(document, key) for key in ("analysis", "video"))
    kind = TABLES.get(str(analysis.get("type", "static")), AnalysisTable)
    rate = analysis.get("frame_rate_Hz")
    if rate is not None or not kind.in_time(analysis):
        return rate
    unknown = any(unknown_keys(*one) for one in ((analysis, kind), (video, VideoTable)))
    return video.get("frame_rate_Hz", "unknown" if unknown else None)


def unknown_keys(table: Mapping[str, Any], kind: type[Table]) -> bool:
    """Whether it has a key that its kind doesn't."""
    return not table.keys() <= {one.alias or key for key, one in kind.model_fields.items()}
