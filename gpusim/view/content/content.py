"""What is shown: surfaces by frame, cameras, lights, fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.export.body_state import BodyState
from gpusim.gpu import Device
from gpusim.motion import Motion, Stepped
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.light.lights import Light
from gpusim.optics.sensor.channels import Weights
from gpusim.pipeline.scene_objects.cameras import build_lens, grey_weights
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.pipeline.scene_objects.solution import SceneSolution
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadGroup, load_groups
from gpusim.scene.analyses import kind_of
from gpusim.surface.color import Color, color
from gpusim.surface.skin import Skin
from gpusim.surface.surface import Surface
from gpusim.view.content.cut import Cut, cut_body
from gpusim.view.content.depth_of_field import DepthOfField, depth_of_field
from gpusim.view.content.measured_points import MeasuredPoints, Squares
from gpusim.view.picture.neutral import unpainted
from gpusim.visualization.mesh_edges import crease_edges

if TYPE_CHECKING:  # a third of a second to import, which the first picture doesn't need
    from gpusim.fem import Model
    from gpusim.pipeline.stages.mechanics import Stresses


@dataclass(eq=False)
class Content:
    """What a window shows.

    ``files``: those that it was made of. ``objects``: the scene's bodies and props; None for a
    mesh, whose surfaces are ``parts``, and ``part_skins`` of those that have elements.
    ``cameras``: the scene's. ``lights``: None where there are none. ``solution``, ``stresses``:
    once there are some. ``measured``: at points of pictures. ``cut``: what of the bodies is shown.
    """

    title: str
    files: tuple[Path, ...]
    parts: tuple[Surface, ...] = ()
    part_skins: Sequence[Skin] = ()
    objects: SceneObjects | None = None
    cameras: tuple[Camera, ...] = ()
    lights: Sequence[Light] | None = None
    solution: SceneSolution | None = None
    stresses: Stresses | None = None
    measured: Sequence[MeasuredPoints] = ()
    cut: Cut | None = None
    _shown: dict[tuple[int, float, bool], list[Surface]] = field(default_factory=dict)
    _squares: dict[str, Squares] = field(default_factory=dict)
    _models: dict[int, Model] = field(default_factory=dict)

    @property
    def scene(self) -> Scene:
        """That of ``objects``."""
        assert self.objects is not None
        return self.objects.scene

    @property
    def background(self) -> Color:
        """Radiance where no surface is."""
        return 0.0 if self.objects is None else color(self.objects.scene.render.background)

    @cached_property
    def depths_of_field(self) -> list[DepthOfField | None]:
        """Of the scene's cameras; None where there is no limit."""
        lenses = [build_lens(table, self.scene.input) for table in self.scene.cameras]
        return list(map(depth_of_field, self.cameras, lenses))

    def grey_weights(self, number: int | None) -> Weights | None:
        """Of red, green and blue in the pictures of a camera of the scene; None if they are in
        colour. What no camera sees (``number`` None) is grey where all of their pictures are."""
        if self.objects is None or not self.cameras:
            return None
        cameras = self.scene.cameras if number is None else [self.scene.cameras[number]]
        weights = [grey_weights(self.scene.sensor_of(camera.name), camera) for camera in cameras]
        return None if None in weights else weights[0]

    def has(self, what: str) -> bool:
        """Whether there is any of what can be switched on and off."""
        found = {
            "light": self.lights is not None, "paint": self.objects is not None,
            "mesh": bool(self.skins), "supports": self.is_solvable, "loads": self.is_solvable,
            "cameras": bool(self.cameras),
        }  # fmt: skip
        return found.get(what, self.moves)

    @property
    def frames(self) -> int:
        """How many there are to be shown: those of the scene once its bodies can move."""
        objects = self.objects
        if objects is None or not self.moves:
            return 1
        return len(objects.frames)

    @property
    def moves(self) -> bool:
        """Whether frames differ: there is a solution, displacements are given, or props have
        poses."""
        objects = self.objects
        if objects is None:
            return False
        props_move = any(place is not None for place in objects.frames[0].places)
        return bool(objects.motions) or props_move

    @property
    def is_given(self) -> bool:
        """Whether its bodies move without anything being solved."""
        objects = self.objects
        return objects is not None and bool(kind_of(objects.scene).unsolved)

    @property
    def is_solvable(self) -> bool:
        """Whether it is a scene with bodies whose displacements have to be computed."""
        objects = self.objects
        return objects is not None and bool(objects.bodies) and not self.is_given

    @property
    def unloaded(self) -> bool:
        """Whether bodies are shown at rest because their solution isn't there yet."""
        return self.is_solvable and not (self.objects and self.objects.motions)

    def frame_text(self, frame: int) -> str:
        """What a slider says of a frame."""
        if self.objects is None or self.frames == 1:
            return ""
        text = self.scene.analysis.frame_text(frame)
        return f"frame {frame} ({frame + 1} of {self.frames}): {text}"

    def solve(
        self, solution: SceneSolution, stresses: Stresses | None, steps: Sequence[Stepped | None]
    ) -> None:
        """Take over what has been computed; ``steps`` of bodies at large displacements.

        Raises
        ------
        ValueError
            It is of other bodies.
        """
        assert self.objects is not None
        nodes = [parts.mesh.node_count for parts in self.objects.bodies]
        solution.check([len(self.load_groups(body)) for body in range(len(nodes))], nodes)
        self.solution = solution
        self.move(
            [solution.superposed(body) if own is None else own for body, own in enumerate(steps)],
            stresses,
        )

    def move(self, motions: Sequence[Motion | None], stresses: Stresses | None) -> None:
        """Let bodies move, one motion for each, with their stresses if these are known."""
        assert self.objects is not None
        self.objects.motions, self.stresses = motions, stresses
        self._shown.clear()

    def displacement(self, body: int, frame: int) -> Float:
        """Of a body's nodes (N, 3), not scaled."""
        assert self.objects is not None
        return self.objects.displacement(body, frame if self.moves else None)

    def surfaces(self, frame: int, scale: float = 1.0, painted: bool = True) -> list[Surface]:
        """Every surface in a frame, bodies first, displacements times ``scale``; the same objects
        if it is asked for again."""
        if self.objects is None:
            return [surface for _, surface in self.at_rest] if self.skins else list(self.parts)
        key = (frame if self.moves else 0, scale, painted)
        if key not in self._shown:
            while len(self._shown) >= 4:  # so that going back and forth is quick
                del self._shown[next(iter(self._shown))]
            found = self._moved(key[0], scale)
            self._shown[key] = found if painted else [unpainted(surface) for surface in found]
        return self._shown[key]

    def _moved(self, frame: int, scale: float) -> list[Surface]:
        objects = self.objects
        assert objects is not None
        found = objects.surfaces(frame if self.moves else None)
        for number, (skin, surface) in enumerate(self.at_rest):
            u = self.displacement(number, frame)
            if self.cut is not None or (scale != 1.0 and u.any()):
                found[number] = skin.moved(surface, scale * u)
            if not self.kept[number].any():  # its one face, too small to be seen
                found[number] = surface.moved(np.broadcast_to(surface.rest[0], surface.rest.shape))
        return found

    @cached_property
    def bounds(self) -> Float:
        """(2, 3) m: of the bodies at rest."""
        points = np.concatenate([skin.mesh.points for skin, _ in self.whole])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @property
    def whole(self) -> list[tuple[Skin, Surface]]:
        """Skins and surfaces at rest of the bodies, or of a mesh."""
        if self.objects is None:
            return list(zip(self.part_skins, self.parts, strict=False))
        return [(parts.skin, parts.surface) for parts in self.objects.bodies]

    @cached_property
    def at_rest(self) -> list[tuple[Skin, Surface]]:
        """What of `whole` is shown."""
        if self.cut is None:
            return self.whole
        return [cut_body(*one, kept) for one, kept in zip(self.whole, self.kept, strict=True)]

    @cached_property
    def kept(self) -> list[Bool]:
        """Of each body (M,), which elements are shown."""
        meshes = [skin.mesh for skin, _ in self.whole]
        if self.cut is None:
            return [np.ones(mesh.cell_count, bool) for mesh in meshes]
        return [self.cut.kept(mesh, self.bounds) for mesh in meshes]

    def cut_at(self, cut: Cut | None) -> None:
        """Show what is before a plane alone; None: everything."""
        self.cut = cut
        self._shown.clear()
        for found in ("at_rest", "kept", "creases"):
            self.__dict__.pop(found, None)

    @property
    def skins(self) -> Sequence[Skin]:
        """Of what is shown of the bodies, or of a mesh."""
        return [skin for skin, _ in self.at_rest]

    @cached_property
    def creases(self) -> list[Float]:
        """Edges (n, 2, 3) m of what is shown without paint and lamps: they tell its shape."""
        return [crease_edges(surface) for surface in self.surfaces(0)] if self.parts else []

    def squares(self, points: MeasuredPoints, device: Device) -> Squares:
        """Where points were measured."""
        assert self.objects is not None
        if points.name not in self._squares:
            camera = next(camera for camera in self.cameras if camera.name == points.camera)
            surfaces = self.objects.surfaces(0)
            self._squares[points.name] = points.squares(surfaces, camera, device)
        return self._squares[points.name]

    def outline(self, frame: int, scale: float) -> Float:
        """Points (n, 3) to be framed: those of the bodies; of everything if there are none."""
        surfaces = self.surfaces(frame, scale)
        count = len(self.objects.bodies) if self.objects is not None else 0
        return np.concatenate([surface.points[np.unique(surface.faces[surface.faces >= 0])]
                               for surface in surfaces[: count or None]])  # fmt: skip

    def state(self, body: int, frame: int, solved: bool = False) -> BodyState:
        """A body in a frame, from which its fields follow; ``solved``: those, too, that need what
        it was solved as."""
        from gpusim.pipeline.scene_objects.modelling import temperature

        objects = self.objects
        assert objects is not None
        parts, u = objects.bodies[body], self.displacement(body, frame)
        displaced = bool(objects.motions) and isinstance(objects.motions[body], Stepped)
        if self.stresses is not None and (displaced or not solved):
            return BodyState(parts.mesh, u, known=self.stresses.of(body, frame, parts))
        if displaced:  # its stress doesn't follow from displacements
            return BodyState(parts.mesh, u)
        change = temperature(parts.body, frame)
        return BodyState(parts.mesh, u, self.model(body), parts.body.formulation, change)

    def model(self, body: int) -> Model | None:
        """What a body is solved as; None if its displacements are given.

        Raises
        ------
        InputError
            As `gpusim.pipeline.scene_objects.modelling.build_model`.
        """
        from gpusim.pipeline.scene_objects.modelling import build_model

        objects = self.objects
        if objects is None or self.is_given:
            return None
        if body not in self._models:
            groups, free = self.load_groups(body), self.scene.analysis.vibrates
            self._models[body] = build_model(objects.bodies[body], groups, free).model
        return self._models[body]

    def load_groups(self, body: int) -> tuple[LoadGroup, ...]:
        """What of a body is solved apart."""
        return load_groups(self.scene.bodies[body], self.scene.analysis.load_factors)

    def forces(self, body: int, frame: int) -> Float:
        """Of a body's nodes (N, 3), N, as they act in a frame; of one that can't be shown loaded
        yet, in the last one."""
        assert self.objects is not None
        shown = self.objects.frames[frame if self.moves else -1]
        model, state = self.model(body), shown.states[body]
        if model is None or state is None:
            return np.zeros((self.objects.bodies[body].mesh.node_count, 3))
        weights = np.array(state[: len(model.load_cases)])
        if not self.scene.analysis.scales_loads:  # they are shown as they are given
            weights = np.ones(len(model.load_cases))
        return np.asarray(np.tensordot(weights, model.load_cases, axes=1))

    def take_over(self, earlier: Content | None) -> bool:
        """Keep the solution of an earlier state of the file, if nothing that it depends on has
        changed; whether it is so."""
        if earlier is None or earlier.objects is None or self.objects is None:
            return False
        if earlier._mechanics() != self._mechanics():
            return False
        if self.unloaded and not earlier.unloaded:
            self.solution = earlier.solution
            self.move(earlier.objects.motions, earlier.stresses)
        return True

    def _mechanics(self) -> tuple[Any, ...]:
        """All of a scene that its solution depends on."""
        document = self.scene.document
        bodies = [
            {key: value for key, value in body.items() if key != "paint"}
            for body in document.get("body", [])
        ]
        return (
            bodies,
            *(document.get(key) for key in ("material", "analysis", "solver")),
            self.scene.files,
        )
