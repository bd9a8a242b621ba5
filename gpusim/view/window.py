"""The window (rendercanvas and glfw), which draws with gpusim's own device."""

from __future__ import annotations

import time
import warnings
from typing import Any

from gpusim.errors import InputError
from gpusim.interrupts import DelayedSignals
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require
from gpusim.view.screenshot import save_screenshot
from gpusim.view.viewer import Viewer
from gpusim.visualization.overlay import Target

TITLE = "gpusim view"

FRAMES_PER_SECOND = 60.0

PERIOD = 0.05
"""s between looks at what changes without keys and mouse."""

INSTALL = 'install the extra: pip install "gpusim[view]"'

COMMANDS = {"Control", "Meta"}
"""Keys with which others are the browser's."""


class WindowView:
    """Joins a viewer and a canvas of rendercanvas: events to the one, pictures to the other.

    ``types``: whether what is typed comes as characters alone (of glfw); in a browser it comes as
    keys, too.
    ``signals``: once one has come, the canvas is closed.
    """

    def __init__(
        self, viewer: Viewer, canvas: Any, loop: Any, types: bool,
        signals: DelayedSignals | None = None,
    ) -> None:  # fmt: skip
        self.viewer, self.canvas, self.loop, self.types = viewer, canvas, loop, types
        self.signals = signals
        self.context = canvas.get_wgpu_context()
        preferred = self.context.get_preferred_format(viewer.device.adapter)
        self.format = str(preferred).removesuffix("-srgb")
        self.context.configure(device=viewer.device.gpu, format=self.format)
        viewer.save = lambda path: save_screenshot(viewer, path)
        canvas.add_event_handler(
            self.event, "pointer_down", "pointer_move", "pointer_up", "wheel", "key_down", "char",
            "resize",
        )  # fmt: skip
        canvas.request_draw(self.draw)
        loop.call_later(PERIOD, self.tick)

    def draw(self) -> None:
        """Draw what there is, and ask for more if there is more to come."""
        largest = self.viewer.device.limits["max-texture-dimension-2d"]
        if max(self.canvas.get_physical_size()) > largest:
            return  # wgpu ends the process where a window's texture is asked to be larger
        begun = time.monotonic()
        texture = self.context.get_current_texture()  # waits while too much is on its way
        width, height = texture.size[:2]
        target = Target(texture.create_view(), self.format, width, height)
        more = self.viewer.draw(target)
        self.viewer.picture.took(time.monotonic() - begun)
        if more:
            self.canvas.request_draw()

    def tick(self) -> None:
        """Look for what changes without keys and mouse, again and again."""
        if self.signals is not None:
            # rendercanvas takes them once its loop runs, and closes the window in the middle of a
            # picture; wgpu ends the process then
            self.signals.take()
            if self.signals.told:
                self.canvas.close()
        if self.canvas.get_closed():
            self.viewer.close()
            return
        self.loop.call_later(PERIOD, self.tick)  # whatever comes of this one
        if self.viewer.tick():
            self.canvas.request_draw()

    def event(self, event: dict[str, Any]) -> None:
        """Pass an event of rendercanvas on."""
        with self.viewer.faults_shown():
            self._pass_on(event["event_type"], event)
        if event["event_type"] != "pointer_move" or event["buttons"]:
            self.canvas.request_draw()

    def _pass_on(self, kind: str, event: dict[str, Any]) -> None:
        viewer = self.viewer
        ratio = self.canvas.get_pixel_ratio()
        x, y = ratio * event.get("x", 0.0), ratio * event.get("y", 0.0)
        if kind == "pointer_down":
            viewer.press(x, y, event["button"], event["modifiers"])
        elif kind == "pointer_move":
            viewer.move(x, y)
        elif kind == "pointer_up":
            viewer.release(x, y)
        elif kind == "wheel":
            viewer.wheel(event["dy"] / 100.0, x, y)
        elif kind == "char" and self.types:
            viewer.key(event["data"])
        elif kind == "key_down":
            key = event["key"]
            if len(key) > 1 or not (self.types or COMMANDS.intersection(event["modifiers"])):
                viewer.key(key)


def open_window(viewer: Viewer) -> None:
    """Open the window, and return when it is closed.

    Raises
    ------
    InputError
        The extra ``[view]`` isn't installed, or there is no display.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what a missing display makes glfw say
            import glfw
            from rendercanvas.glfw import RenderCanvas, loop

            shows = glfw.init()
    except ImportError as error:
        raise InputError(f"view: {error.name or 'glfw'} is missing; {INSTALL}") from None
    got = "no display (DISPLAY and WAYLAND_DISPLAY say where one is)"
    expected = "one, or --screenshot FILE.png, which needs none, or --serve"
    require(bool(shows), "view", got, expected)
    canvas = RenderCanvas(
        size=viewer.size, title=f"{viewer.path.name} – {TITLE}", max_fps=FRAMES_PER_SECOND,  # noqa: RUF001
        vsync=False,
    )  # fmt: skip
    viewer.copy = lambda text: glfw.set_clipboard_string(None, text)  # type: ignore[arg-type]
    with DelayedSignals() as signals, one_blas_thread():  # once, and not for every picture
        WindowView(viewer, canvas, loop, types=True, signals=signals)
        loop.run()
        viewer.close()
