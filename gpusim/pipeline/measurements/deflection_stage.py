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
from gpusim.errors import GpusimError
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.build.build import BodyParts
from gpusim.pipeline.build.cameras import build_camera
from gpusim.pipeline.build.photo import build_sensor
from gpusim.pipeline.measurements.deflection import DeflectionResult
from gpusim.pipeline.measurements.marker_tracking import MarkerSet, collect_markers, track_markers
from gpusim.pipeline.measurements.projection_error import projection_error
from gpusim.scene import Scene
from gpusim.scene.description import model as m

__all__ = ["measure_deflection"]

Array = npt.NDArray[np.float64]
Displacement = Callable[[int, int], Array]
TRUTH_POINTS = 200


def measure_deflection(
    spec: m.Deflection,
    scene: Scene,
    bodies: Sequence[BodyParts],
    displacement: Displacement,
    image: Callable[[str, int], npt.NDArray[Any]],
) -> DeflectionResult:
    """Track the markers of ``spec`` from the first frame to the last and scale to mm.

    Marker centres come from the first image (Harris corners, then a fit of the cross); IC-GN
    subsets follow them into the last image, where the centres are fitted again.

    Raises
    ------
    InputError
        A marker is too small in the image, or behind the camera.
    GpusimError
        Fewer than two markers could be found in the reference image.
    """
    what, last = f"measure {spec.name!r}", len(scene.analysis.load_factors) - 1
    camera_spec = next(c for c in scene.cameras if c.name == spec.camera)
    camera = build_camera(camera_spec, scene.input)
    marks = collect_markers(what, spec.groups, spec.static, scene, bodies)
    seen = track_markers(
        what, marks, camera, image(spec.camera, 0), image(spec.camera, last),
        subset=spec.subset, sensor=build_sensor(scene.sensor_of(spec.camera), camera_spec, 1.0),
    )  # fmt: skip
    count, points, moved = marks.count, seen.points, seen.displacement
    position, ok = marks.position[:count], seen.found[:count]
    axes, plane = _image_axes(camera)
    if np.count_nonzero(ok) < 2:
        raise GpusimError(
            f"{what}: only marker {marks.names[int(np.argmax(ok))]!r} of {count} was found in the "
            f"first image of camera {camera.name!r}; expected two at least: a scale needs two"
        )
    scale = measure.scale_coefficient(points[:count][ok], 1e3 * position[ok] @ plane.T)
    still = np.isfinite(moved[count:]).all(axis=1).any()
    motion = measure.rigid_motion(points[count:], moved[count:]) if still else None
    line = measure.deflection_line(
        np.arange(count),
        np.where(ok[:, None], points[:count], seen.expected[:count]),
        moved[:count],
        scale,
        sigma_px=seen.sigma[:count],
        camera=motion,
    )
    corrected = moved[:count] - (motion.displacement(points[:count]) if motion else 0.0)
    start, motion_m = _motion(marks, bodies, displacement, last)
    errors = projection_error(camera, position + start, motion_m, plane, scale=scale, used=ok)
    return DeflectionResult(
        name=spec.name,
        camera=spec.camera,
        direction=spec.direction,
        axes=axes,
        marker=marks.names[:count],
        group=marks.group_names[:count],
        status=seen.status[:count],
        position_mm=1e3 * position,
        points_px=points[:count],
        displacement_px=corrected,
        measured_mm=line.displacement_mm,
        true_mm=1e3 * motion_m @ plane.T,
        sigma_mm=line.sigma_mm,
        static_px=moved[count:],
        mm_per_px=scale.mm_per_px,
        mm_per_px_sigma=scale.sigma,
        mm_per_px_true=_true_scale(camera, position),
        scale_residual_px=scale.residual_px,
        subset_px=seen.subset,
        saturated=seen.saturated(count),
        unrefined=seen.by_correlation(count),
        tilt_deg=_tilt(camera, plane),
        tracking_px=seen.tracking_px,
        axis_error_mm=errors.axis,
        plane_error_mm=errors.plane,
        lens_error_mm=errors.lens,
        scale_error_mm=errors.scale,
        towards_mm=errors.towards_mm,
        curves=_curves(marks.groups, bodies, displacement, last, plane),
    )


def _tilt(camera: Camera, plane: Array) -> float:
    """Degrees between the viewing direction and the normal of the measured plane (rows: axes)."""
    along = abs(float(camera.camera_from_world[2, :3] @ np.cross(plane[0], plane[1])))
    return float(np.degrees(np.arccos(min(along, 1.0))))


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


def _motion(
    marks: MarkerSet, bodies: Sequence[BodyParts], displacement: Displacement, last: int
) -> tuple[Array, Array]:
    """True displacements (M, 3) in m of the markers on bodies in the first frame, and from there
    to the last."""
    parts, first = [], 0
    for body, paint in marks.groups:
        own = marks.position[first : first + len(paint.markers)]
        first += len(own)
        nodes, weights = bodies[body].skin.locate(own)
        u = np.stack([displacement(body, 0), displacement(body, last)])
        parts.append(np.einsum("mk,fmka->fma", weights, u[:, nodes]))
    start, end = np.concatenate(parts, axis=1)
    return start, end - start


def _curves(
    groups: Sequence[tuple[int, m.Markers]],
    bodies: Sequence[BodyParts],
    displacement: Displacement,
    last: int,
    plane: Array,
) -> dict[str, Array]:
    """Per group the place along it and the true displacement in the image's plane, mm."""
    curves = {}
    for body, paint in groups:
        skin, u = bodies[body].skin, displacement(body, last) - displacement(body, 0)
        own = np.array([marker.position for marker in paint.markers])
        share = np.linspace(0.0, 1.0, TRUTH_POINTS)[:, None]
        line = own[0] + share * (own[-1] - own[0])
        nodes, weights = skin.locate(line)
        along = 1e3 * np.linalg.norm(line - own[0], axis=1)
        values = 1e3 * np.einsum("mk,mka->ma", weights, u[nodes]) @ plane.T
        curves[paint.name] = np.concatenate([along[None], values.T])
    return curves


def _true_scale(camera: Camera, position: Array) -> float:
    """mm per px at the markers' mean depth."""
    return float(1e3 * camera.to_camera(position)[:, 2].mean() / camera.K[0, 0])
