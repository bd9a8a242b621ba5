"""Whether a scene's markers can be measured: in sight and in focus of their cameras, and not moved
along the axis of a single one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.mesh import boundary_faces
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.kinds import Unloaded
from gpusim.pipeline.measurements.marker_set import MarkerSet, check_widths, collect_markers
from gpusim.pipeline.pictures.visibility import unseen
from gpusim.pipeline.scene_objects.cameras import build_camera, build_lens
from gpusim.pipeline.scene_objects.meshing import faces_of
from gpusim.pipeline.scene_objects.surfaces import BodyParts
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface.surface import face_normals

MOST_BLUR = 0.15  # of a marker's width: a cross blurred by more has its border in its middle
NAMED = 6
MOSAIC_PX, GAMMA_PX = {"bilinear": 0.1, "malvar": 0.04}, 0.02  # RMS, of markers of 15 to 24 px


def marker_warnings(
    spec: m.MarkerMeasureTable, scene: Scene, unloaded: Unloaded, *, least: int
) -> list[str]:
    """Markers that a camera of their measure can't see, or sees blurred.

    Raises InputError, if ``unloaded`` is strict, for a measure that can't work: fewer than
    ``least`` markers are seen, or one is too small.
    """
    found = []
    strict, what = unloaded.strict, f"measure {spec.name!r}"
    marks = collect_markers(spec, scene, unloaded.bodies)
    for camera_spec in (one for one in scene.cameras if one.name in spec.views):
        camera = build_camera(camera_spec)
        if strict and camera.name in unloaded.blind:
            raise InputError(f"{what}: {unloaded.blind[camera.name]}")
        reasons = unseen(camera, marks.position[: marks.count], marks.size, unloaded.surfaces)
        lost = [f"{name} ({why})" for name, why in zip(marks.names, reasons, strict=False) if why]
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
        found += _developed(what, scene.sensor_of(camera.name), camera.name)
    return found


def _developed(what: str, sensor: m.SensorTable, camera: str) -> list[str]:
    """A sentence for markers that are measured in pictures made for the eye."""
    parts = []
    if sensor.demosaic is not None:
        parts.append(
            f"the mosaic (demosaic {sensor.demosaic!r}) by about {MOSAIC_PX[sensor.demosaic]} px"
        )
    if sensor.gamma not in (None, 1.0):
        parts.append(f"gamma {sensor.gamma!r} by about {GAMMA_PX} px")
    if not parts:
        return []
    return [
        f"{what}: camera {camera!r} develops pictures for the eye, which moves centres of markers: "
        f"{' and '.join(parts)} (RMS); measure linear ones of three chips or mono, or see with "
        "`gpusim budget` what each does here"
    ]


def _blurred(what: str, marks: MarkerSet, spec: m.CameraTable, camera: Camera) -> list[str]:
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


LEAST_ERROR = 1e-3
"""Of the motion; a structure that yields to its loads alike in all directions is off so far."""


def axial_loads(spec: m.DeflectionTable, scene: Scene, bodies: Sequence[BodyParts]) -> list[str]:
    """A sentence for each load that moves what a single camera measures along its axis."""
    found = []
    camera = build_camera(next(one for one in scene.cameras if one.name == spec.camera))
    forward = camera.camera_from_world[2, :3]
    for parts in bodies:
        paints = [
            paint for paint in parts.body.paints
            if isinstance(paint, m.MarkersTable) and paint.name in spec.groups
        ]  # fmt: skip
        if not paints:
            continue
        places = np.array([one.position for paint in paints for one in paint.markers])
        slope = _steepest(camera, places)
        for name, vector in _vectors(parts):
            share = float(vector @ forward) / float(np.linalg.norm(vector))
            if not abs(share) * slope > LEAST_ERROR:
                continue
            found.append(
                f"measure {spec.name!r}: {name} acts along the axis of camera {camera.name!r} "
                f"with {100 * abs(share):.0f} % of its size; motion along the axis changes the "
                f"scale: 1 mm of it reads as up to {slope:.2g} mm across"
            )
    return found


def _steepest(camera: Camera, places: Float) -> float:
    """How far off the axis markers are, over their distance: the greatest."""
    x, y, z = camera.to_camera(places).T
    ahead = z > 0.0
    return float((np.hypot(x, y)[ahead] / z[ahead]).max(initial=0.0))


def _vectors(parts: BodyParts) -> Iterator[tuple[str, Float]]:
    """What acts on a body in a known direction, with its name."""
    for load in parts.body.loads:
        if not any(load.amplitude):
            continue
        given = [getattr(load, key, None) for key in ("force", "traction", "acceleration")]
        vector = next((np.array(one) for one in given if one is not None), np.zeros(3))
        if isinstance(load, m.PressureTable) and load.pressure:
            vector = _resultant(parts, load.where)
        if vector.any():
            yield f"load {load.name!r}", vector
    for support in parts.body.supports:
        moved = np.array(support.displacement)
        if moved.any() and any(support.amplitude):
            yield f"the displacement of support {support.name!r}", moved


def _resultant(parts: BodyParts, where: m.WhereTable) -> Float:
    """The way (3,) that an even pressure on faces pushes as a whole; zero if it is balanced."""
    try:
        faces = faces_of(parts.mesh, boundary_faces(parts.mesh), where)
    except InputError:
        return np.zeros(3)  # told when the body's model is made
    normals = face_normals(parts.mesh.points, faces.nodes[:, :4])
    whole: Float = -normals.sum(axis=0)
    least = 1e-9 * float(np.linalg.norm(normals, axis=1).sum())
    return whole if float(np.linalg.norm(whole)) > least else np.zeros(3)
