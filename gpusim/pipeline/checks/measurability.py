"""Whether pictures can be measured: markers in sight and focus, sizes of discs, axial loads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh import boundary_faces
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.build.cameras import build_camera, build_lens
from gpusim.pipeline.build.meshing import faces_of
from gpusim.pipeline.build.surfaces import BodyParts
from gpusim.pipeline.checks.visibility import unseen
from gpusim.pipeline.measurements.marker_detection import MarkerSet, check_widths, collect_markers
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface import Surface
from gpusim.surface.paint import Speckle
from gpusim.surface.surface import face_normals

__all__ = ["axial_loads", "disc_warnings", "marker_warnings", "pixels_per_metre"]

Array = npt.NDArray[np.float64]
MOSAIC_PX, GAMMA_PX = {"bilinear": 0.1, "malvar": 0.04}, 0.02  # RMS, of markers of 15 to 24 px
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
            found += _developed(what, scene.sensor_of(camera.name), camera.name)
    return found


def _developed(what: str, sensor: m.Sensor, camera: str) -> list[str]:
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


LEAST, MOST = 2.0, 15.0
"""Pixels per disc: below, a disc is aliased to a dot that changes with its place on the grid;
above, a subset has to be large to hold three of them."""
DISCS = 3  # a subset should hold in a row
AIM = "aim at 3 to 5"
LOOKED_AT = 64  # points of a region, at least, to see whether all of it is hidden


def disc_warnings(surfaces: Sequence[Surface], cameras: Sequence[Camera]) -> list[str]:
    """A sentence for each speckle that a camera sees with too few or too many pixels per disc."""
    found = []
    for camera in cameras:
        for surface in surfaces:
            for region, (name, paint) in enumerate(surface.paints.items()):
                if not isinstance(paint, Speckle):
                    continue
                scale = pixels_per_metre(surface, region, camera)
                size = paint.diameter * scale
                if LEAST <= size <= MOST or _hidden(surface, region, camera, surfaces):
                    continue
                what = f"camera {camera.name!r}: the discs of speckle {name!r} on {surface.name!r}"
                if size < LEAST:
                    found.append(
                        f"{what} are {size:.2g} px wide ({1e3 * paint.diameter:.3g} mm); below "
                        f"{LEAST:g} px they alias, and correlation is biased: {AIM} px"
                    )
                elif size > MOST:
                    found.append(
                        f"{what} are {size:.3g} px wide ({1e3 * paint.diameter:.3g} mm); above "
                        f"{MOST:g} px a subset needs {DISCS * size:.0f} px to hold {DISCS} of "
                        f"them: {AIM} px"
                    )
    return found


def pixels_per_metre(surface: Surface, region: int, camera: Camera) -> float:
    """Mean scale at which a camera sees a region: the root of pixels over square metres.

    Of triangles in its image that face it (whichever side of an open surface); NaN if none does.
    """
    topology = surface.topology
    corners = _corners(surface, region)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=1)
    seen = (camera.to_camera(corners)[..., 2] > 0.0).all(axis=1)
    if topology.closed:
        seen &= np.einsum("ti,ti->t", normal, camera.eye - middle) > 0.0
    flat = camera.without_distortion()
    pixels, normal = flat.project(corners[seen]), normal[seen]
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    size = np.array([camera.width, camera.height])
    inside = ((high >= -0.5) & (low <= size - 0.5)).all(axis=1)
    pixels, normal = pixels[inside], normal[inside]
    one, two = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    shown = float(np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]).sum())
    real = float(np.linalg.norm(normal, axis=1).sum())
    return float(np.sqrt(shown / real)) if real > 0.0 else float("nan")


def _corners(surface: Surface, region: int) -> Array:
    """The triangles (T, 3, 3) of a region."""
    topology = surface.topology
    own = topology.triangles[surface.regions[topology.source] == region]
    corners: Array = surface.points[own]
    return corners


def _hidden(surface: Surface, region: int, camera: Camera, surfaces: Sequence[Surface]) -> bool:
    """Whether the camera sees none of points that are spread over a region."""
    corners = _corners(surface, region)
    corners = corners[:: max(1, len(corners) // LOOKED_AT)]
    each = -(-LOOKED_AT // max(1, len(corners)))
    # spread over a triangle evenly: the plastic number's sequence, folded
    s, t = (np.arange(1, each + 1)[:, None] * [0.7548776662, 0.5698402910] % 1.0).T
    s, t = np.where(s + t > 1.0, 1.0 - s, s), np.where(s + t > 1.0, 1.0 - t, t)
    weights = np.stack([1.0 - s - t, s, t], axis=1)
    points = np.einsum("kc,tca->tka", weights, corners).reshape(-1, 3)
    size = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).repeat(each)
    return all(unseen(camera, points, size, surfaces))


LEAST_ERROR = 1e-3
"""Of the motion; a structure that yields to its loads alike in all directions is off so far."""


def axial_loads(scene: Scene, bodies: Sequence[BodyParts]) -> list[str]:
    """A sentence for each load that moves what a single camera measures along its axis."""
    found = []
    for spec in scene.measures:
        if not isinstance(spec, m.Deflection):
            continue
        camera = build_camera(next(one for one in scene.cameras if one.name == spec.camera))
        forward = camera.camera_from_world[2, :3]
        for parts in bodies:
            paints = [
                paint for paint in parts.body.paints
                if isinstance(paint, m.Markers) and paint.name in spec.groups
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


def _steepest(camera: Camera, places: Array) -> float:
    """How far off the axis markers are, over their distance: the greatest."""
    x, y, z = camera.to_camera(places).T
    ahead = z > 0.0
    return float((np.hypot(x, y)[ahead] / z[ahead]).max(initial=0.0))


def _vectors(parts: BodyParts) -> Iterator[tuple[str, Array]]:
    """What acts on a body in a known direction, with its name."""
    for load in parts.body.loads:
        if not any(load.amplitude):
            continue
        vector = None
        if isinstance(load, m.Force | m.NodalForce | m.LineForce):
            vector = np.array(load.force)
        elif isinstance(load, m.Traction):
            vector = np.array(load.traction)
        elif isinstance(load, m.Gravity):
            vector = np.array(load.acceleration)
        elif isinstance(load, m.Pressure) and load.pressure:
            vector = _resultant(parts, load.where)
        if vector is not None and vector.any():
            yield f"load {load.name!r}", vector
    for support in parts.body.supports:
        moved = np.array(support.displacement)
        if moved.any() and any(support.amplitude):
            yield f"the displacement of support {support.name!r}", moved


def _resultant(parts: BodyParts, where: m.Where) -> Array:
    """The way (3,) that an even pressure on faces pushes as a whole; zero if it is balanced."""
    try:
        faces = faces_of(parts.mesh, boundary_faces(parts.mesh), where)
    except InputError:
        return np.zeros(3)  # told when the body's model is made
    normals = face_normals(parts.mesh.points, faces.nodes[:, :4])
    whole: Array = -normals.sum(axis=0)
    least = 1e-9 * float(np.linalg.norm(normals, axis=1).sum())
    return whole if float(np.linalg.norm(whole)) > least else np.zeros(3)
