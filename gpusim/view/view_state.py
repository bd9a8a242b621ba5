"""What is looked at: content, view and choices; and how it is drawn, into whatever window."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError, InputError
from gpusim.export.field_catalogue import named_field
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.light.lights import Light
from gpusim.pipeline.scene_objects.surfaces import counts_of
from gpusim.scene.description.table import FileUnit
from gpusim.surface.color import Color
from gpusim.view.camera_marks import defocus_tint
from gpusim.view.content.background_solver import BackgroundSolver
from gpusim.view.content.content import Content
from gpusim.view.content.depth_of_field import DepthOfField
from gpusim.view.content.file_watch import FileWatch
from gpusim.view.content.loading import load_content, load_solution
from gpusim.view.picking import Pick
from gpusim.view.picture.neutral import BACKDROP, HEADLIGHT_WHITE, headlight
from gpusim.view.picture.progressive_picture import ProgressivePicture, Shot
from gpusim.visualization.color_scale import ColorScale, scale_of
from gpusim.visualization.field_colors import corner_values, draw_field_colors, surface_field
from gpusim.visualization.overlay import Overlay
from gpusim.visualization.placement import Placement
from gpusim.visualization.turntable import Turntable

MESSAGE_SECONDS = 4.0
"""How long a message stands in the window."""

UNSOLVED = "not solved"

STRESS = ("von_mises", "stress_", "principal_stress_")
"""How names of fields begin that are of the stress at nodes."""

TINT = 0.4
"""Opacity of the tint on what isn't sharp."""

EXPOSED = 0.995
"""Share of a lit picture's pixels that aren't white."""


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
        self.selected: Pick | None = None
        self.shown = {"paint": True, "light": True, "help": False, "mesh": False,
                      "supports": False, "loads": False, "cameras": False}  # fmt: skip
        self.picture, self.overlay = ProgressivePicture(device), Overlay(device)
        self.watch = FileWatch([path])
        self.save: Callable[[Path], None] | None = None
        self.copy: Callable[[str], None] | None = None
        self._white: float | None = None
        self.field_values: list[Float] = []
        self.color_scale = ColorScale(0.0, 1.0, ())
        self._framed: Turntable | None = None
        self._layout: tuple[Any, ...] = ()
        self._until = 0.0
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
        return news

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
            self.field_values = []
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

    def look_through(self, number: int | None) -> None:
        """See what a camera of the scene sees; None: what the mouse moved before."""
        if self.through is None:
            self.free_view = self.view
        self.through, self.view = number, self.free_view
        if number is not None and self.content is not None:
            middle = self.content.outline(self.frame, self.scale).mean(axis=0)
            self.view = self.view.of_camera(self.content.cameras[number], middle)
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

    def has_field(self, name: str) -> bool:
        """Whether a field can be shown of what is solved, its stress at most recovered."""
        content = self.content
        if content is None or not content.skins or not content.moves:
            return False
        solved = content.is_solvable and not content.unloaded
        return name.startswith(("displacement", *(STRESS if solved else ())))

    def show_field(self, name: str | None) -> None:
        """Colour the bodies by a field; None: as they are painted.

        Raises
        ------
        InputError
            There is no such field, or a body hasn't it.
        """
        self.field, self.field_values, content = name, [], self.content
        if name is not None and content is not None and content.objects is None:
            self.field = None
            raise InputError(f"view --field; got {name!r} for a mesh; expected a scene or a run")
        if name is not None and content is not None:
            kind, solved = named_field(name), not self.has_field(name)
            self.field_values = [
                kind.values(content.state(number, self.frame, solved))
                for number in range(len(content.skins))
            ]
            self.color_scale = scale_of(self.field_values, kind.signed)
        self.changed()

    def say(self, text: str) -> None:
        """Show a message for a while."""
        self.message, self._until = text, time.monotonic() + MESSAGE_SECONDS

    def reset(self) -> None:
        """The last frame as it is, all of it in view."""
        self.frame, self.scale, self.gain, self.through = 0, 1.0, 1.0, None
        self.view, self._white, self.field, self.field_values = Turntable(), None, None, []
        self.message = ""
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

    def _exposed(self) -> None:
        """Choose what is white from the first picture of a scene's lamps."""
        base = self.picture.base
        lamps = self.content is not None and self.content.lights is not None
        if not (lamps and self.shown["light"]):
            self._white = HEADLIGHT_WHITE
        elif self._white is None and base is not None and self.picture.shot is not None:
            radiance, weights = base.radiance, self.picture.shot.weights
            if base.coloured and weights is not None:
                radiance = radiance @ np.array(weights, np.float32)
            high = float(np.quantile(radiance, EXPOSED))
            self._white = high if high > 0.0 else 1.0
            self.changed()

    def draw(self, target: Any, whole: bool = False) -> bool:
        """Draw it over a `gpusim.visualization.overlay.Target`; ``whole``: at full quality.

        Whether there is more to be drawn, as soon as keys and the mouse have been heard.
        """
        if self.size != (target.width, target.height):
            self.size = target.width, target.height
            if self.through is not None or self.view is self._framed:  # else it is the user's
                self._white = None
        layout = self.size, self.taken()
        if self._layout != layout:
            self._layout = layout
            self._frame_again()
        more = False
        with self.faults_shown():
            more = self.picture.step()
            self._exposed()
            if whole:
                self.picture.finish()
            self._draw(target)
            return more
        self._draw(target, with_picture=False)  # what is seen now can't be shown
        return more

    def _draw(self, target: Any, with_picture: bool = True) -> None:
        _, left, top = self.camera()
        overlay, base = self.overlay, self.picture.base
        overlay.clear()
        with self.device.recording("view") as recording:
            if with_picture and base is not None:
                self.picture.draw(recording, target, left, top, 1.0 / self.white)
                if self.field_values:
                    self._draw_field(target, recording)
                elif self.sharp is not None and self.shown["cameras"]:
                    colored = defocus_tint(self.sharp, base.view)
                    self._draw_colors(target, recording, *colored, shade=1.0, opacity=TINT)
            else:
                overlay.rectangle(0, 0, target.width, target.height, "#23292f")
            self.draw_over(overlay)
            overlay.draw(target, recording)

    def taken(self) -> tuple[float, float]:
        """Px of the window's right and lower side where something stands over the picture."""
        return 0.0, 0.0

    def draw_over(self, overlay: Overlay) -> None:
        """Collect what stands over the picture."""

    def _draw_field(self, target: Any, recording: Any) -> None:
        """The colours of the field over the picture."""
        base = self.picture.base
        assert base is not None and self.field is not None and self.content is not None
        kind, skins = named_field(self.field), self.content.skins
        fields = [
            surface_field(skin, values, kind.place == "elements")
            for skin, values in zip(skins, self.field_values, strict=True)
        ]
        scale, values = self.color_scale, corner_values(base.view, self.surfaces(), fields)
        self._draw_colors(target, recording, values, scale.limits, scale.colors)

    def _draw_colors(self, target: Any, recording: Any, *colored: Any, **look: Any) -> None:
        """Values, limits and colours over the picture."""
        picture, place = self.picture, self.place
        assert picture.base is not None
        draw_field_colors(
            self.device, target, picture.base, *colored, white=self.white, recording=recording,
            place=Placement(place.x, place.y, picture.coarseness),
            samples=1 if picture.waits else 2, **look,
        )  # fmt: skip


def _within(camera: Camera, width: float, height: float) -> tuple[Camera, int, int]:
    """A camera with as many pixels as its image has in the middle of a window, and its corner."""
    scale = min(width / camera.width, height / camera.height)
    columns, rows = max(round(scale * camera.width), 1), max(round(scale * camera.height), 1)
    seen = camera.reframed(columns, rows, scale=(columns / camera.width, rows / camera.height))
    return seen, int(width - columns) // 2, int(height - rows) // 2
