"""The measurements that a scene asks for, from its images, and the truth beside them.

The measuring itself sees what a tester has: two images, where the markers were put on the unloaded
structure, and the camera's rough place (to know which marker is which). The finite elements enter
only afterwards, as the truth that the result is compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.errors import GpusimError, InputError
from gpusim.gpu import Device
from gpusim.optics.camera import Camera
from gpusim.pipeline.build import BodyParts, build_camera
from gpusim.pipeline.deflection import DeflectionResult
from gpusim.scene import Scene
from gpusim.scene import model as m

__all__ = ["measure_deflection"]

Array = npt.NDArray[np.float64]
Displacement = Callable[[int, int], Array]
SUBSET_SHARE = 0.95
REFINE_SHARE = 0.2
LEAST_WIDTH = 10.0  # px; a marker's cross can't be fitted in less
TRUTH_POINTS = 200


def measure_deflection(
    spec: m.Deflection,
    scene: Scene,
    bodies: Sequence[BodyParts],
    displacement: Displacement,
    image: Callable[[str, int], npt.NDArray[Any]],
    device: Device | None,
) -> DeflectionResult:
    """Track the markers of ``spec`` from the first frame to the last and scale to mm.

    Marker centres come from the first image (Harris corners, then a fit of the cross); IC-GN
    subsets follow them into the last image, where the centres are fitted again. ``device`` runs
    the correlation; None uses the NumPy twin.

    Raises
    ------
    InputError
        A marker is too small in the image, or behind the camera.
    GpusimError
        No marker could be found in the reference image.
    """
    camera = build_camera(next(c for c in scene.cameras if c.name == spec.camera))
    groups = [_marker_paint(bodies, name) for name in spec.groups]
    markers = [(body, paint, marker) for body, paint in groups for marker in paint.markers]
    static = [
        (paint, marker)
        for name in spec.static
        for prop in scene.props
        for paint in prop.paints
        if paint.name == name and isinstance(paint, m.Markers)
        for marker in paint.markers
    ]
    position = np.array([marker.position for _, _, marker in markers])
    places = np.concatenate([position, *[np.array([s.position])for _, s in static]])  # fmt: skip
    sizes = [paint.size for _, paint, _ in markers] + [paint.size for paint, _ in static]
    expected, widths = camera.project(places), _widths(camera, places, np.array(sizes))
    narrow = int(np.argmin(widths))
    if not 0.95 * widths[narrow] >= LEAST_WIDTH:
        marker = markers[narrow][2] if narrow < len(markers) else static[narrow - len(markers)][1]
        raise InputError(
            f"measure {spec.name!r}: marker {marker.name!r} is too small for camera "
            f"{spec.camera!r}; got a width of {widths[narrow]:.1f} px; expected more than "
            f"{LEAST_WIDTH / 0.95:.1f} px (a larger marker, a longer lens or more pixels)"
        )
    reference = image(spec.camera, 0)
    last = len(scene.analysis.load_factors) - 1
    deformed = image(spec.camera, last)

    points = _centres(reference, expected, widths, 0.5)
    found = np.asarray(np.isfinite(points).all(axis=1))
    if not found[: len(markers)].any():
        raise GpusimError(
            f"measure {spec.name!r}: no marker of {list(spec.groups)} was found in the first image "
            f"of camera {spec.camera!r}; expected {len(markers)}"
        )
    tracked_rows = np.flatnonzero(found)
    chains = _chains(tracked_rows, len(markers), len(places))
    subset = spec.subset or _odd(SUBSET_SHARE * float(widths[: len(markers)].min()))
    tracked = measure.track(
        reference, deformed, points[tracked_rows],
        subset=subset, groups=chains, search_px=_search(points[tracked_rows], chains, subset),
        device=device,
    )  # fmt: skip
    matched, sigma = np.full_like(points, np.nan), np.full(len(places), np.nan)
    matched[tracked_rows], sigma[tracked_rows] = tracked.displacement, tracked.sigma
    # the fit of a marker's own cross is finer than the correlation of its sharp squares
    refined = _centres(deformed, points + matched, widths, REFINE_SHARE) - points
    moved = np.where(np.isfinite(refined), refined, matched)
    status = np.full(len(places), "NOT_FOUND", dtype=object)
    status[tracked_rows] = [measure.Status(s).name for s in tracked.status]

    count = len(markers)
    full = 2**scene.sensor.bits - 1
    gap = np.linalg.norm(refined - matched, axis=1)
    axes, plane = _image_axes(camera)
    ok = found[:count]
    scale = measure.scale_coefficient(points[:count][ok], 1e3 * position[ok] @ plane.T)
    motion = None
    if np.isfinite(moved[count:]).all(axis=1).any():
        motion = measure.rigid_motion(points[count:], moved[count:])
    line = measure.deflection_line(
        np.arange(count),
        np.where(ok[:, None], points[:count], expected[:count]),
        moved[:count],
        scale,
        sigma_px=sigma[:count],
        camera=motion,
    )
    corrected = moved[:count] - (motion.displacement(points[:count]) if motion else 0.0)
    truth, curves = _truth(groups, bodies, displacement, last, plane)
    return DeflectionResult(
        name=spec.name,
        camera=spec.camera,
        direction=spec.direction,
        axes=axes,
        marker=tuple(marker.name for _, _, marker in markers),
        group=tuple(paint.name for _, paint, _ in markers),
        status=tuple(str(s) for s in status[:count]),
        position_mm=1e3 * position,
        points_px=points[:count],
        displacement_px=corrected,
        measured_mm=line.displacement_mm,
        true_mm=truth,
        sigma_mm=line.sigma_mm,
        static_px=moved[count:],
        mm_per_px=scale.mm_per_px,
        mm_per_px_sigma=scale.sigma,
        mm_per_px_true=_true_scale(camera, position),
        scale_residual_px=scale.residual_px,
        subset_px=subset,
        saturated=tuple(
            marker.name
            for i, (_, _, marker) in enumerate(markers)
            if _clipped(reference, points[i], widths[i], full)
            or _clipped(deformed, points[i] + matched[i], widths[i], full)
        ),
        tilt_deg=_tilt(camera, plane),
        tracking_px=float(np.sqrt(np.nanmean(gap**2))) if np.isfinite(gap).any() else np.nan,
        curves=curves,
    )


def _centres(image: npt.NDArray[Any], near: Array, widths: Array, share: float) -> Array:
    """Fitted marker centres (M, 2) within ``share`` of a width of ``near``; NaN where none is."""
    points = np.full_like(near, np.nan)
    known = np.asarray(np.isfinite(near).all(axis=1))
    for width in np.unique(np.round(widths[known], 1)):
        rows = np.flatnonzero(known & (np.round(widths, 1) == width))
        located = measure.locate_markers(
            image, near[rows], (max(LEAST_WIDTH, 0.75 * width), 1.3 * width), share * float(width)
        )
        hit = located.status == measure.MarkerStatus.FOUND
        points[rows[hit]] = located.points[hit]
    return points


def _tilt(camera: Camera, plane: Array) -> float:
    """Degrees between the viewing direction and the normal of the measured plane (rows: axes)."""
    along = abs(float(camera.camera_from_world[2, :3] @ np.cross(plane[0], plane[1])))
    return float(np.degrees(np.arccos(min(along, 1.0))))


def _clipped(image: npt.NDArray[Any], at: Array, width: float, full: int) -> bool:
    """Whether more than four pixels of a marker are at full scale."""
    if not np.isfinite(at).all():
        return False
    x, y = np.rint(at).astype(int)
    half = int(0.6 * width) + 1
    window = image[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
    return int(np.count_nonzero(window >= full)) > 4


def _marker_paint(bodies: Sequence[BodyParts], name: str) -> tuple[int, m.Markers]:
    for index, parts in enumerate(bodies):
        for paint in parts.body.paints:
            if paint.name == name and isinstance(paint, m.Markers):
                return index, paint
    raise GpusimError(f"measure: no markers named {name!r} on any body")


def _widths(camera: Camera, places: Array, sizes: Array) -> Array:
    """Width of each marker in px, from its size and depth."""
    depth = camera.to_camera(places)[:, 2]
    result: Array = camera.K[0, 0] * sizes / depth
    return result


def _chains(rows: npt.NDArray[np.int64], movable: int, total: int) -> list[list[int]]:
    """The members' markers as one chain from the clamp, the static ones one by one."""
    index = {int(row): i for i, row in enumerate(rows)}
    chain = [index[row] for row in range(movable) if row in index]
    still = [[index[row]] for row in range(movable, total) if row in index]
    return [c for c in [chain, *still] if c]


def _search(points: Array, chains: list[list[int]], subset: int) -> int:
    """How far a marker is searched around its prediction: a third of the way to its neighbour."""
    gaps = [
        float(np.linalg.norm(np.diff(points[chain], axis=0), axis=1).min())
        for chain in chains
        if len(chain) > 1
    ]
    return int(np.clip(min(gaps, default=60.0) / 3.0, 4, 4 * subset))


def _odd(width: float) -> int:
    return max(9, 2 * int(np.floor(0.5 * (width - 1.0))) + 1)


def _image_axes(camera: Camera) -> tuple[tuple[str, str], Array]:
    """The two world axes nearest to the image's right and up, as names and as rows (2, 3)."""
    R = camera.camera_from_world[:3, :3]
    names, rows = [], []
    taken = -1
    for direction in (R[0], -R[1]):
        strength = np.abs(direction)
        if taken >= 0:
            strength[taken] = -1.0
        taken = int(np.argmax(strength))
        sign = 1.0 if direction[taken] > 0 else -1.0
        row = np.zeros(3)
        row[taken] = sign
        names.append(("+" if sign > 0 else "-") + "xyz"[taken])
        rows.append(row)
    return (names[0], names[1]), np.array(rows)


def _truth(
    groups: Sequence[tuple[int, m.Markers]],
    bodies: Sequence[BodyParts],
    displacement: Displacement,
    last: int,
    plane: Array,
) -> tuple[Array, dict[str, Array]]:
    """True displacement in the image's plane at the markers (M, 2) mm, and a curve per group."""
    at_markers, curves = [], {}
    for body, paint in groups:
        skin, u = bodies[body].skin, displacement(body, last) - displacement(body, 0)
        own = np.array([marker.position for marker in paint.markers])
        nodes, weights = skin.locate(own)
        at_markers.append(1e3 * np.einsum("mk,mka->ma", weights, u[nodes]) @ plane.T)
        share = np.linspace(0.0, 1.0, TRUTH_POINTS)[:, None]
        line = own[0] + share * (own[-1] - own[0])
        nodes, weights = skin.locate(line)
        along = 1e3 * np.linalg.norm(line - own[0], axis=1)
        values = 1e3 * np.einsum("mk,mka->ma", weights, u[nodes]) @ plane.T
        curves[paint.name] = np.concatenate([along[None], values.T])
    return np.concatenate(at_markers), curves


def _true_scale(camera: Camera, position: Array) -> float:
    """mm per px at the markers' mean depth."""
    return float(1e3 * camera.to_camera(position)[:, 2].mean() / camera.K[0, 0])
