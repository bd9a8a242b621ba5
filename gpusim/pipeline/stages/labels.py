"""labels.json: where bodies and props are in each frame, and where their markers and corners are in
the pictures, for who trains or tests what finds them.

Poses are exact for what is rigid, and of a deformed body the rigid motion that is nearest to that
of its surface (least squares over its vertices). Points stay on the triangle that they lie on at
rest, as paint does.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.mesh.boundary import Faces
from gpusim.mesh.nearest_places import nearest_on_surface
from gpusim.pipeline.measurements.material_points import MaterialPoints, TrueMotion
from gpusim.pipeline.scene_objects.moving_bodies import scene_objects
from gpusim.pipeline.scene_objects.surfaces import MIDDLES
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.scene.frames import FrameTable
from gpusim.surface import PaintFrame, Surface

FILE = "labels.json"
_PITCHES = {"checker": "cell", "charuco": "square", "dots": "pitch"}
"""Of grids, by the kind of paint: what a paint table calls it."""


def labels(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """Cameras, objects (bodies, then props) with the names of their points, and by frame a pose
    (4, 4) of each object, m, and by camera a row x, y, visibility of every point, px."""
    board, table = inputs.row
    frames = FrameTable(table)
    motion = TrueMotion(scene_objects(scene, inputs, [one.shown for one in frames], board))
    owners = [*scene.bodies, *(prop for prop in scene.props if prop.name != board)]
    objects, places = list[dict[str, Any]](), list[Float]()
    for owner, surface in zip(owners, motion.surfaces(None), strict=True):
        own = {paint.name: _points(paint, surface) for paint in owner.paints}
        names = [f"{one}-{k:02d}" for one in own for k in range(1, len(own[one]) + 1)]
        kind = "body" if len(objects) < len(scene.bodies) else "prop"
        objects.append({"name": owner.name, "kind": kind, "points": names})
        places.append(np.concatenate([*own.values(), np.zeros((0, 3))]))
    points = _on_surfaces(motion.surfaces(None), places)
    cameras = {one.name: motion.camera(one.name) for one in scene.cameras}
    states = []
    for number in range(len(frames)):
        inputs.progress(number / len(frames), f"frame {number}")
        poses = [rigid_motion(one.rest, one.points) for one in motion.surfaces(number)]
        seen = {name: _keypoints(motion, points, name, number) for name in cameras}
        states.append({"poses": poses, "keypoints": seen})
    pinholes = {
        name: {"K": one.K, "camera_from_world": one.camera_from_world,
               "distortion": () if one.distortion is None else one.distortion}
        for name, one in cameras.items()
    }  # fmt: skip
    content = {"cameras": pinholes, "objects": objects, "frames": states}
    text = json.dumps(content, default=np.ndarray.tolist)
    return StageResult({FILE: text.encode()}, words=f"{len(points)} points")


def rigid_motion(before: Float, after: Float) -> Float:
    """The rigid motion (4, 4) nearest to one of points (P, 3) (Kabsch, Acta Cryst. A32, 1976)."""
    middle, now = before.mean(axis=0), after.mean(axis=0)
    left, _, right = np.linalg.svd((after - now).T @ (before - middle))
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    pose = np.eye(4)
    pose[:3, :3] = left @ proper @ right
    pose[:3, 3] = now - pose[:3, :3] @ middle
    return pose


def _points(paint: m.Paint, surface: Surface) -> Float:
    """Places (P, 3) m at rest of a paint's markers, dots or inner corners."""
    frame = surface.frames.get(paint.name)
    if not isinstance(paint, m.PlainTable) and paint.type in MIDDLES:
        return np.array(paint.places)
    if paint.type not in _PITCHES or not isinstance(frame, PaintFrame):  # or round a cylinder
        return np.zeros((0, 3))
    inner = paint.type != "dots"
    size: Any = paint
    t, s = np.indices((size.rows - inner, size.columns - inner)).reshape(2, -1, 1) + inner
    pitch = getattr(paint, _PITCHES[paint.type])
    return np.asarray(size.places[0] + pitch * (s * frame.s_axis + t * frame.t_axis))


def _on_surfaces(surfaces: Sequence[Surface], places: Sequence[Float]) -> MaterialPoints:
    """Places (P, 3) of each surface as points of its triangles."""
    parts, first = [], 0
    for number, (surface, own) in enumerate(zip(surfaces, places, strict=True)):
        triangles = surface.topology.triangles
        none = np.zeros(len(triangles), np.int32)
        nodes = np.column_stack([triangles, none - 1]).astype(np.int32)
        at, _, shares = nearest_on_surface(Faces(nodes, none, none, surface.rest), own)
        whose = np.full(len(own), number)
        parts.append((whose, surface.topology.source[at], triangles[at] + first, shares[:, :3]))
        first += len(surface.points)
    return MaterialPoints(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _keypoints(motion: TrueMotion, points: MaterialPoints, camera: str, frame: int) -> Float:
    """Rows x, y, visibility as COCO has it: 2 seen, 1 hidden, 0 outside the picture."""
    lens, at = motion.camera(camera), motion.pixels(points, camera, frame)
    with np.errstate(invalid="ignore"):
        inside = np.all((at >= -0.5) & (at < [lens.width - 0.5, lens.height - 0.5]), axis=1)
    level = np.where(inside, 1 + motion.visible(points, camera, frame), 0)
    return np.column_stack([np.where(inside[:, None], at, 0.0), level])
