"""Material points that a camera sees at given places of its picture, and how they really move.

Lagrangian and in float64: a point is a place on a triangle of what is drawn, with the weights of
its corners, and stays there while nodes move and props are placed. Measurements are compared with
this; they never use it.

A frame's truth is where things are at its instant: what blur and a shutter that reads row by row do
to the pictures counts as error of what is measured in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.field_summary import field_summary
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.point_location import PointLocation
from gpusim.optics.geometry.triangle_corners import barycentric_planes, in_camera
from gpusim.optics.rendering.local_origin import local, local_view
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.surface import Surface
from gpusim.validation import require, require_one_of

HIDDEN = 1e-6
"""Share of its depth by which a point lies behind what is seen in its place, if it is hidden."""
_KEPT = 4
"""Frames whose surfaces, and views whose triangles, are kept."""


@dataclass(frozen=True, eq=False)
class MaterialPoints:
    """P places on the surfaces of a scene: ``surface`` (P,) its number, bodies first, -1 where
    nothing is seen; ``face`` (P,) of that surface; ``vertices`` (P, 3) counted over all surfaces,
    and their ``weights`` (P, 3), which add up to 1 and are NaN where nothing is seen."""

    surface: Long
    face: Long
    vertices: Long
    weights: Float
    __repr__ = field_summary

    @property
    def seen(self) -> Bool:
        """(P,), whether there is anything."""
        return np.asarray(self.surface >= 0)

    def __len__(self) -> int:
        return len(self.surface)

    def __getitem__(self, rows: Long | Bool | slice) -> Self:
        """Some of them."""
        return type(self)(*(getattr(self, one.name)[rows] for one in fields(self)))

    def at(self, values: Float) -> Float:
        """Values of all surfaces' vertices (V, …) at the points (P, …); NaN where nothing is."""
        return np.asarray(np.einsum("pk,pk...->p...", self.weights, values[self.vertices]))


class TrueMotion:
    """How material points of the scene that ``objects`` are of move from frame to frame.

    Frames are numbers; None: bodies unloaded, props as in frame 0. Cameras are known by their
    names. ``first``: the surfaces in frame 0 and unloaded, where no more is known yet.
    """

    def __init__(self, objects: SceneObjects, first: Sequence[Surface] = ()) -> None:
        self.objects, self.scene = objects, objects.scene
        self._surfaces: dict[int | None, Sequence[Surface]] = (
            {0: first, None: first} if first else {}
        )
        self._cameras: dict[str, Camera] = {}
        self._views: dict[tuple[str, int | None], PointLocation] = {}

    def camera(self, name: str) -> Camera:
        """A camera of the scene as it really is, lengths in m."""
        if name not in self._cameras:
            known = {one.name: one for one in self.scene.cameras}
            require_one_of("camera", name, known)
            self._cameras[name] = build_camera(known[name], self.scene.input)
        return self._cameras[name]

    def surfaces(self, frame: int | None) -> Sequence[Surface]:
        """All surfaces in a frame, bodies first."""
        if frame not in self._surfaces:
            shown = self.objects.surfaces(frame)
            if frame is None:
                bodies = len(self.objects.bodies)
                shown[bodies:] = self.surfaces(0)[bodies:]
            self._surfaces[frame] = shown
            while len(self._surfaces) > _KEPT:
                del self._surfaces[next(iter(self._surfaces))]
        return self._surfaces[frame]

    def unmoved(self, frame: int | None) -> bool:
        """Whether everything stands in a frame where it does in frame 0."""
        return all(
            np.array_equal(now.points, before.points)
            for now, before in zip(self.surfaces(frame), self.surfaces(0), strict=True)
        )

    def seen_at(self, camera: str, pixels: Float, frame: int | None = 0) -> MaterialPoints:
        """The material points that a camera sees at ``pixels`` (P, 2), any fraction of one, in a
        frame."""
        pixels = np.asarray(pixels, dtype=np.float64)
        require(pixels.ndim == 2 and pixels.shape[1] == 2, "pixels", pixels.shape, "(P, 2)")
        located, surfaces = self._located(camera, frame), self.surfaces(frame)
        triangle, _ = located.nearest(pixels)
        found = np.flatnonzero(triangle >= 0)
        view = located.view
        counts = [len(one.topology.triangles) for one in surfaces]
        first = np.cumsum([0, *(len(one.points) for one in surfaces)])
        corners = np.concatenate([
            one.topology.triangles + start for one, start in zip(surfaces, first, strict=False)
        ])  # fmt: skip
        faces = np.concatenate([one.topology.source for one in surfaces])
        source = view.source[triangle[found]]
        surface = np.full(len(pixels), -1, np.int64)
        surface[found] = np.searchsorted(np.cumsum(counts), source, side="right")
        face, vertices = np.full(len(pixels), -1, np.int64), np.zeros((len(pixels), 3), np.int64)
        face[found], vertices[found] = faces[source], corners[source]
        there = MaterialPoints(surface, face, vertices, np.full((len(pixels), 3), np.nan))
        return self.on_triangles(there, camera, pixels, frame)

    def on_triangles(
        self, points: MaterialPoints, camera: str, pixels: Float, frame: int | None = 0
    ) -> MaterialPoints:
        """What a camera would see at ``pixels`` (P, 2) if the triangles of ``points`` went on."""
        near, lens, _, _ = local(self.surfaces(frame), self.camera(camera))
        seen = points.seen
        # of the triangle as it is, not of the part of it that is in the image
        own = in_camera(lens, np.concatenate([one.points for one in near]))[points.vertices[seen]]
        planes = barycentric_planes(own, lens)
        ideal = lens.undistort(pixels[seen])
        share = np.einsum("pij,pj->pi", planes[:, :, :2], ideal) + planes[:, :, 2]
        weights = np.full((len(pixels), 3), np.nan)
        weights[seen] = share / share.sum(axis=1, keepdims=True)
        return replace(points, weights=weights)

    def position(self, points: MaterialPoints, frame: int | None) -> Float:
        """Where points are in a frame, (P, 3) m, world."""
        return points.at(np.concatenate([one.points for one in self.surfaces(frame)]))

    def displacement(
        self, points: MaterialPoints, frame: int | None, reference: int | None = 0
    ) -> Float:
        """How far they went from the ``reference`` frame, (P, 3) m, world."""
        given = isinstance(points, MaterialPoints)
        require(given, "displacement: points", type(points).__name__, "what seen_at returned")
        now, before = self.surfaces(frame), self.surfaces(reference)
        moved = [one.points - other.points for one, other in zip(now, before, strict=True)]
        return points.at(np.concatenate(moved))

    def pixels(self, points: MaterialPoints, camera: str, frame: int | None) -> Float:
        """Where they are in a camera's picture, (P, 2) px, hidden or not; NaN behind the camera."""
        return self.camera(camera).project(self.position(points, frame))

    def visible(self, points: MaterialPoints, camera: str, frame: int | None) -> Bool:
        """Whether a camera sees them in a frame, (P,): inside its image and not hidden."""
        located = self._located(camera, frame)
        _, lens, _, origin = local(self.surfaces(frame), self.camera(camera))
        place = self.position(points, frame) - origin
        at = lens.project(place)
        _, inverse = located.nearest(at)
        with np.errstate(invalid="ignore"):
            inside = np.all((at >= -0.5) & (at < [lens.width - 0.5, lens.height - 0.5]), axis=1)
            before = lens.to_camera(place)[:, 2] * inverse <= 1.0 + HIDDEN
        return np.asarray(inside & (inverse > 0.0) & before)

    def body(self, points: MaterialPoints) -> Int:
        """The body that each is of, (P,); -1 for props and where nothing is seen."""
        own = points.surface < len(self.objects.bodies)
        return np.where(own, points.surface, -1).astype(np.int32)

    def _located(self, camera: str, frame: int | None) -> PointLocation:
        key = camera, frame
        if key not in self._views:
            view = local_view(self.surfaces(frame), self.camera(camera), lit=False)
            self._views[key] = PointLocation(view)
            while len(self._views) > _KEPT:
                del self._views[next(iter(self._views))]
        return self._views[key]
