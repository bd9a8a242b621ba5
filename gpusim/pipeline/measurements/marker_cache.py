"""Markers tracked in a camera's pictures, kept beside the results they are for.

A rig's result depends on all of its cameras; where its markers went in one picture doesn't. So a
new lens on one camera leaves the others' alone.
"""

from __future__ import annotations

import hashlib
import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.files.atomic_files import atomic_stream, safe_name
from gpusim.files.input_file import Reader, read_input
from gpusim.files.output_folder import inside
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.sensor.sensor import Sensor
from gpusim.pipeline.measurements.marker_tracking import MarkerSet, MarkerTracks, track_markers

__all__ = ["MarkerCache"]

_KEY = "key"


class MarkerCache:
    """`track_markers`, once for the same pictures.

    ``folder``: where what was found is kept; ``reuse``: whether an earlier run's is taken, and
    ``read`` how.
    """

    def __init__(self, folder: Path, reuse: bool = True, read: Reader = read_input) -> None:
        self.folder, self.reuse, self.read = folder, reuse, read
        self._found: dict[Path, tuple[str, MarkerTracks]] = {}

    @property
    def files(self) -> list[Path]:
        """Those of this run."""
        return list(self._found)

    def track(
        self,
        name: str,
        marks: MarkerSet,
        camera: Camera,
        reference: npt.NDArray[Any],
        deformed: npt.NDArray[Any],
        *,
        subset: int | None,
        sensor: Sensor,
    ) -> MarkerTracks:
        """As `track_markers`, for the measure ``name``."""
        key = _key(marks, camera, (reference, deformed), subset, sensor)
        path = inside(self.folder, f"{safe_name(name)}-{safe_name(camera.name)}-markers.npz")
        known, found = self._found.get(path, ("", None))
        if found is None or known != key:
            found = _stored(path, key, self.read) if self.reuse else None
        if found is None:
            found = track_markers(
                f"measure {name!r}",
                marks,
                camera,
                reference,
                deformed,
                subset=subset,
                sensor=sensor,
            )
            with atomic_stream(path) as stream:
                np.savez(stream, allow_pickle=False, **{_KEY: np.array(key)}, **vars(found))
        self._found[path] = key, found
        return found


def _key(
    marks: MarkerSet,
    camera: Camera,
    pictures: tuple[npt.NDArray[Any], ...],
    subset: int | None,
    sensor: Sensor,
) -> str:
    """A digest of all that the result depends on."""
    digest = hashlib.sha256()
    bent = np.zeros(0) if camera.distortion is None else np.asarray(camera.distortion)
    for values in (*pictures, camera.K, camera.camera_from_world, bent,
                   marks.position, marks.size):  # fmt: skip
        digest.update(f"{values.shape} {values.dtype}".encode())
        digest.update(np.ascontiguousarray(values).data)
    places = [len(paint.markers) for _, paint in marks.groups]
    rest = (__version__, marks.count, marks.names, marks.group_names, places, subset, sensor)
    digest.update(repr(rest).encode())
    return digest.hexdigest()


def _stored(path: Path, key: str, read: Reader) -> MarkerTracks | None:
    """What lies there for ``key``; None if that is another one's, or damaged."""
    try:
        with np.load(read(str(path)).stream(), allow_pickle=False) as file:
            if str(file[_KEY]) != key:
                return None
            values = {item.name: file[item.name] for item in fields(MarkerTracks)}
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return None
    for name in ("names", "status"):
        values[name] = tuple(str(word) for word in values[name])
    return MarkerTracks(**values | {"subset": int(values["subset"]),
                                "tracking_px": float(values["tracking_px"])})  # fmt: skip
