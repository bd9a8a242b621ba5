"""truth.h5: what every pixel that sees a body sees, in every frame, and the bodies' nodes.

What a camera sees is found by a stage of its own, and put into one file with what the others see,
as it is packed: a new camera leaves the others alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.arrays.array_types import Float, Int, Long
from gpusim.export.truth import TruthWriter
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.optics.frame import Frame
from gpusim.optics.lens.shutter import rolled
from gpusim.optics.rendering.local_origin import local_view
from gpusim.optics.truth import BAND, Truth, seen_in
from gpusim.pipeline.measurements.material_points import MaterialPoints, TrueMotion
from gpusim.pipeline.notes import notes_of
from gpusim.pipeline.pictures.image_window import Window, whole_window, window_of
from gpusim.pipeline.scene_objects.cameras import build_camera, build_shutter, opening
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects, scene_objects
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.scene.frames import FrameTable, Instant
from gpusim.surface import Surface

Sight = tuple[Frame, Window, Long]
_WHOLE, _PART = "truth.h5", ".truth.h5"
EMPTY = (
    "truth.h5 has cameras alone: its layers are of bodies, and this scene has none. Truth of props "
    "is in Python's scene.motion()"
)


def truth(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The whole file: mesh and nodes, and the cameras of the stages that are named."""
    made, table = inputs.row
    frames = FrameTable(table)
    objects = scene_objects(scene, inputs, [one.shown for one in frames])
    path = inputs.new_file(_WHOLE)
    bodies = objects.bodies
    regions = [f"{parts.body.name}/{name}" for parts in bodies for name in parts.surface.paints]
    attributes = {
        "version": __version__,
        "scene": scene.name,
        "pixels": "those that see a body",
        "cameras": ", ".join(name for names in made.values() for name in names),
    }
    with TruthWriter(path, regions=regions, attributes=attributes) as file:
        if bodies:
            _write_nodes(file, objects, frames, scene.analysis.word)
        for number, (stage, names) in enumerate(made.items()):
            inputs.progress(number / len(made), f"takes in {', '.join(names)}")
            with inputs.open(stage, _PART) as part:
                file.take_cameras(part, names)
    notes = notes_of([] if bodies else [EMPTY])
    return StageResult({_WHOLE: path}, notes, _WHOLE, dict.fromkeys(made, _WHOLE))


def seen(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The layers that the scene asks for, of its cameras; frame by frame, so that no two are held
    at once."""
    board, table = inputs.row
    frames = FrameTable(table)
    objects = scene_objects(scene, inputs, [one.shown for one in frames], board)
    path = inputs.new_file(_PART)
    with TruthWriter(path) as file:
        _write_cameras(file, scene)
        _write_frames(file, objects, frames, scene.analysis.word, session, inputs.progress)
    return StageResult({_PART: path}, notes_of(adapter=session.adapter), f"{len(frames)} frames")


def _write_cameras(file: TruthWriter, scene: Scene) -> None:
    for spec in scene.cameras:
        camera, shutter = build_camera(spec, scene.input), build_shutter(spec)
        file.write_camera(
            spec.name,
            width=camera.width,
            height=camera.height,
            K=camera.K,
            camera_from_world=camera.camera_from_world,
            distortion=() if camera.distortion is None else camera.distortion,
            line_time=0.0 if shutter is None else shutter.line_time,
            exposure_time=0.0 if shutter is None else shutter.exposure_time,
        )


def _write_frames(
    file: TruthWriter,
    objects: SceneObjects,
    frames: FrameTable,
    word: str,
    session: Session,
    progress: Callable[[float, str], None],
) -> None:
    scene, wanted = objects.scene, objects.scene.output.truth
    rest = {spec.name: sight(objects, spec, frames, None, session) for spec in scene.cameras}
    forward = ForwardFlow(objects) if "forward_flow" in wanted else None
    for number, _, _, shown in frames:
        progress(number / len(frames), f"frame {number}")
        moved = not shown.still
        now = rest if not moved else {
            spec.name: sight(objects, spec, frames, number, session) for spec in scene.cameras
        }  # fmt: skip
        for spec in scene.cameras:
            late = {} if spec.trigger is None else {"late_s": spec.late(number)}
            frame = file.frame(spec.name, number, **_when(frames[number], word), **late)
            seen, window, cells = now[spec.name]
            others = [other for other, *_ in now.values()]
            before = rest[spec.name][0] if moved else None
            for band in seen.truth_bands(faces=(0, len(cells))):
                if not len(band.row):
                    continue
                place = band.row + window.top, band.column + window.left
                for layer in (one for one in wanted if one != "forward_flow"):
                    frame.write_sparse(layer, *place, _values(layer, band, before, others, cells))
            if forward is not None:
                frame.write_sparse("forward_flow", *forward.of(spec.name, number))
            if "cameras" not in wanted and moved:
                del now[spec.name]  # its ids are needed no longer


class ForwardFlow:
    """Where what each pixel of frame 0 sees of the bodies is in other frames."""

    def __init__(self, objects: SceneObjects) -> None:
        self._motion = TrueMotion(objects)
        self._points: dict[str, tuple[Float, MaterialPoints]] = {}

    def of(self, camera: str, frame: int) -> tuple[Long, Long, Float]:
        """Rows and columns (n,) in frame 0, and the way (n, 2) px from there."""
        if camera not in self._points:
            lens = self._motion.camera(camera)
            row, column = np.indices((lens.height, lens.width)).reshape(2, -1)
            pixels = np.stack([column, row], axis=1).astype(np.float64)
            points = self._motion.seen_at(camera, pixels)
            own = self._motion.body(points) >= 0
            self._points[camera] = pixels[own], points[own]
        pixels, points = self._points[camera]
        flow = self._motion.pixels(points, camera, frame) - pixels
        ahead = np.isfinite(flow).all(axis=1)
        column, row = pixels[ahead].astype(np.int64).T
        return row, column, flow[ahead]


def sight(
    objects: SceneObjects,
    spec: m.CameraTable,
    frames: FrameTable,
    frame: int | None,
    session: Session,
    bodies: int | None = None,
) -> Sight:
    """What a camera sees in a frame, unloaded for None, without shading: only where the first
    surfaces may be, those of the ``bodies``; where that is in its image; and the elements of the
    bodies' faces in it."""
    scene = objects.scene
    viewer, shutter = build_camera(spec, scene.input), build_shutter(spec)
    rate = scene.analysis.frame_rate
    late = 0.0 if frame is None else spec.late(frame)
    rolls = shutter is not None and shutter.line_time
    if frame is not None and (rolls or late):
        near = frames.near(frame, wide=rate is not None)
        now = objects.around(near, frame, (near[-1] - near[0]) / (rate or 1.0))
        if now is not None:
            surfaces = now(late)
            if shutter is not None and rolls:
                middle = opening(shutter, viewer) + 0.5 * shutter.exposure_time + late
                surfaces, viewer = rolled(now, lambda _: viewer, middle, shutter.line_time)
            return (Frame(local_view(surfaces, viewer, lit=True), session.device),
                    whole_window(viewer), _cell_of_face(objects, surfaces))  # fmt: skip
    shown = objects.surfaces(frame)
    looked_for = shown[: len(objects.bodies) if bodies is None else bodies]
    window = window_of(looked_for, viewer, BAND) if session.options.skip else None
    window = window or whole_window(viewer)
    frame_there = Frame(local_view(shown, window.camera(viewer), lit=True), session.device)
    return frame_there, window, _cell_of_face(objects, shown)


def _values(
    layer: str,
    truth: Truth,
    before: Frame | None,
    others: Sequence[Frame],
    cells: Long,
) -> npt.NDArray[np.generic]:
    """A layer at the pixels of a band; ``before``: the frame at rest, None if this is that one."""
    if layer == "element":
        return cells[truth.face]
    if layer == "visibility":
        if before is None:
            return np.ones(len(truth.row), np.int8)
        return seen_in(before.view, before.ids(), truth.reference).astype(np.int8)
    if layer == "cameras":
        points = truth.reference + truth.displacement
        bits = np.zeros(len(points), np.int32)
        for number, other in enumerate(others):
            bits |= seen_in(other.view, other.ids(), points).astype(np.int32) << number
        return bits
    return np.asarray(getattr(truth, layer))


def _cell_of_face(objects: SceneObjects, surfaces: Sequence[Surface]) -> Long:
    """The element, counted over all bodies, of every face of the bodies' ``surfaces``, in which a
    rolling shutter may have faces cut into several."""
    first = np.cumsum([0, *(parts.mesh.cell_count for parts in objects.bodies)])
    cells = [
        np.repeat(body.skin.cell_of_piece + start, len(one.faces) // len(body.surface.faces))
        for body, start, one in zip(objects.bodies, first, surfaces, strict=False)
    ]
    return np.concatenate(cells or [np.zeros(0, np.int64)])


def _write_nodes(file: TruthWriter, objects: SceneObjects, frames: FrameTable, word: str) -> None:
    """Mesh and nodal displacement, bodies one after the other as in the layer ``element``."""
    bodies = objects.bodies
    first_node = np.cumsum([0, *(parts.mesh.node_count for parts in bodies)])
    cells: dict[str, list[Int]] = {}
    for parts, first in zip(bodies, first_node, strict=False):
        for kind, block in parts.mesh.cells.items():
            cells.setdefault(kind, []).append(block + np.int32(first))
    points = np.concatenate([parts.mesh.points for parts in bodies])
    file.write_mesh(points, {kind: np.concatenate(blocks) for kind, blocks in cells.items()})
    for step, *_ in frames:
        u = np.concatenate([objects.displacement(body, step) for body in range(len(bodies))])
        file.write_nodal_displacement(step, u, **_when(frames[step], word))


def _when(frame: Instant, word: str) -> dict[str, float]:
    """When a frame is: its load factor or what it has, and its time (s) if it is in time."""
    return {word: frame.factor} | ({} if frame.time is None else {"time_s": frame.time})
