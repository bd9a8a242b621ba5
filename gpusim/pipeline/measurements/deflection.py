"""A deflection line measured from the first and the last image of one camera, with its truth.

The measuring itself sees what a tester has: two images, where the markers were put on the unloaded
structure, and the camera's rough place (to know which marker is which). The finite elements enter
only afterwards, as the truth that the result is compared with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import Field, dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.errors import GpusimError
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.build.cameras import build_camera, build_sensor
from gpusim.pipeline.build.scene_objects import SceneObjects
from gpusim.pipeline.measurements.marker_detection import collect_markers
from gpusim.pipeline.measurements.marker_tracking import track_markers
from gpusim.pipeline.measurements.projection_error import PARTS, projection_error
from gpusim.pipeline.measurements.result_files import MarkerResult, csv_text
from gpusim.pipeline.measurements.sources import Sources
from gpusim.scene import Scene
from gpusim.scene.description import model as m

__all__ = ["DeflectionResult", "measure_deflection"]

Array = npt.NDArray[np.float64]
TRUTH_POINTS = 200
MOST_TILT_DEG = 1.0
"""Beyond it one scale coefficient is off by more than 0.015 %."""
LEAST_SHARE, SIGMAS = 1e-3, 3.0
"""An error of projection is told from this share of the largest displacement, and this many
standard uncertainties, on."""


@dataclass(frozen=True, eq=False)
class DeflectionResult(MarkerResult):
    """A deflection line measured from two images, and its truth.

    Per marker (M,), in the order from the clamp: ``marker`` names, ``group`` names,
    ``position_mm`` (M, 3) on the unloaded structure, ``points_px``, ``displacement_px`` (M, 2),
    ``measured_mm``, ``true_mm`` (M, 2) in the image plane's two world axes, ``sigma_mm``,
    ``status`` names. ``axes``: those axes, such as ("+x", "+z"). ``curves``: per group, (3, K)
    position along the group and the true displacement in both axes. ``static_px`` (S, 2): what the
    markers that can't move seemed to do. ``tracking_px``: RMS difference of the tracked subsets
    and the refined centres.
    ``tilt_deg``: how far the camera looks off the normal of the plane it measures in.
    ``axis_error_mm``, ``plane_error_mm``, ``lens_error_mm``, ``scale_error_mm`` (M, 2),
    ``towards_mm`` (M,): what one scale for the image makes of the true motion
    (`projection_error`).
    """

    name: str
    camera: str
    direction: str
    axes: tuple[str, str]
    marker: tuple[str, ...]
    group: tuple[str, ...]
    status: tuple[str, ...]
    position_mm: Array
    points_px: Array
    displacement_px: Array
    measured_mm: Array
    true_mm: Array
    sigma_mm: Array
    static_px: Array
    mm_per_px: float
    mm_per_px_sigma: float
    mm_per_px_true: float
    scale_residual_px: float
    subset_px: int
    tracking_px: float
    saturated: tuple[str, ...]
    unrefined: tuple[str, ...]
    tilt_deg: float
    axis_error_mm: Array
    plane_error_mm: Array
    lens_error_mm: Array
    scale_error_mm: Array
    towards_mm: Array
    curves: dict[str, Array]

    empty: ClassVar = {"static_px": (0, 2)}

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        return f"{self.measured_count} measured"

    @property
    def warnings(self) -> list[str]:
        """Markers that were not well measured, and what one scale for the image does."""
        found = self.marker_warnings()
        if not self.tilt_deg <= MOST_TILT_DEG:
            short = 100.0 * (1.0 - np.cos(np.radians(self.tilt_deg)))
            found.append(
                f"measure {self.name!r}: the camera looks {self.tilt_deg:.1f} degrees off the "
                f"normal of the plane {self.axes[0][1]}-{self.axes[1][1]}; one scale for the image "
                f"reads displacements up to {short:.2g} % short"
            )
        return found + self._projection()

    def _projection(self) -> list[str]:
        """What one scale for the whole image adds to the values of markers that were measured."""
        parts = {"axis": self.axis_error_mm, "plane": self.plane_error_mm,
                 "lens": self.lens_error_mm, "scale": self.scale_error_mm}  # fmt: skip
        found = []
        lost = ~np.isfinite(self.measured_mm).all(axis=1)
        largest = float(np.linalg.norm(self.true_mm, axis=1).max(initial=0.0))
        known = self.sigma_mm[np.isfinite(self.sigma_mm)]
        noise = float(np.median(known)) if known.size else 0.0
        for part, errors in parts.items():
            size = np.where(lost, 0.0, np.nan_to_num(np.linalg.norm(errors, axis=1)))
            worst = int(np.argmax(size))
            if not size[worst] > max(LEAST_SHARE * largest, SIGMAS * noise):
                continue
            k = int(np.argmax(np.abs(errors[worst])))
            wrong = self.measured_mm[worst, k] - self.true_mm[worst, k]
            why, advice = (
                PARTS[part],
                '; several cameras ([[measure]] type = "stereo") measure in space',
            )
            if part == "axis":
                comes = self.towards_mm[worst]
                way = "towards" if comes > 0 else "away from"
                why += f": {self.marker[worst]} moves {abs(comes):.3g} mm {way} the camera; that"
            elif part == "scale":
                why += (
                    f" ({self.mm_per_px:.5g} mm/px; {self.mm_per_px_true:.5g} at their depth): that"
                )
                advice = ""
            else:
                why += ": that"
            found.append(
                f"measure {self.name!r}: {why} explains {errors[worst, k]:+.3g} mm of the error of "
                f"{wrong:+.3g} mm along {self.axes[k]} at {self.marker[worst]}{advice}"
            )
        return found

    def tables(self) -> dict[str, str]:
        """``.csv``: one row for each marker."""
        a, b = (axis[1] for axis in self.axes)
        head = [
            "marker", "status", "x_mm", "y_mm", "z_mm", "column_px", "row_px", "dcolumn_px",
            "drow_px", f"measured_{a}_mm", f"measured_{b}_mm", f"true_{a}_mm", f"true_{b}_mm",
            "sigma_mm",
        ]  # fmt: skip
        rows = [
            [marker, self.status[i], *self.position_mm[i], *self.points_px[i],
             *self.displacement_px[i], *self.measured_mm[i], *self.true_mm[i], self.sigma_mm[i]]
            for i, marker in enumerate(self.marker)
        ]  # fmt: skip
        return {"": csv_text(head, rows)}

    @classmethod
    def field_of(cls, item: Field[Any], value: Any) -> Any:
        """As `MarkerResult.field_of`; the curves are arrays by group."""
        if item.name == "curves":
            return {group: np.array(curve, dtype=np.float64) for group, curve in value.items()}
        return super().field_of(item, value)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """What shapes arrays have to have."""
        count = len(self.marker)
        pairs = ("points_px", "displacement_px", "measured_mm", "true_mm", "axis_error_mm",
                 "plane_error_mm", "lens_error_mm", "scale_error_mm")  # fmt: skip
        return {
            "position_mm": (count, 3),
            **dict.fromkeys(pairs, (count, 2)),
            "sigma_mm": (count,),
            "towards_mm": (count,),
            "static_px": (len(self.static_px), 2),
        }

    def misfits(self) -> list[str]:
        """Curves of another shape than (3, K), and axes that aren't two."""
        wrong = [group for group, curve in self.curves.items() if curve.shape[:1] != (3,)]
        return wrong + (["axes"] if len(self.axes) != 2 else [])


def measure_deflection(
    spec: m.Deflection, scene: Scene, objects: SceneObjects, sources: Sources
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
    image = sources.image
    what, last = f"measure {spec.name!r}", len(scene.analysis.load_factors) - 1
    camera_spec = next(c for c in scene.cameras if c.name == spec.camera)
    camera = build_camera(camera_spec, scene.input)
    marks = collect_markers(what, spec.groups, spec.static, scene, objects.bodies)
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
    start, motion_m = marks.true_motion(objects, last)
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
        curves=_curves(marks.groups, objects, last, plane),
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


def _curves(
    groups: Sequence[tuple[int, m.Markers]], objects: SceneObjects, last: int, plane: Array
) -> dict[str, Array]:
    """Per group the place along it and the true displacement in the image's plane, mm."""
    curves = {}
    for body, paint in groups:
        skin = objects.bodies[body].skin
        u = objects.displacement(body, last) - objects.displacement(body, 0)
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
