"""The pixels of a camera's reference picture in which something is measured.

What a pixel sees, at its centre, is the truth's: a tester would draw the same outline by hand.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import InputError
from gpusim.pipeline.measurements.material_points import MaterialPoints, TrueMotion
from gpusim.pipeline.pictures.framing import share_in_picture
from gpusim.pipeline.scene_objects.meshing import faces_of
from gpusim.scene.description import model as m

RIM = 3
"""Pixels at an edge that aren't used: what lies behind disturbs the interpolation there."""
_PARTS = 64
"""Of an edge in space, which a lens bends."""


@dataclass(frozen=True, eq=False)
class RegionOfInterest:
    """``mask`` (H, W): the pixels; ``points``: what their centres see, row after row."""

    mask: Bool
    points: MaterialPoints

    def shrunk(self, pixels: int) -> RegionOfInterest:
        """Without what is nearer than this to anything outside, the picture's own border apart."""
        size = 2 * pixels + 1
        kept = cv2.erode(self.mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
        return RegionOfInterest(kept, self.points[kept[self.mask]])

    def image(self, values: Float) -> Float:
        """Values of the ``points`` (P, …) as an image (H, W, …), NaN outside."""
        image = np.full((*self.mask.shape, *values.shape[1:]), np.nan)
        image[self.mask] = values
        return image


def region_of_interest(
    what: str, region: m.RegionTable | None, motion: TrueMotion, camera: str, stride: int = 1
) -> RegionOfInterest:
    """The pixels of a ``camera`` for which all that a ``region`` says holds, and that see anything
    at all in frame 0; without a region what `_usual` has. Of a ``stride`` along rows and columns
    one pixel is looked at.

    Raises
    ------
    InputError
        There is no such pixel; ``what`` is measured there.
    """
    viewer = motion.camera(camera)
    shape = viewer.height, viewer.width
    looked = np.zeros(shape, bool)
    looked[::stride, ::stride] = True
    row, column = np.nonzero(looked)
    points = motion.seen_at(camera, np.stack([column, row], axis=1).astype(np.float64))
    mask = _asked(region, motion, points)
    for corners in _polygons(what, region, motion, camera) if region is not None else ():
        mask = mask & inside_polygon(shape, corners)[looked]
    if not mask.any():
        asked = ", ".join(region.model_fields_set) if region is not None else "any body"
        raise InputError(
            f"{what}: roi; got no pixel of camera {camera!r} in frame 0 ({asked}); expected a "
            "place that it sees"
        )
    looked[looked] = mask
    return RegionOfInterest(looked, points[mask])


def _asked(region: m.RegionTable | None, motion: TrueMotion, points: MaterialPoints) -> Bool:
    """Which points (P,) are of a region, wherever its polygons lie."""
    if region is None:
        return _usual(motion, points)
    mask = points.seen
    if region.paint is not None:
        mask = mask & _of_paints(motion, points, [region.paint])
    if region.where is not None:
        mask = mask & _of_faces(motion, points, region.where)
    return mask


def region_in_picture(region: m.RegionTable | None, motion: TrueMotion, camera: str) -> float:
    """Share of the area of a region's faces that lies in the picture of a ``camera`` in frame 0;
    polygons cut nothing off."""
    surfaces = motion.surfaces(0)
    counts = [len(one.topology.triangles) for one in surfaces]
    number = np.repeat(np.arange(len(surfaces)), counts)
    face = np.concatenate([one.topology.source for one in surfaces]).astype(np.int64)
    nowhere = np.zeros((len(face), 3), np.int64), np.full((len(face), 3), np.nan)
    own = _asked(region, motion, MaterialPoints(number, face, *nowhere))
    corners = np.concatenate([one.points[one.topology.triangles] for one in surfaces])
    closed = np.array([one.topology.closed for one in surfaces])[number]
    return share_in_picture(corners[own], closed[own], motion.camera(camera))


def _usual(motion: TrueMotion, points: MaterialPoints) -> Bool:
    """What is painted with a texture, speckle or a picture, of a body, else of a prop; else any
    body."""
    scene = motion.scene
    for things in (scene.bodies, scene.props):
        textured = [
            paint.name for thing in things for paint in thing.paints
            if isinstance(paint, m.SpeckleTable | m.PictureTable)
        ]  # fmt: skip
        mask = _of_paints(motion, points, textured)
        if mask.any():
            return mask
    return np.asarray(motion.body(points) >= 0)


def _of_paints(motion: TrueMotion, points: MaterialPoints, names: Sequence[str]) -> Bool:
    """Which points (P,) have one of these paints; names are unique in a scene."""
    result = np.zeros(len(points), bool)
    for number, surface in enumerate(motion.surfaces(0)):
        # a picture laid by UV has a region for each of its materials: "name/material"
        wanted = np.isin([region.split("/")[0] for region in surface.paints], list(names))
        own = np.flatnonzero(points.surface == number)
        result[own] = wanted[surface.regions[points.face[own]]]
    return result


def _of_faces(motion: TrueMotion, points: MaterialPoints, where: m.WhereTable) -> Bool:
    """Which points (P,) are on faces of any body that are ``where``. Raises InputError if no body
    has such faces."""
    result, missing = np.zeros(len(points), bool), list[InputError]()
    for number, parts in enumerate(motion.objects.bodies):
        skin = parts.skin
        try:
            chosen: Long = skin.numbers(faces_of(skin.mesh, skin.faces, where))
        except InputError as error:
            missing.append(error)
            continue
        own = np.flatnonzero(points.surface == number)
        result[own] = np.isin(skin.face_of_piece[points.face[own]], chosen)
    if missing and len(missing) == len(motion.objects.bodies):
        raise missing[0]
    return result


def _polygons(what: str, region: m.RegionTable, motion: TrueMotion, camera: str) -> Iterator[Float]:
    """Corners (C, 2) px of the region's polygons."""
    if region.polygon_px is not None:
        yield np.array(region.polygon_px)
    if region.polygon_mm is not None:
        corners = np.array(region.polygon_mm) / 1000.0
        share = np.arange(_PARTS)[:, None] / _PARTS
        edges = corners[:, None] + share * (np.roll(corners, -1, axis=0) - corners)[:, None]
        seen = motion.camera(camera).project(edges.reshape(-1, 3))
        if not np.isfinite(seen).all():
            got = f"a corner behind camera {camera!r}, or beyond its lens"
            raise InputError(f"{what}: roi polygon_mm; got {got}; expected one before it")
        yield seen


def inside_polygon(shape: tuple[int, int], corners: Float) -> Bool:
    """The pixels (H, W) whose centres are within a polygon with ``corners`` (C, 2) px: those with
    an odd number of edges to their left in their row."""
    height, width = shape
    (x, y), (to_x, to_y) = corners.T, np.roll(corners, -1, axis=0).T
    row = np.arange(height)[:, None]
    which, edge = np.nonzero((y <= row) != (to_y <= row))
    along = (which - y[edge]) / (to_y[edge] - y[edge])
    crossing = np.ceil(x[edge] + along * (to_x[edge] - x[edge]))
    first = np.clip(crossing, 0, width).astype(np.int64)
    count = np.zeros((height, width + 1), np.int64)
    np.add.at(count, (which, first), 1)
    return np.asarray(np.cumsum(count, axis=1)[:, :width] % 2 == 1)
