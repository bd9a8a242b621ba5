"""What a window does with events and ticks, whatever comes of them: with a canvas of no window."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from gpusim.interrupts import DelayedSignals
from gpusim.view.keys import KEYS
from gpusim.view.viewer import Viewer
from gpusim.view.window import WindowView


class Canvas:
    """One of rendercanvas, as far as it is asked."""

    def __init__(self) -> None:
        self.closed, self.drawings = False, 0
        self.get_pixel_ratio = lambda: 1.0
        self.get_closed = lambda: self.closed

    def get_wgpu_context(self) -> Any:
        return SimpleNamespace(
            get_preferred_format=lambda _: "rgba8unorm", configure=lambda **_: None
        )

    def add_event_handler(self, *_: Any) -> None: ...

    def request_draw(self, *_: Any) -> None:
        self.drawings += 1

    def close(self) -> None:
        self.closed = True


class Loop:
    """Its timers, which a test lets go off."""

    def __init__(self) -> None:
        self.later: list[Callable[[], None]] = []

    def call_later(self, _: float, call: Callable[[], None]) -> None:
        self.later.append(call)

    def go_off(self) -> None:
        waiting, self.later = self.later, []
        for call in waiting:
            call()


def typed(view: WindowView, key: str, *modifiers: str, browser: bool = True) -> None:
    """A key as it comes: in browsers what is typed comes as a key and as a character."""
    view.event({"event_type": "key_down", "key": key, "modifiers": modifiers})
    if len(key) == 1 and not modifiers:
        view.event({"event_type": "char", "data": key, "is_composing": False})


@pytest.mark.parametrize("types", [False, True])
def test_a_key_acts_once(viewer: Viewer, monkeypatch: pytest.MonkeyPatch, types: bool) -> None:
    heard: list[str] = []
    monkeypatch.setattr(viewer, "key", heard.append)
    view = WindowView(viewer, Canvas(), Loop(), types)
    for key in KEYS:
        typed(view, key.key)
    assert heard == [key.key for key in KEYS]
    typed(view, "s", "Control")  # the browser's own
    typed(view, "r", "Meta")
    assert len(heard) == len(KEYS)


def test_nothing_that_fails_ends_the_ticks(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither a reload nor a key nor the view itself; a signal closes the window all the same."""
    canvas, loop, signals = Canvas(), Loop(), DelayedSignals()
    view = WindowView(viewer, canvas, loop, types=False, signals=signals)

    def fail(*_: object) -> None:
        raise RuntimeError("no such luck")

    with monkeypatch.context() as patch:
        patch.setattr("gpusim.view.view_state.load_content", fail)
        patch.setattr(viewer.watch, "changed", lambda: True)
        for _ in range(2):
            loop.go_off()
            assert viewer.fault == "RuntimeError: no such luck" and len(loop.later) == 1
    viewer.fault = ""
    with monkeypatch.context() as patch:
        patch.setattr(viewer, "save_picture", fail)
        typed(view, "s")
        assert viewer.fault == "RuntimeError: no such luck"
    with monkeypatch.context() as patch:
        patch.setattr(viewer, "tick", fail)
        with pytest.raises(RuntimeError):
            loop.go_off()
        assert len(loop.later) == 1
    signals.told = 2
    loop.go_off()
    assert canvas.closed and not loop.later
