"""Where subsets lie in the reference picture, for places that a scene names.

Places in mm are projected with the true camera, as a tester would point at them in a picture of the
unloaded structure, and go with it to where it is in the reference picture. The truth is then taken
at what the picture's pixels see there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import require
from gpusim.pipeline.measurements.dic.correlating import points_within
from gpusim.pipeline.measurements.material_points import TrueMotion
from gpusim.pipeline.measurements.region_of_interest import (
    RIM,
    RegionOfInterest,
    region_of_interest,
)
from gpusim.pipeline.measurements.results import MM
from gpusim.scene.description import model as m


@dataclass(frozen=True, eq=False)
class PlacedSubsets:
    """``pixels`` (N, 2), whole, of subsets that belong to the places ``place`` (N,), called
    ``names``: the first of each is its middle."""

    names: tuple[str, ...]
    pixels: Float
    place: Long

    @property
    def middle(self) -> Long:
        """(P,), which of the subsets is the middle of each place."""
        return np.searchsorted(self.place, np.arange(len(self.names)))


@dataclass(frozen=True, eq=False)
class ReferencePicture:
    """The picture in which places are told: frame 0 of the first camera of ``spec``."""

    spec: m.SeriesTable | m.ModesTable
    motion: TrueMotion

    def pixels(self, key: str) -> Float:
        """(…, 2) px of a key that is given in px or in mm. Raises InputError for a place in mm that
        has nothing to go with to where it is in frame 0."""
        given = getattr(self.spec, f"{key}_px")
        if given is not None:
            return np.array(given)
        name, motion = self.spec.views[0], self.motion
        place = np.array(getattr(self.spec, f"{key}_mm"))
        seen = motion.camera(name).project(place / MM)
        if motion.unmoved(None):
            return seen
        material = motion.seen_at(name, seen.reshape(-1, 2), None)
        for own, there in zip(place.reshape(-1, 3).tolist(), material.seen, strict=True):
            require(
                bool(there), f"measure {self.spec.name!r}: {key}_mm",
                f"{own}, where camera {name!r} sees nothing of the unloaded structure",
                "a place on a surface that it sees",
            )  # fmt: skip
        return motion.pixels(material, name, 0).reshape(seen.shape)

    def line(self, count: int) -> dict[str, Float]:
        """(2,) px of so many points from ``start`` to ``end``, by their names."""
        points = np.linspace(self.pixels("start"), self.pixels("end"), count)
        digits = len(str(count))
        return {f"p{k:0{digits}d}": point for k, point in enumerate(points, 1)}

    def size(self, key: str, at: Float) -> Float:
        """(2,) px of a width and a height that are given in px, or in mm on the surface ``at``.
        Raises InputError if nothing is seen there."""
        given = getattr(self.spec, f"{key}_px")
        if given is not None:
            return np.array(given)
        around = at + np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
        seen = self.motion.seen_at(self.spec.views[0], around)
        require(
            bool(seen.seen.all()), f"measure {self.spec.name!r}: {key}_mm",
            f"({at[0]:.0f}, {at[1]:.0f}) px of camera {self.spec.views[0]!r} as the middle",
            "a middle on a surface that it sees",
        )  # fmt: skip
        place = self.motion.position(seen, None)
        sides = np.linalg.norm(place[::2] - place[1::2], axis=1)
        return np.asarray(np.array(getattr(self.spec, f"{key}_mm")) / (MM * sides))

    def placed(self, patches: Mapping[str, Float]) -> PlacedSubsets:
        """Subsets at ``patches`` (n, 2) px by the names of their places: those within the picture
        that see the surface which the first of their place sees.

        Raises
        ------
        InputError
            The first one isn't within the picture, or sees nothing.
        """
        half, camera = self.spec.subset_px // 2, self.motion.camera(self.spec.views[0])
        place = np.repeat(np.arange(len(patches)), [len(one) for one in patches.values()])
        asked = PlacedSubsets(tuple(patches), np.rint(np.concatenate([*patches.values()])), place)
        size = np.array([camera.width, camera.height])
        fits = np.all((asked.pixels >= half) & (asked.pixels < size - half), axis=1)
        surface = np.full(len(place), -1)
        surface[fits] = self.motion.seen_at(self.spec.views[0], asked.pixels[fits]).surface
        for name, first in zip(patches, asked.middle, strict=True):
            x, y = asked.pixels[first]
            require(
                surface[first] >= 0, f"measure {self.spec.name!r}: {name}",
                f"({x:.0f}, {y:.0f}) px of camera {self.spec.views[0]!r}, where it sees nothing",
                f"a place on a surface, {half} px or more inside the picture",
            )  # fmt: skip
        kept = surface == surface[asked.middle][place]
        return PlacedSubsets(asked.names, asked.pixels[kept], place[kept])

    def anchors(self, dic: m.DicTable) -> Float:
        """Pixels (A, 2) all over what is textured: by these a rig is laid on the structure."""
        what = f"measure {dic.name!r}"
        roi = region_of_interest(what, None, self.motion, dic.views[0])
        return points_within(what, roi.mask, dic)

    def region(self, pixels: Float) -> RegionOfInterest:
        """What subsets at ``pixels`` (N, 2) see of the surfaces that their middles see."""
        name, camera = self.spec.views[0], self.motion.camera(self.spec.views[0])
        mask = np.zeros((camera.height, camera.width), np.uint8)
        column, row = pixels.T.astype(np.int64)
        mask[row, column] = 1
        side = 2 * (self.spec.subset_px // 2 + RIM) + 1
        near = np.argwhere(cv2.dilate(mask, np.ones((side, side), np.uint8)))
        points = self.motion.seen_at(name, near[:, ::-1].astype(np.float64))
        kept = np.isin(points.surface, self.motion.seen_at(name, pixels).surface)
        seen = np.zeros(mask.shape, bool)
        seen[tuple(near[kept].T)] = True
        return RegionOfInterest(seen, points[kept]).shrunk(RIM)
