"""Content from a file: a scene, a run's output folder, a mesh or a CAD file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.mesh import boundary_faces, read_mesh, read_surface
from gpusim.mesh.formats.cad import CAD_SUFFIXES
from gpusim.mesh.formats.cad_cache import cached_cad_mesh
from gpusim.mesh.formats.reader import MESH_SUFFIXES
from gpusim.motion import Given, Motion, Stepped
from gpusim.pipeline.checks.resources import check_memory
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.pipeline.scene_objects.load_steps import STEPS, stepped_motion
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.pipeline.scene_objects.solution import SceneSolution
from gpusim.pipeline.scene_objects.surfaces import build_body, build_prop
from gpusim.pipeline.scene_objects.vibrations import VIBRATION, Stored, stored_vibration
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene, load_scene
from gpusim.scene.cost import Counts
from gpusim.scene.description.prop import SURFACE_SUFFIXES
from gpusim.scene.frames import frame_table
from gpusim.scene.tables.table import FileUnit, file_unit, metres
from gpusim.surface.skin import Skin
from gpusim.surface.surface import Surface
from gpusim.validation import require
from gpusim.view.content.content import Content
from gpusim.view.content.measured_points import measured_points
from gpusim.view.picture.neutral import PAINT

STEP = (".step", ".stp")

COARSE_MM = 1e6
"""Greatest element of a part that is only looked at: curved faces alone decide."""

CURVED = 24
"""Elements around a full circle there."""


def load_content(
    path: Path, unit: FileUnit | None = None, earlier: Content | None = None
) -> Content:
    """What a window shows of ``path``: a scene (.toml), OUT of ``gpusim run``, a mesh or CAD file,
    whose coordinates are in ``unit``, as they would be for a scene (mm unless said, of glTF m; a
    STEP file says its own). Meshes of an ``earlier`` state of a scene are taken from there.

    Raises
    ------
    InputError, SceneError
        A ``unit`` of what says its own; nothing there, an unknown ending, a folder without
        scene.toml; whatever the file's own reader says.

    Examples
    --------
    >>> from gpusim.view.content.loading import load_content
    >>> load_content(Path("bar.toml")).title
    'bar'
    """
    suffix = path.suffix.lower()
    says_own = path.is_dir() or suffix in (".toml", *STEP)
    fits = unit in (None, "mm") or not says_own
    require(fits, "view --unit", f"{unit!r} for {path}", "none: it says its own")
    if path.is_dir():
        return _run(path)
    if suffix == ".toml":
        return _scene(path, earlier)
    known = sorted({*MESH_SUFFIXES, *SURFACE_SUFFIXES, *CAD_SUFFIXES})
    expected = f"a scene (.toml), the output folder of a run, or a mesh: {' '.join(known)}"
    require(suffix in known, f"view {path}", repr(suffix or "no ending"), expected)
    surface, skins = _part(path, suffix, metres(unit or file_unit(path.name)))
    return Content(path.name, (path,), parts=(surface,), part_skins=skins)


def _part(path: Path, suffix: str, scale: float) -> tuple[Surface, list[Skin]]:
    file = read_input(path, "a mesh or CAD file")
    if suffix in SURFACE_SUFFIXES:  # an STL is shown as it is, closed or not
        points, faces = read_surface(file)
        return Surface(scale * points, faces, PAINT, name=path.stem), []
    if suffix in CAD_SUFFIXES:
        mesh = cached_cad_mesh(file, size=1e-3 * COARSE_MM, curvature=CURVED, scale=scale)
    else:
        mesh = read_mesh(file, scale=scale)
    outside = boundary_faces(mesh)
    region = np.zeros(len(outside), np.int32)
    skin = Skin(mesh, outside)
    return skin.surface({"neutral": PAINT}, region, {}, path.stem), [skin]


def _scene(path: Path, earlier: Content | None = None) -> Content:
    scene = load_scene(path)
    check_room(scene, "mesh", "surface")
    board = scene.calibration.board if scene.calibration is not None else ""
    objects = SceneObjects(scene, [one.shown for one in frame_table(scene)], board=board)
    before = earlier.objects if earlier is not None else None
    made = before.bodies if before is not None and before.scene.files == scene.files else []
    objects.bodies = [
        build_body(
            body, scene.input, next((m.mesh for m in made if m.body.mesh == body.mesh), None)
        )
        for body in scene.bodies
    ]
    if any(parts.field is not None for parts in objects.bodies):
        objects.motions = [Given(parts.field.at) for parts in objects.bodies if parts.field]
    objects.props = [build_prop(prop, scene.input) for prop in scene.props]
    some = bool(objects.bodies or objects.props)
    require(some, f"view {path}", "nothing to see", "a body or a prop")
    return Content(
        scene.name,
        (path, *(Path(name) for name, _ in scene.files)),
        objects=objects,
        cameras=tuple(build_camera(camera, scene.input) for camera in scene.cameras),
        lights=build_lights(scene),
    )


def check_room(scene: Scene, *stages: str, made: Counts | None = None) -> None:
    """Raises InputError, as a run would, where one of these stages of it needs more memory than
    there is. ``made``: as `make_plan` has it."""
    plan = make_plan(scene, made=made)
    kept = tuple(stage for stage in plan.stages if stage.name.split("/")[-1] in stages)
    check_memory(replace(plan, stages=kept))


def _run(folder: Path) -> Content:
    path = folder / "scene.toml"
    require(path.is_file(), f"view {folder}", "no scene.toml", "the output folder of a run")
    content = _scene(path)
    solution, measured = folder / "solution", sorted((folder / "measure").glob("*.npz"))
    content.files += tuple(
        file
        for file in (
            solution / "displacement.npz", folder / STEPS, folder / VIBRATION,
            solution / "stress.npz", *measured,
        )
        if file.is_file()
    )  # fmt: skip
    if content.is_solvable:
        load_solution(content, solution)
    names = [camera.name for camera in content.cameras]
    points = map(measured_points, measured)
    content.measured = [one for one in points if one is not None and one.camera in names]
    return content


def _load_steps(content: Content, path: Path) -> list[Stepped | None]:
    """Of each body; None where it is linear. Raises ValueError for other bodies."""
    assert content.objects is not None
    bodies = content.objects.bodies
    if not path.is_file():
        return [None] * len(bodies)
    with np.load(read_input(path).stream(), allow_pickle=False) as stored:
        steps = [stepped_motion(stored, k) if f"u{k}" in stored else None
                 for k in range(len(bodies))]  # fmt: skip
    for number, (one, parts) in enumerate(zip(steps, bodies, strict=True)):
        shown = {frame.states[number] for frame in content.objects.frames} - {None}
        shape = (len(shown), parts.mesh.node_count, 3)
        if one is not None and (one.u.shape != shape or shown != set(one.states)):
            raise ValueError(f"load steps of shape {one.u.shape}, expected {shape}")
    return steps


def _vibrations(content: Content, stored: Stored) -> list[Motion | None]:
    """Of each body. Raises ValueError for other bodies."""
    assert content.objects is not None
    bodies, last = content.objects.bodies, content.objects.frames[-1].states
    motions: list[Motion | None] = []
    for number, (parts, state) in enumerate(zip(bodies, last, strict=True)):
        motion = stored_vibration(stored, number, parts.body.name, content.scene.analysis)
        if motion is not None and state is not None:
            shape = motion.displacement(state).shape
            if shape != parts.mesh.points.shape:
                raise ValueError(f"displacements of shape {shape}")
        motions.append(motion)
    return motions


def load_solution(content: Content, folder: Path) -> None:
    """Take over displacement.npz, steps.npz, vibration.npz and stress.npz of a folder, if there are
    any.

    Raises
    ------
    InputError
        They are damaged, or of other bodies.
    """
    from gpusim.pipeline.stages.mechanics import Stresses

    stress, files = folder / "stress.npz", ("displacement.npz", Path(VIBRATION).name)
    path = next((folder / name for name in files if (folder / name).is_file()), None)
    if path is None:
        return
    try:
        stresses = Stresses(read_input(stress).stream()) if stress.is_file() else None
        with np.load(read_input(path).stream(), allow_pickle=False) as stored:
            if path.name in VIBRATION:
                content.move(_vibrations(content, stored), stresses)
                return
            solution = SceneSolution.from_arrays(stored)
        content.solve(solution, stresses, _load_steps(content, folder / Path(STEPS).name))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: damaged, or of another scene; got {error}; expected what a run of this scene "
            "has written"
        ) from None
