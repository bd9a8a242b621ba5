"""A deflection line measured in the images of one camera, with its truth.

The measuring itself sees what a tester has: images, where the markers were put on the unloaded
structure, and the camera's rough place (to know which marker is which). The finite elements enter
only afterwards, as the truth that the result is compared with.
"""

from __future__ import annotations

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.deflection.projection_error import projection_error
from gpusim.pipeline.measurements.deflection.result import DeflectionResult
from gpusim.pipeline.measurements.kinds import Kind, Unloaded, register
from gpusim.pipeline.measurements.marker_checks import axial_loads, marker_warnings
from gpusim.pipeline.measurements.marker_measurement import track_markers
from gpusim.pipeline.measurements.marker_set import MarkerSet
from gpusim.pipeline.measurements.marker_tracking import MarkerTracks
from gpusim.pipeline.measurements.results import PointTable, vector_columns
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.scene_objects.cameras import image_axes
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.scene import Scene
from gpusim.scene.description import model as m

TRUTH_POINTS = 200


def measure_deflection(
    spec: m.DeflectionTable, scene: Scene, objects: SceneObjects, sources: Sources
) -> DeflectionResult:
    """Track the markers of ``spec`` from the first frame to every other one and scale to mm.

    Marker centres come from the first image (Harris corners, then a fit of the cross); IC-GN
    subsets follow them into the others, where the centres are fitted again.

    Raises
    ------
    InputError
        A marker is too small in the image, or behind the camera.
    GpusimError
        Fewer than two markers could be found in the reference image.
    """
    tracked = track_markers(spec, scene, objects, sources)
    marks, (camera,), tracks = tracked.marks, tracked.cameras, [*tracked.frames.values()]
    count, first = marks.count, tracks[0][0]
    points, ok = first.points[:count], first.found[:count]
    if np.count_nonzero(ok) < 2:
        found = f"only marker {marks.names[int(np.argmax(ok))]!r} of {count} was found"
        where = f"in the first image of camera {camera.name!r}"
        expected = "expected two at least: a scale needs two"
        raise GpusimError(f"measure {spec.name!r}: {found} {where}; {expected}")
    (view,) = (one for one in scene.cameras if one.name == spec.camera)
    axes, plane = image_axes(camera)
    in_plane = [axis[1] for axis in axes]
    position = marks.position[:count]
    scale = measure.scale_coefficient(points[ok], 1e3 * position[ok] @ plane.T)
    depth = camera.to_camera(position)[:, 2]
    start, true = marks.true_motion(objects, [*tracked.frames])
    drift, frames = marks.exposure_drift(objects, view), {}
    for (frame, seen), moved in zip(tracked.frames.items(), true, strict=True):
        shift, measured, sigma = _scaled(seen[0], count, scale)
        errors = projection_error(camera, position, moved, plane, scale=scale, used=ok, start=start)
        if not start.any():
            del errors["start"]
        if drift is not None:
            errors["exposure"] = 1e3 * (drift[frame] - drift[0]) @ plane.T
        frames[frame] = {
            **tracked.places(seen, least=1),
            **vector_columns("{}_px", ("column", "row"), points),
            **vector_columns("d{}_px", ("column", "row"), shift),
            **vector_columns("measured_{}_mm", in_plane, measured),
            **vector_columns("true_{}_mm", in_plane, 1e3 * moved @ plane.T),
            "sigma_mm": sigma,
            **tracked.flags(seen),
            "towards_mm": -1e3 * moved @ camera.camera_from_world[2, :3],
        }
        for part, values in errors.items():
            frames[frame] |= vector_columns(f"{part}_error_{{}}_mm", in_plane, values)
    return DeflectionResult(
        name=spec.name,
        table=PointTable.of("marker", marks.names[:count], frames),
        camera=spec.camera,
        direction=spec.direction,
        axes=axes,
        mm_per_px=scale.mm_per_px,
        mm_per_px_sigma=scale.sigma,
        mm_per_px_true=float(1e3 * depth.mean() / camera.K[0, 0]),
        scale_residual_px=scale.residual_px,
        subset_px=int(first.subset),
        tilt_deg=_tilt(camera, plane),
        static_px=np.array([one.displacement[count:] for (one,) in tracks]),
        tracking_px=np.array([one.tracking_px for (one,) in tracks]),
        curves=_curves(marks, objects, max(frames), plane),
    )


def _scaled(tracks: MarkerTracks, count: int, scale: measure.Scale) -> tuple[Float, Float, Float]:
    """Of the first ``count`` markers displacements (M, 2) less the camera's motion, in px and in
    mm, and their uncertainty (M,) in mm."""
    moved, points = tracks.displacement, tracks.points
    still = np.isfinite(moved[count:]).all(axis=1).any()
    motion = measure.rigid_motion(points[count:], moved[count:]) if still else None
    line = measure.deflection_line(
        np.arange(count),
        np.where(tracks.found[:count, None], points[:count], tracks.expected[:count]),
        moved[:count],
        scale,
        sigma_px=tracks.sigma[:count],
        camera=motion,
    )
    corrected = moved[:count] - (motion.displacement(points[:count]) if motion else 0.0)
    return corrected, line.displacement_mm, line.sigma_mm


def _tilt(camera: Camera, plane: Float) -> float:
    """Degrees between the viewing direction and the normal of the measured plane (rows: axes)."""
    along = abs(float(camera.camera_from_world[2, :3] @ np.cross(plane[0], plane[1])))
    return float(np.degrees(np.arccos(min(along, 1.0))))


def _curves(marks: MarkerSet, objects: SceneObjects, last: int, plane: Float) -> Float:
    """(G, 3, K) per group the place along it and the true displacement in the image's plane, mm."""
    curves = []
    for body, paint in marks.groups:
        skin = objects.bodies[body].skin
        u = objects.displacement(body, last) - objects.displacement(body, 0)
        own = np.array([marker.position for marker in paint.markers])
        share = np.linspace(0.0, 1.0, TRUTH_POINTS)[:, None]
        line = own[0] + share * (own[-1] - own[0])
        known = line if _in_a_row(own) else own  # between others there may be no surface
        nodes, weights = skin.locate(known)
        values = 1e3 * np.einsum("mk,mka->ma", weights, u[nodes]) @ plane.T
        if known is own:
            line, values = (_between(one, share[:, 0]) for one in (own, values))
        along = 1e3 * np.linalg.norm(line - own[0], axis=1)
        curves.append(np.concatenate([along[None], values.T]))
    return np.array(curves)


def _in_a_row(points: Float) -> bool:
    """Whether points (M, 3) lie on a straight line, to a millionth of its length."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1:].max(initial=0.0) <= 1e-6 * spread[0])


def _between(values: Float, share: Float) -> Float:
    """Rows of ``values`` (M, n), interpolated at shares (K,) of the way from first to last."""
    places = np.linspace(0.0, 1.0, len(values))
    return np.stack([np.interp(share, places, column) for column in values.T], axis=1)


def _checks(spec: m.DeflectionTable, scene: Scene, unloaded: Unloaded) -> list[str]:
    """A scale needs two markers in sight, and nothing that moves along the camera's axis."""
    sight = marker_warnings(spec, scene, unloaded, least=2)
    return [*sight, *axial_loads(spec, scene, unloaded.bodies)]


register(Kind(m.DeflectionTable, DeflectionResult, measure_deflection, _checks))
