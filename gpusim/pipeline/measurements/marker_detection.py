"""Markers of a scene, found in a picture near where they are expected, and crosses fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.arrays.array_types import Bool, Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.pipeline.scene_objects.surfaces import BodyParts
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.validation import require

SEARCH_SHARE = 0.5  # of a marker's width, around where the rough camera expects it
LEAST_WIDTH = 10.0  # px; a marker's cross can't be fitted in less
SIZES = (0.5, 1.3)  # of the width that a marker has when it is seen from the front
ALIKE = 0.08  # logarithm of the ratio of widths that are looked for together
FIRST_SHARE = 0.6  # of a marker's half width that a first fit of its cross looks at
END_MARGIN = 1.2, 2.5  # px, and lens blurs, kept from a marker's own border


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """The markers of a measurement: ``count`` on bodies, then those that can't move.

    ``position`` (M, 3), m, on the unloaded structure; ``size`` (M,), m; ``names``, ``group_names``
    (M,); ``groups``: body number and paint, in the order asked for.
    """

    groups: tuple[tuple[int, m.MarkersTable], ...]
    count: int
    position: Float
    size: Float
    names: tuple[str, ...]
    group_names: tuple[str, ...]

    def displacement(
        self, objects: SceneObjects, of_body: Callable[[int], Iterable[Float]]
    ) -> Float:
        """(K, M, 3) of the markers on bodies, for K fields (N, 3) that there are ``of_body``."""
        parts, first = [], 0
        for body, paint in self.groups:
            own = self.position[first : first + len(paint.markers)]
            first += len(own)
            nodes, weights = objects.bodies[body].skin.locate(own)
            u = np.stack([field[nodes] for field in of_body(body)])
            parts.append(np.einsum("mk,fmka->fma", weights, u))
        return np.concatenate(parts, axis=1)

    def true_motion(self, objects: SceneObjects, frames: Sequence[int]) -> tuple[Float, Float]:
        """True displacements in m of the markers on bodies: (M, 3) in the first frame, and
        (F, M, 3) from there to each of the ``frames``."""
        every = self.displacement(
            objects, lambda body: [objects.displacement(body, frame) for frame in (0, *frames)]
        )
        return every[0], every[1:] - every[0]

    def exposure_drift(self, objects: SceneObjects, camera: m.CameraTable) -> Float | None:
        """(F, M, 3) m by which the mean of an exposure lies off its middle, frame by frame; None
        where no body is known in between, or the ``camera`` sees an instant."""
        if camera.shutter is None:
            return None
        frames, exposure = range(len(objects.frames)), camera.shutter.exposure
        if not any(map(objects.vibrations, frames)):
            return None
        return self.displacement(
            objects, lambda body: (objects.drift(body, frame, exposure) for frame in frames)
        )


def collect_markers(
    spec: m.MarkerMeasureTable, scene: Scene, bodies: Sequence[BodyParts]
) -> MarkerSet:
    """The markers of the paints of ``spec`` on bodies, in order, and on props."""
    painted = [(k, paint) for k, parts in enumerate(bodies) for paint in parts.body.paints]
    by_name = {paint.name: (k, paint) for k, paint in painted if isinstance(paint, m.MarkersTable)}
    groups = tuple(by_name[name] for name in spec.groups)
    on_props = {paint.name: paint for prop in scene.props for paint in prop.paints}
    paints = [paint for _, paint in groups]
    still = [paint for name in spec.static if isinstance(paint := on_props[name], m.MarkersTable)]
    every = [(paint, marker) for paint in (*paints, *still) for marker in paint.markers]
    return MarkerSet(
        groups=groups,
        count=sum(len(paint.markers) for paint in paints),
        position=np.array([marker.position for _, marker in every]),
        size=np.array([paint.size for paint, _ in every]),
        names=tuple(marker.name for _, marker in every),
        group_names=tuple(paint.name for paint, _ in every),
    )


def check_widths(what: str, marks: MarkerSet, camera: Camera) -> Float:
    """Widths (M,) px of the markers; raises InputError for one that is too small."""
    widths: Float = camera.K[0, 0] * marks.size / camera.to_camera(marks.position)[:, 2]
    narrow = int(np.argmin(widths))
    place = f"{what}: marker {marks.names[narrow]!r} is too small for camera {camera.name!r}"
    least = LEAST_WIDTH / 0.95
    expected = f"more than {least:.1f} px (a larger marker, a longer lens or more pixels)"
    require(widths[narrow] >= least, place, f"a width of {widths[narrow]:.1f} px", expected)
    return widths


@dataclass(frozen=True, eq=False)
class CrossFits:
    """M markers, px; NaN where there is none.

    ``points`` (M, 2); ``arms`` (M, 2, 2), half widths along both borders; ``blur`` (M,) of the
    lens; ``sigma`` (M,), standard uncertainty; ``rough`` (M,) bool: only located, because the fit
    of the cross didn't settle.
    """

    points: Float
    arms: Float
    blur: Float
    sigma: Float
    rough: Bool

    @property
    def known(self) -> Bool:
        """(M,) bool: seen."""
        return np.asarray(np.isfinite(self.points).all(axis=1))


def size_range(width: float) -> tuple[float, float]:
    """Lowest and highest width (px) of a marker that is ``width`` px wide from the front."""
    return max(LEAST_WIDTH, SIZES[0] * width), SIZES[1] * width


def find_crosses(image: npt.NDArray[Any], near: Float, widths: Float) -> CrossFits:
    """Find the markers that are about ``widths`` (M,) px wide near the places (M, 2)."""
    points, arms = np.full_like(near, np.nan), np.full((len(near), 2, 2), np.nan)
    seen = np.isfinite(near).all(axis=1)
    # markers of about the same size together; which sizes are near one doesn't depend on the others
    kind = np.where(seen, np.round(np.log(widths) / ALIKE), np.nan)
    for one in np.unique(kind[seen]):
        rows, width = np.flatnonzero(kind == one), float(np.exp(ALIKE * one))
        located = measure.locate_markers(image, near[rows], size_range(width), SEARCH_SHARE * width)
        hit = located.status == measure.MarkerStatus.FOUND
        points[rows[hit]] = located.points[hit]
        arms[rows[hit]] = arms_of(located)[hit]
    fine, sigma, blur = fit_crosses(image, points, arms)
    fitted = np.isfinite(fine)
    rough = np.asarray((np.isfinite(points) & ~fitted).all(axis=1))
    return CrossFits(np.where(fitted, fine, points), arms, blur, sigma, rough)


def fit_crosses(
    image: npt.NDArray[Any], near: Float, arms: Float, blur: Float | None = None
) -> tuple[Float, Float, Float]:
    """Centres (M, 2) by a fit of each cross, their standard uncertainty and the lens blur (M,).

    Where the ``blur`` isn't known, a first fit tells it, and with it how close to a marker's own
    border the last one may look.
    """
    points = np.full_like(near, np.nan)
    sigma, found = np.full((2, len(near)), np.nan)
    rows = np.flatnonzero(np.isfinite(near).all(axis=1) & np.isfinite(arms).all(axis=(1, 2)))
    if rows.size:
        fit = measure.fit_crossings(
            image, near[rows], arms[rows, 0], arms[rows, 1], share=FIRST_SHARE,
            margin=END_MARGIN, blur=None if blur is None else np.nan_to_num(blur[rows]),
        )  # fmt: skip
        points[rows], sigma[rows], found[rows] = fit.points, fit.sigma, fit.blur
    return points, sigma, found


def arms_of(located: measure.Markers) -> Float:
    """Half widths (M, 2, 2) along both borders, px."""
    half, turn = 0.5 * located.size, located.angle
    along = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.stack([half[:, :1] * along, half[:, 1:] * across], axis=1)
