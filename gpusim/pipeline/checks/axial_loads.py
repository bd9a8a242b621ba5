"""Loads along the axis of a camera that measures a deflection: its image shows no such motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh import boundary_faces
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.build.build import BodyParts
from gpusim.pipeline.build.cameras import build_camera
from gpusim.pipeline.build.places import faces_of
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface.surface import face_normals

__all__ = ["axial_loads"]

Array = npt.NDArray[np.float64]
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
