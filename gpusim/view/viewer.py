"""How keys and the mouse change what is looked at."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, count
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.view.content.cut import Cut
from gpusim.view.content.picking import pick
from gpusim.view.drawing import ViewDrawing
from gpusim.view.field_list import FieldRows, all_fields
from gpusim.view.keys import ALIASES, KEYS
from gpusim.view.legend_range import is_range
from gpusim.view.panels import draw_panels, panels_taken, slider_frame
from gpusim.visualization.overlay import Overlay
from gpusim.visualization.placement import Placement
from gpusim.visualization.turntable import camera_lines

CLICK = 4.0
"""px that the mouse may move in a click."""

AROUND = 4.0
"""Times as far as the selection alone would be: it is seen with what is round it."""


class Viewer(ViewDrawing):
    """What a window shows, with its keys and its mouse.

    Examples
    --------
    >>> from gpusim.view.viewer import Viewer
    >>> viewer = Viewer(gs.Device(), Path("bar.toml"), (320, 200), solve=False)
    >>> viewer.key("7")
    >>> viewer.view.elevation.__round__(4)
    1.5708
    """

    _drag: dict[str, Any] | None = None
    listed: FieldRows | None = None

    def taken(self) -> tuple[float, float]:
        """Of the window by the legend and the slider."""
        return panels_taken(self)

    def draw_over(self, overlay: Overlay) -> None:
        """Title, slider, help and the like."""
        self.listed = draw_panels(self, overlay)

    # -- keys ---------------------------------------------------------------------------------

    def key(self, key: str) -> None:
        """Do what a key stands for; others do nothing."""
        wanted = ALIASES.get(key, key)
        for known in KEYS:
            if known.key.lower() == wanted.lower():
                getattr(self, known.action)(*known.arguments)

    def look_along(self, side: str) -> None:
        self.look(self.view.side(side))

    def switch(self, what: str) -> None:
        """On or off, and say so: not all that is switched is in sight."""
        content = self.content
        on = self.shown[what] = not self.shown[what]
        if what in ("paint", "light"):
            self._white = None
            self.changed()
        if what != "help":
            there = content is None or content.has(what)
            self.say(f"{what}: {'on' if on else 'off'}{'' if there else ', but there is none'}")

    def next_camera(self) -> None:
        cameras = self.content.cameras if self.content is not None else ()
        if not cameras:
            self.say("no camera in what is shown; c writes one")
            return
        following = 0 if self.through is None else self.through + 1
        self.look_through(following if following < len(cameras) else None)

    def frame_selection(self) -> None:
        if self.content is None or self.selected is None:
            self.say("nothing selected: click something")
            return
        near = self.view.fit(self._selected_points(), *self.size)
        outline = self.content.outline(self.frame, self.scale)
        most = max(self.view.fit(outline, *self.size).distance, near.distance)
        self.look(replace(near, distance=min(AROUND * near.distance, most)))

    def _selected_points(self) -> Float:
        """Corners of the selected element, or of the face of a prop."""
        assert self.content is not None and self.selected is not None
        surface = self.surfaces()[self.selected.surface]
        faces = surface.faces[self.selected.face][None]
        if self.selected.element is not None:
            skin = self.content.skins[self.selected.surface]
            faces = surface.faces[skin.cell_of_piece == self.selected.element]
        return np.asarray(surface.points[np.unique(faces[faces >= 0])])

    def write_camera(self) -> None:
        taken = {camera.name for camera in self.content.cameras} if self.content else set()
        names = chain(["view"], (f"view_{k}" for k in count(2)))
        name = next(name for name in names if name not in taken)
        text = camera_lines(self.view, *self.size, name)
        sys.stdout.write(text + "\n")
        sys.stdout.flush()
        where = "in the terminal"
        if self.copy is not None:
            self.copy(text)
            where += " and the clipboard"
        self.say(f"{text}\n\n{where}: to be pasted into a scene")

    def step_frame(self, by: int) -> None:
        self.show_frame(self.frame + by)

    def deform(self, factor: float) -> None:
        if self.content is None or not self.content.moves:
            self.say("no deformation: nothing is solved")
            return
        self.scale = min(max(factor * self.scale, 2.0**-10), 2.0**20)
        self.changed()

    def step_field(self, by: int) -> None:
        """The field before or after the one that is shown; paint is one of them."""
        names = all_fields(self)
        now = names.index(self.field) if self.field in names else 0
        if len(names) == 1:
            self.say("no field: nothing is solved")
        self.show_field(names[(now + by) % len(names)])

    def step_range(self) -> None:
        """What the legend reaches over."""
        self.say(self.legend_range.step())
        self.show_field(self.field)

    def widen_range(self, factor: float) -> None:
        """A legend ``factor`` times as wide, about zero or its middle."""
        if self.field_values is None:
            self.say("no field: f shows one")
            return
        low, high = self.color_scale.limits
        middle = 0.0 if low <= 0.0 <= high else 0.5 * (low + high)
        low, high = (middle + factor * (end - middle) for end in (low, high))
        if is_range(low, high):
            self.hold_range(low, high)

    def play(self) -> None:
        """Frames in time, again and again, or no longer."""
        if self.content is None or self.content.frames < 2:
            self.say("one frame: nothing moves, or isn't solved yet")
            return
        self.playing = not self.playing

    def next_cut(self) -> None:
        """A plane across x, y, z, then none."""
        axis = -1 if self.cut is None else self.cut.axis
        self._cut_at(Cut(axis + 1) if axis < 2 else None)

    def move_cut(self, by: float) -> None:
        if self.cut is not None:
            share = min(max(self.cut.share + by, 0.0), 1.0)
            self._cut_at(replace(self.cut, share=share))

    def turn_cut(self) -> None:
        """Show the other side."""
        if self.cut is not None:
            self._cut_at(replace(self.cut, beyond=not self.cut.beyond))

    def _cut_at(self, cut: Cut | None) -> None:
        if self.content is None or not self.content.skins:
            self.say("no elements to be cut")
            return
        self.cut_at(cut)

    def brighten(self, factor: float) -> None:
        self.gain *= factor

    def save_picture(self) -> None:
        folder = self.path if self.path.is_dir() else self.path.parent
        paths = (folder / f"{self.path.stem}-{number:03d}.png" for number in count(1))
        path = next(path for path in paths if not path.exists())
        if self.save is not None:
            self.message = ""
            self.save(path)
            self.say(f"saved {path}")

    # -- mouse; places in px of the window ----------------------------------------------------

    def press(self, x: float, y: float, button: int, modifiers: Sequence[str] = ()) -> None:
        """A button goes down: 1 left, 2 right, 3 middle."""
        pans = button == 3 or (button == 1 and "Shift" in modifiers)
        what = "pan" if pans else "orbit" if button == 1 else ""
        rows = self.listed if self.shown["fields"] else None
        if button == 1 and rows is not None and (row := rows.at(x, y)) is not None:
            self.show_field(rows.names[row])
            what = ""
        elif button == 1 and slider_frame(self, x, y) is not None:
            what = "slide"
        self._drag = {"what": what, "first": (x, y), "last": (x, y), "far": False}
        self._dragged(x, y)

    def move(self, x: float, y: float) -> None:
        """The mouse moves."""
        if self._drag is not None:
            self._dragged(x, y)

    def _dragged(self, x: float, y: float) -> None:
        assert self._drag is not None
        (x0, y0), drag = self._drag["first"], self._drag
        drag["far"] = drag["far"] or np.hypot(x - x0, y - y0) > CLICK
        if drag["what"] == "slide":
            frame = slider_frame(self, x, None)
            if frame is not None:
                self.show_frame(frame)
        elif drag["far"] and drag["what"]:
            dx, dy = x - drag["last"][0], y - drag["last"][1]
            turned = getattr(self.view, drag["what"])(dx, dy, self.size[1])
            drag["last"] = x, y
            if dx or dy:
                self.look(turned)

    def release(self, x: float, y: float) -> None:
        """A button goes up: where it went down, that is a click."""
        drag, self._drag = self._drag, None
        if drag is not None and not drag["far"] and drag["what"] == "orbit":
            self.select(x, y)

    def wheel(self, steps: float, x: float, y: float) -> None:
        """The wheel turns by ``steps`` towards the user."""
        self.look(self.view.zoom(steps, x, y, *self.size))

    def select(self, x: float, y: float) -> None:
        """Select what is seen at a place of the window."""
        base, place = self.picture.base, self.place
        if base is None or self.content is None:
            return
        column, row = Placement(place.x, place.y, self.picture.coarseness).pixels((x, y))
        self.selected = pick(
            base.view, base.ids(), self.surfaces(), float(column), float(row), self.content.skins
        )
