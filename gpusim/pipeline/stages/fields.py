"""Pictures of the bodies in the colours of their fields, and how far forces move them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace

import cv2
import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.export.body_state import BodyState
from gpusim.export.field_catalogue import BODY
from gpusim.export.images import encoded_picture
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.motion import Motion, Oscillation, State, Stepped
from gpusim.pipeline.checks.linear_theory import stretched_shapes
from gpusim.pipeline.notes import notes_of
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.pipeline.scene_objects.load_steps import step_fields
from gpusim.pipeline.scene_objects.modelling import temperature
from gpusim.pipeline.scene_objects.moving_bodies import MovingBodies, moving_bodies
from gpusim.pipeline.scene_objects.solution import SceneSolution
from gpusim.pipeline.stages.mechanics import stored_steps
from gpusim.report import FieldPicture, LoadPath
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.scene.frames import FrameTable
from gpusim.visualization.body_picture import BodyPictures, DisplacedBody, extremes
from gpusim.visualization.turntable import ISOMETRIC, Turntable

CHEAP_CELLS = 20_000
"""Of meshes whose stress is recovered without being asked for: a fifth of a second."""
MATTERS = 0.1
"""Of the largest displacement: a component of this length is shown, if there are others."""
MOST_STATES = 101
"""Of a load path."""
ALIKE = 0.5
"""Of the largest compression: tension by as much is shown rather."""
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 6)
ROUNDED = 1e-6
"""Of the forces in supports: a resultant below that is what they are rounded by."""


def fields(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """Of the last frame in which a body has moved, of vibrations the one in which it moves most:
    displacement, the components that matter, and, where it is asked for or costs little, von Mises
    stress and the largest principal strain. Of frames that show modes, or of all phases at a
    frequency the one in which bodies move most: displacement alone, unless stress is asked for."""
    table, asked, word, modes = inputs.row
    frames = FrameTable(table)
    objects = moving_bodies(scene, inputs, [one.shown for one in frames])
    phases = [dict(one) for one in modes]
    looked = {frame: one[frame] for one in phases for frame in (_farthest(objects, list(one)),)}
    looked = looked or {_most_moved(objects, frames): ""}
    bodies = _displaced(objects, next(iter(looked)))
    cells = sum(body.skin.mesh.cell_count for body in bodies)
    solved = bool(inputs.get(f"model/{bodies[0].name}"))
    stressed = solved and (asked or (cells <= CHEAP_CELLS and not modes))
    facts = {} if stressed or not solved or modes else {
        "fields": f"no stress or strain of {cells} elements: [output] stress = true asks for them"
    }  # fmt: skip
    shown = [frame for frame in looked if objects.vibrations(frame)]
    warnings = stretched_shapes(objects, shown)
    notes = notes_of(warnings, facts, session.adapter) | {"path": None, "pictures": []}
    if not any(body.u.any() for body in bodies):
        return StageResult({}, notes, "nothing has moved")
    solved_linearly: SceneSolution | None = inputs.get("solution")
    if not objects.vibrations(next(iter(looked))):
        notes["path"] = asdict(_load_path(objects, frames, bodies, word, solved_linearly))
    if session.device is None:
        return StageResult({}, notes, "no pictures without a device")
    files: dict[str, bytes] = {}
    for frame, text in looked.items():
        bodies = _displaced(objects, frame)
        states = list(_states(objects, bodies, inputs, frame)) if stressed else [
            BodyState(body.skin.mesh, body.u) for body in bodies
        ]  # fmt: skip
        drawing = BodyPictures(session.device, bodies, _side(scene, bodies))
        for picture, data in _pictures(drawing, bodies, states, stressed, frame):
            if modes:
                name = f"fields/{frame:04d}-{picture.field}.png"
                picture = replace(picture, file=name, shown=f"{text}{_rates(objects, frame)}")
            files[picture.file] = data
            notes["pictures"].append(asdict(picture))
    return StageResult(files, notes, f"{len(files)} pictures")


def _displaced(objects: MovingBodies, frame: int) -> list[DisplacedBody]:
    return [
        DisplacedBody(parts.body.name, parts.skin, objects.displacement(number, frame))
        for number, parts in enumerate(objects.bodies)
    ]


def _most_moved(objects: MovingBodies, frames: FrameTable) -> int:
    """The last frame in which a body has moved; of bodies that vibrate the one in which one of them
    is displaced most."""
    moved = [one.number for one in frames if not one.shown.unloaded]
    if not objects.vibrations(moved[-1]):
        return moved[-1]
    return _farthest(objects, moved[:: 1 + len(moved) // MOST_STATES])


def _farthest(objects: MovingBodies, frames: Sequence[int]) -> int:
    """Of some frames the one in which a body is displaced most; of one there is no question."""
    far = [
        max(float(np.linalg.norm(body.u, axis=1).max()) for body in _displaced(objects, frame))
        for frame in (frames if len(frames) > 1 else ())
    ]
    return frames[int(np.argmax(far))] if far else frames[0]


def _rates(objects: MovingBodies, frame: int) -> str:
    """The frequencies at which bodies vibrate in a frame."""
    rates = [
        f"{objects.bodies[number].body.name} {motion.frequency(state):.5g} Hz"
        for number, (motion, state) in objects.vibrations(frame).items()
        if isinstance(motion, Oscillation) and motion.frequency(state)
    ]
    return f" ({', '.join(rates)})" if rates else ""


def _pictures(
    drawing: BodyPictures,
    bodies: Sequence[DisplacedBody],
    states: Sequence[BodyState],
    stressed: bool,
    frame: int,
) -> Iterator[tuple[FieldPicture, bytes]]:
    """Of each field that matters."""
    for name in _chosen(states, stressed):
        field = BODY[name]
        values = [field.values(state) for state in states]
        found = extremes(field, values).values()
        one = max(found, key=lambda extreme: abs(extreme.value), default=None)
        if one is None:
            continue
        body = bodies[one.body]
        x, y, z = (1e3 * body.skin.mesh.points[one.node]).tolist()
        picture = FieldPicture(
            name, field.title, field.unit, one.value, body.name, (x, y, z), frame, drawing.factor,
            f"fields/{name}.png",
        )  # fmt: skip
        yield picture, encoded_picture(drawing.draw(field, values), ".png", PNG)


def _states(
    objects: MovingBodies, bodies: Sequence[DisplacedBody], inputs: Inputs, frame: int
) -> Iterator[BodyState]:
    """The bodies as they were solved."""
    with stored_steps(inputs) as steps:
        for number, (parts, body) in enumerate(zip(objects.bodies, bodies, strict=True)):
            if isinstance(objects.motions[number], Stepped):
                shown = objects.frames[frame].states[number]
                known = step_fields(steps, number, shown) or {
                    "stress": np.zeros((len(body.u), 6)),
                    "strain": np.zeros((len(body.u), 6)),
                }
                yield BodyState(parts.mesh, body.u, known=known)
                continue
            model = inputs[f"model/{body.name}"].model
            change = temperature(parts.body, frame)
            yield BodyState(parts.mesh, body.u, model, parts.body.formulation, change)


def _chosen(states: Sequence[BodyState], stressed: bool) -> Iterator[str]:
    """Names of the fields that are shown."""
    yield "displacement"
    most = np.max([np.abs(state.u).max(axis=0) for state in states], axis=0)
    components = np.flatnonzero(most >= MATTERS * max(state.length.max() for state in states))
    if len(components) > 1:
        yield from (f"displacement_{'xyz'[k]}" for k in components)
    if stressed:
        yield "von_mises"
        first, third = (
            max(float(np.abs(BODY[f"principal_strain_{k}"].of(state)).max()) for state in states)
            for k in (1, 3)
        )
        yield "principal_strain_1" if first >= ALIKE * third else "principal_strain_3"
        if any(state.plastic_strain.any() for state in states):
            yield "plastic_strain"


def _side(scene: Scene, bodies: Sequence[DisplacedBody]) -> Turntable:
    """From where the camera looks, if there is one and it sees the bodies' middle, else from above
    a corner."""
    middle = np.concatenate([body.rest.points for body in bodies]).mean(axis=0)
    for spec in getattr(scene, "cameras", ()):
        camera = build_camera(spec, scene.input)
        x, y = camera.project(middle[None])[0]
        if -0.5 <= x < camera.width - 0.5 and -0.5 <= y < camera.height - 0.5:
            return Turntable().of_camera(camera, middle)
    return ISOMETRIC


def _load_path(
    objects: MovingBodies,
    frames: FrameTable,
    bodies: Sequence[DisplacedBody],
    word: str,
    solved: SceneSolution | None,
) -> LoadPath:
    """Of the node that moves most, along the way that it moves; the forces in its body's supports
    along their resultant, or on one that is moved along the greatest of them."""
    far = [float(np.linalg.norm(body.u, axis=1).max()) for body in bodies]
    number = int(np.argmax(far))
    body, motion = bodies[number], objects.motions[number]
    node = int(np.linalg.norm(body.u, axis=1).argmax())
    shown = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_STATES)).astype(int))
    states = [frames[frame].shown.states[number] for frame in shown]
    assert motion is not None  # it moves
    driven = _driven(objects, frames, number)
    held = slice(None) if driven is None else slice(driven, driven + 1)
    moved, forces, most = _followed(motion, states, node, held)
    loads = objects.bodies[number].body.loads
    pulled = driven is not None or any(not isinstance(load, m.ThermalTable) for load in loads)
    if not (pulled and np.linalg.norm(forces, axis=1).max() > ROUNDED * most):
        forces[:] = 0.0  # what heat alone moves holds itself
    x, y, z = (1e3 * body.skin.mesh.points[node]).tolist()
    path = LoadPath(
        body.name, (x, y, z), word.replace("_", " "), tuple(shown.tolist()),
        tuple(frames[frame].factor for frame in shown),
        tuple((1e3 * _along(moved)).tolist()), tuple(_along(forces).tolist()),
        support="" if driven is None else objects.bodies[number].body.supports[driven].name,
    )  # fmt: skip
    if solved is None or not isinstance(motion, Stepped):
        return path
    cases = len(solved.u[number])
    weights = [None if state is None else state[:cases] for state in states]
    linear, linear_forces, _ = _followed(solved.superposed(number), weights, node, held)
    return replace(
        path,
        linear_mm=tuple((1e3 * _along(linear, moved)).tolist()),
        linear_N=tuple(_along(linear_forces, forces).tolist()),
    )


def _followed(
    motion: Motion, states: Sequence[State | None], node: int, held: slice
) -> tuple[Float, Float, float]:
    """(F, 3) displacements of a node and (F, 3) sums of the forces in supports that are ``held``,
    in the states of frames; and the greatest sum of the sizes of all supports' forces."""
    moved, forces = np.zeros((2, len(states), 3))
    most = 0.0
    for k, state in enumerate(states):
        if state is not None:
            reactions = motion.reactions(state)
            moved[k], forces[k] = motion.displacement(state)[node], reactions[held].sum(axis=0)
            most = max(most, float(np.linalg.norm(reactions, axis=1).sum()))
    return moved, forces, most


def _driven(objects: MovingBodies, frames: FrameTable, number: int) -> int | None:
    """Which of a body's supports moves it with the greatest force, if any does: together, they
    would hold each other."""
    supports, motion = objects.bodies[number].body.supports, objects.motions[number]
    moving = [k for k, support in enumerate(supports) if any(support.displacement_mm)]
    states = [frame.shown.states[number] for frame in frames]
    forces = [motion.reactions(one) for one in states if one is not None and motion is not None]
    sizes = [max(np.linalg.norm(one[k]) for one in forces if k < len(one)) for k in moving]
    return moving[int(np.argmax(sizes))] if moving else None


def _along(vectors: Float, way: Float | None = None) -> Float:
    """Components of vectors (F, 3) along the longest of them, or of those of a ``way``."""
    way = vectors if way is None else way
    longest = way[np.linalg.norm(way, axis=1).argmax()]
    return np.asarray(vectors @ longest / max(float(np.linalg.norm(longest)), 1e-300))
