"""What is looked at: content, view and choices."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError, InputError
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.light.lights import Light
from gpusim.pipeline.scene_objects.surfaces import counts_of
from gpusim.scene.tables.table import FileUnit
from gpusim.surface.color import Color
from gpusim.view.content.background_solver import BackgroundSolver
from gpusim.view.content.content import Content
from gpusim.view.content.cut import Cut
from gpusim.view.content.depth_of_field import DepthOfField
from gpusim.view.content.field_values import FieldValues, field_values
from gpusim.view.content.file_watch import FileWatch
from gpusim.view.content.loading import load_content, load_solution
from gpusim.view.content.picking import Pick
from gpusim.view.legend_range import LegendRange
from gpusim.view.picture.neutral import BACKDROP, HEADLIGHT_WHITE, headlight
from gpusim.view.picture.progressive_picture import ProgressivePicture, Shot
from gpusim.visualization.color_scale import ColorScale
from gpusim.visualization.field_colors import SurfaceField, surface_field
from gpusim.visualization.overlay import Overlay
from gpusim.visualization.placement import Placement
from gpusim.visualization.turntable import Turntable

MESSAGE_SECONDS = 4.0
"""How long a message stands in the window."""

UNSOLVED = "not solved"

LOOP, SHORTEST, LONGEST = 4.0, 0.1, 0.5
"""s that all frames are played in, and a frame stands at least and at most."""


class ViewState:
    """Shows what a file holds, as it is asked to.

    ``content``: None until there is something that can be shown. ``fault``: why the file as it is
    now can't be, or "". ``through``: number of the scene's camera that is looked through; None for
    the ``view`` that the mouse moves. ``free_view``: where that was before. ``shown``: what can be
    switched on and off.
    """

    def __init__(
        self, device: Device, path: Path, size: tuple[int, int], solve: bool = True,
        unit: FileUnit | None = None,
    ) -> None:  # fmt: skip
        self.device, self.path, self.size, self.solves, self.unit = device, path, size, solve, unit
        self.content: Content | None = None
        self.solver: BackgroundSolver | None = None
        self.fault = self.message = ""
        self.view = self.free_view = Turntable()
        self.through: int | None = None
        self.frame, self.scale, self.gain = 0, 1.0, 1.0
        self.field: str | None = None
        self.seen_camera = 0
        self.legend_range, self.playing = LegendRange(), False
        self.cut: Cut | None = None
        self.selected: Pick | None = None
        self.shown = {"paint": True, "light": True} | dict.fromkeys(
            ("help", "fields", "mesh", "supports", "loads", "cameras", "extremes", "undeformed"),
            False,
        )  # fmt: skip
        self.picture, self.overlay = ProgressivePicture(device), Overlay(device)
        self.watch = FileWatch([path])
        self.save: Callable[[Path], None] | None = None
        self.copy: Callable[[str], None] | None = None
        self._white: float | None = None
        self.field_values: FieldValues | None = None
        self.color_scale = ColorScale(0.0, 1.0, ())
        self._framed: Turntable | None = None
        self._layout: tuple[Any, ...] = ()
        self._until = self._next_frame = 0.0
        self.load()

    def close(self) -> None:
        """Stop what goes on, and give the device's memory back."""
        if self.solver is not None:
            self.solver.stop()
        self.device.programs.stop()  # a process waits for what is being compiled in threads
        self.picture.release()

    @contextmanager
    def faults_shown(self) -> Iterator[None]:
        """Whatever is raised within is shown in the window, and ends nothing: the next event, tick
        or picture comes all the same."""
        try:
            yield
        except (GpusimError, OSError) as error:
            self.fault = str(error)
        except Exception as error:
            self.fault = f"{type(error).__name__}: {error}"

    # -- content ------------------------------------------------------------------------------

    def load(self) -> None:
        """Read the file again; what can't be read leaves the last good content, and a fault."""
        with self.faults_shown():
            self._show(load_content(self.path, self.unit, self.content))

    def _show(self, found: Content) -> None:
        """Show what was read in place of what there was."""
        unsolved = self.fault if self.fault.startswith(UNSOLVED) else ""
        earlier, self.content, self.fault = self.content, found, ""
        self.watch.watch((self.path, *found.files))
        if found.take_over(earlier):
            self.fault = unsolved
        else:
            if self.solver is not None:
                self.solver.stop()
                self.solver = None
            if found.unloaded and self.solves and found.objects is not None:
                self.solver = BackgroundSolver(found.objects.scene, counts_of(found.objects.bodies))
        self._white, self.selected = None, None
        found.cut_at(self.cut)
        self.seen_camera = max(min(self.seen_camera, len(found.cameras) - 1), 0)
        self.frame = min(self.frame, found.frames - 1)
        if self.through is not None and self.through >= len(found.cameras):
            self.look_through(None)
        if earlier is None:
            self.reset()
        self._field_again()

    def tick(self) -> bool:
        """Look for what has changed outside; whether there is something new to be drawn."""
        news = False
        if self.watch.changed():
            self.load()
            news = True
        if self.solver is not None:
            news = True  # its progress
            if not self.solver.running:
                with self.faults_shown():
                    self._solved()
        if self.message and time.monotonic() > self._until:
            self.message, news = "", True
        return self._played() or news

    def _played(self) -> bool:
        """Show the next frame, after the last one the first, if it is time for that."""
        frames = self.content.frames if self.content is not None else 1
        if not self.playing or frames < 2 or time.monotonic() < self._next_frame:
            return False
        with self.faults_shown():
            self.show_frame((self.frame + 1) % frames)
        self._next_frame = time.monotonic() + min(max(LOOP / frames, SHORTEST), LONGEST)
        return True

    def _solved(self) -> None:
        solver, self.solver = self.solver, None
        assert solver is not None and self.content is not None
        with self.faults_shown():
            if solver.fault:
                self.fault = f"{UNSOLVED}: {solver.fault}"
            else:
                load_solution(self.content, solver.folder / "solution")
                self.frame = self.content.frames - 1
        solver.stop()
        self._field_again()

    def _field_again(self) -> None:
        """The field of what is shown now; none until that is solved."""
        if self.content is not None and self.content.unloaded:
            self.field_values = None
            self.changed()
            return
        with self.faults_shown():
            self.show_field(self.field)
            return
        self.field = None

    # -- what is seen -------------------------------------------------------------------------

    def camera(self) -> tuple[Camera, int, int]:
        """The camera of the picture, and where its corner lies in the window."""
        width, height = self.size
        if self.through is None or self.content is None:
            return self.view.camera(width, height), 0, 0
        right, bottom = self.taken()
        return _within(self.content.cameras[self.through], width - right, height - bottom)

    @property
    def place(self) -> Placement:
        """Where pixels of the picture's camera lie in the window."""
        _, left, top = self.camera()
        return Placement(left, top)

    @property
    def sharp(self) -> DepthOfField | None:
        """What the camera that is looked through shows sharp; None where there is no limit."""
        if self.through is None or self.content is None:
            return None
        return self.content.depths_of_field[self.through]

    @property
    def white(self) -> float:
        """The radiance that is shown white."""
        return (self._white or HEADLIGHT_WHITE) / self.gain

    def surfaces(self) -> Sequence[Any]:
        """What is seen now."""
        if self.content is None:
            return []
        return self.content.surfaces(self.frame, self.scale, self.shown["paint"])

    def taken(self) -> tuple[float, float]:
        """Px of the window's right and lower side where something stands over the picture."""
        return 0.0, 0.0

    def surface_fields(self) -> list[SurfaceField]:
        """The field on the surfaces of the bodies; none where it is of points."""
        found, skins = self.field_values, self.content.skins if self.content is not None else []
        if found is None or found.points is not None:
            return []
        by_cell = found.field.place == "elements"
        return [surface_field(*one, by_cell) for one in zip(skins, found.values, strict=True)]

    def look_through(self, number: int | None) -> None:
        """See what a camera of the scene sees; None: what the mouse moved before."""
        if self.through is None:
            self.free_view = self.view
        self.through, self.view = number, self.free_view
        if number is not None and self.content is not None:
            middle = self.content.outline(self.frame, self.scale).mean(axis=0)
            self.view = self.view.of_camera(self.content.cameras[number], middle)
            self.seen_camera = number
            if self.field_values is not None:  # the truth is another
                self.show_field(self.field)
        self._frame_again()

    def show_frame(self, frame: int) -> None:
        """Show a frame, or the first or last one if there are none beyond."""
        last = self.content.frames - 1 if self.content is not None else 0
        frame = min(max(frame, 0), last)
        if not last:
            self.say("one frame: nothing moves, or isn't solved yet")
        if frame != self.frame:
            self.frame = frame
            self.show_field(self.field)

    def show_field(self, name: str | None) -> None:
        """Colour the bodies by a field; None: as they are painted.

        Raises
        ------
        InputError
            There is no such field, or a body hasn't it.
        """
        self.field, self.field_values, content = name, None, self.content
        if name is not None and content is not None and content.objects is None:
            self.field = None
            raise InputError(f"view --field; got {name!r} for a mesh; expected a scene or a run")
        if name is not None and content is not None:
            camera = self.seen_camera
            found = field_values(content, name, self.frame, camera)

            def of_all_frames() -> list[Float]:
                every = (field_values(content, name, k, camera) for k in range(content.frames))
                return [values for one in every for values in one.legend]

            known_by = (id(content), content.unloaded, name, camera)
            self.field_values = found
            self.color_scale = self.legend_range.scale(found, of_all_frames, known_by)
        self.changed()

    def hold_range(self, low: float, high: float) -> None:
        """The legend of the field that is shown, and of all others of its unit."""
        if self.field_values is not None:
            self.legend_range.hold(self.field_values.field.unit, low, high)
            self.show_field(self.field)

    def cut_at(self, cut: Cut | None) -> None:
        """Show what of the bodies is before a plane; None: all of them."""
        self.cut, self.selected = cut, None
        if self.content is not None:
            self.content.cut_at(cut)
        self.changed()

    def say(self, text: str) -> None:
        """Show a message for a while."""
        self.message, self._until = text, time.monotonic() + MESSAGE_SECONDS

    def reset(self) -> None:
        """The last frame as it is, all of it in view."""
        self.frame, self.scale, self.gain, self.through = 0, 1.0, 1.0, None
        self.view, self._white, self.field, self.field_values = Turntable(), None, None, None
        self.message, self.playing, self.legend_range = "", False, LegendRange()
        self.cut_at(None)
        if self.content is not None:
            self.frame = self.content.frames - 1
        self.frame_all()

    def frame_all(self) -> None:
        """Everything that is loaded in view, beside what is written over it."""
        if self.content is not None:
            outline = self.content.outline(self.frame, self.scale)
            self.look(self.view.fit(outline, *self.size, self.taken()))
            self._framed = self.view

    def _frame_again(self) -> None:
        """Everything in view where it was and nobody has moved since, in another window."""
        if self.through is None and self.view is self._framed:
            self.frame_all()
        else:
            self.changed()

    def look(self, view: Turntable) -> None:
        """See what another view sees."""
        self.view, self.through = view, None
        self.changed()

    def changed(self) -> None:
        """What is seen is another now."""
        if self.content is None:
            return
        camera, _, _ = self.camera()
        lights: Sequence[Light] = headlight(camera.camera_from_world[:3, :3])
        background: Color = BACKDROP
        if self.shown["light"] and self.content.lights is not None:
            lights, background = self.content.lights, self.content.background
            if self.through is None:  # no black void around what is walked round
                background = background or BACKDROP * (self._white or 0.0)
        weights = self.content.grey_weights(self.through)
        self.picture.begin(Shot(self.surfaces(), camera, lights, background, weights))


def _within(camera: Camera, width: float, height: float) -> tuple[Camera, int, int]:
    """A camera with as many pixels as its image has in the middle of a window, and its corner."""
    scale = min(width / camera.width, height / camera.height)
    columns, rows = max(round(scale * camera.width), 1), max(round(scale * camera.height), 1)
    seen = camera.reframed(columns, rows, scale=(columns / camera.width, rows / camera.height))
    return seen, int(width - columns) // 2, int(height - rows) // 2
