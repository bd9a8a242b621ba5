"""Which markers a camera can see, how large and how sharp, before any picture is taken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.build.build import BodyParts
from gpusim.pipeline.build.cameras import build_camera
from gpusim.pipeline.build.photo import build_lens
from gpusim.pipeline.measurements.marker_tracking import MarkerSet, check_widths, collect_markers
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface import Surface

__all__ = ["marker_warnings", "unseen"]

Array = npt.NDArray[np.float64]
OWN_SHARE = 0.05  # of a marker's size: how near to it a surface is its own
MOST_BLUR = 0.15  # of a marker's width: a cross blurred by more has its border in its middle
NAMED = 6


def marker_warnings(
    scene: Scene,
    bodies: Sequence[BodyParts],
    surfaces: Sequence[Surface],
    blind: Mapping[str, str],
    strict: bool,
) -> list[str]:
    """Markers that the camera of their measure can't see, or sees blurred.

    ``blind``: camera -> why it sees nothing.

    Raises InputError, if ``strict``, for a measure that can't work: too few markers are seen, or
    one is too small.
    """
    found = []
    for spec in scene.measures:
        if isinstance(spec, m.Damage):
            continue
        what = f"measure {spec.name!r}"
        marks = collect_markers(what, spec.groups, spec.static, scene, bodies)
        names = (spec.camera,) if isinstance(spec, m.Deflection) else spec.cameras
        least = 2 if isinstance(spec, m.Deflection) else 3
        for camera_spec in (one for one in scene.cameras if one.name in names):
            camera = build_camera(camera_spec)
            if strict and camera.name in blind:
                raise InputError(f"{what}: {blind[camera.name]}")
            reasons = unseen(camera, marks.position[: marks.count], marks.size, surfaces)
            lost = [
                f"{name} ({why})" for name, why in zip(marks.names, reasons, strict=False) if why
            ]
            if len(lost) > NAMED:
                lost[NAMED - 1 :] = [f"and {len(lost) - NAMED + 1} more"]
            seen = sum(not why for why in reasons)
            text = f"{what}: camera {camera.name!r} sees {seen} of {marks.count} markers"
            if strict and seen < least:
                raise InputError(f"{text}; expected {least} at least. Not seen: {', '.join(lost)}")
            if lost:
                found.append(f"{text}; not {', '.join(lost)}")
            if strict and not any(reasons):
                check_widths(what, marks, camera)
            found += _blurred(what, marks, camera_spec, camera)
    return found


def unseen(camera: Camera, position: Array, size: Array, surfaces: Sequence[Surface]) -> list[str]:
    """Why ``camera`` doesn't see points (M, 3) of things of ``size`` (M,): "" where it does."""
    depth = camera.to_camera(position)[:, 2]
    pixels = camera.project(position)
    reasons = []
    # what hides another body is of more interest than its own side
    tables = [_Triangles(surface, camera) for surface in reversed(surfaces)]
    for point, wide, z, (u, v) in zip(position, size, depth, pixels, strict=False):
        if not z > 0.0:
            reasons.append("behind the camera")
        elif not (-0.5 <= u <= camera.width - 0.5 and -0.5 <= v <= camera.height - 0.5):
            reasons.append("beside its image")
        else:
            hits = (table.name for table in tables if table.hides(point, OWN_SHARE * wide))
            by = next(hits, "")
            reasons.append(f"hidden by {by!r}" if by else "")
    return reasons


class _Triangles:
    """The triangles of a surface, and where in the image each one lies."""

    def __init__(self, surface: Surface, camera: Camera) -> None:
        self.name = surface.name
        self.points, self.triangles = surface.points - camera.eye, surface.topology.triangles
        self.turn = camera.camera_from_world[:3, :3]
        place = self.points @ self.turn.T
        flat = place[:, :2] / np.where(place[:, 2:] > 0.0, place[:, 2:], np.inf)
        corners = flat[self.triangles]
        self.low, self.high = corners.min(axis=1), corners.max(axis=1)
        # what reaches behind the camera may be anywhere
        open_ = ~(place[:, 2] > 0.0)[self.triangles].all(axis=1)
        self.low[open_], self.high[open_] = -np.inf, np.inf
        self.eye = camera.eye

    def hides(self, point: Array, own: float) -> bool:
        """Whether one is between the camera and ``point`` (3,), and farther than ``own`` off it."""
        ray = point - self.eye
        place = self.turn @ ray
        flat = place[:2] / place[2]
        near = ((self.low <= flat) & (flat <= self.high)).all(axis=1)
        if not near.any():
            return False
        a, b, c = (self.points[self.triangles[near, k]] for k in range(3))
        first, second = b - a, c - a
        across = np.cross(ray, second)
        det = np.einsum("ti,ti->t", first, across)
        met = det != 0.0
        a, first, second, across, det = a[met], first[met], second[met], across[met], det[met]
        s = np.einsum("ti,ti->t", -a, across) / det
        side = np.cross(-a, first)
        t = (side @ ray) / det
        way = np.einsum("ti,ti->t", second, side) / det
        last = 1.0 - own / float(np.linalg.norm(ray))
        hit = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0) & (way > 0.0) & (way < last)
        return bool(hit.any())


def _blurred(what: str, marks: MarkerSet, spec: m.Camera, camera: Camera) -> list[str]:
    """A sentence for markers so far out of focus that their crosses are blurred away."""
    lens = build_lens(spec)
    if lens is None or not lens.aperture or lens.focus_distance is None:
        return []
    z = camera.to_camera(marks.position[: marks.count])[:, 2]
    z = np.where(z > 0.0, z, np.nan)
    blur = camera.K[0, 0] * lens.aperture * np.abs(1.0 / z - 1.0 / lens.focus_distance)
    share = np.nan_to_num(blur / (camera.K[0, 0] * marks.size[: marks.count] / z))
    worst = int(np.argmax(share))
    if not share[worst] > MOST_BLUR:
        return []
    return [
        f"{what}: marker {marks.names[worst]!r} is out of focus for camera {camera.name!r}: it is "
        f"blurred over {blur[worst]:.3g} px, {100 * share[worst]:.2g} % of its width; it is "
        f"{1e3 * z[worst]:.4g} mm away, the focus at {1e3 * lens.focus_distance:.4g} mm"
    ]
