"""The view that moves, as a notebook's browser would talk to it: what it sends, and what comes
back."""

from __future__ import annotations

import asyncio
import io
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from gpusim.scene import load_scene
from gpusim.scene.toml_text import toml_text
from tests.support.small_scene import DOCUMENT

pytest.importorskip("anywidget")
pytest.importorskip("rendercanvas")

SIZE = (320, 200)
SECONDS = 60.0


class Browser:
    """The other end of a widget."""

    def __init__(self, widget: Any) -> None:
        self.widget = widget
        self.pictures: list[np.ndarray] = []
        widget.send = self.receive
        width, height = SIZE
        self.event("resize", width=width, height=height, pwidth=width, pheight=height, ratio=1.0)
        self.state(_has_visible_views=True)

    def receive(self, message: dict[str, Any], buffers: Any = None) -> None:
        if message["type"] == "framebufferdata":
            self.pictures.append(np.asarray(Image.open(io.BytesIO(buffers[0])).convert("RGB")))
            seen = {"index": message["index"], "timestamp": message["timestamp"]}
            self.state(_frame_feedback={**seen, "localtime": time.time()})

    def event(self, kind: str, **values: Any) -> None:
        data = {"method": "custom", "content": {"type": kind, "timestamp": 0.0, **values}}
        self.widget._handle_msg({"content": {"data": data}, "buffers": []})

    def state(self, **values: Any) -> None:
        data = {"method": "update", "state": values, "buffer_paths": []}
        self.widget._handle_msg({"content": {"data": data}, "buffers": []})

    def pointer(self, kind: str, x: float, y: float) -> None:
        self.event(f"pointer_{kind}", x=x, y=y, button=1, buttons=[1], modifiers=[])

    async def until(self, seen: Callable[[np.ndarray], bool]) -> np.ndarray:
        end = time.monotonic() + SECONDS
        while not (self.pictures and seen(self.pictures[-1])):
            assert time.monotonic() < end
            await asyncio.sleep(0.02)
        return self.pictures[-1]


def test_it_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpusim.notebook.view.in_notebook", lambda: True)
    monkeypatch.setattr("gpusim.view.content.content.Content.unloaded", False)  # not solved
    path = tmp_path / "bar.toml"
    given = {key: value for key, value in DOCUMENT.items() if key != "measure"}
    path.write_text(toml_text(given), encoding="utf-8")

    async def look() -> None:
        widget = load_scene(path).view(size=SIZE)
        browser = Browser(widget)
        try:
            first = await browser.until(lambda picture: picture.std() > 10.0)
            assert first.shape == (SIZE[1], SIZE[0], 3)
            browser.pointer("down", 100, 100)
            for x in range(100, 220, 20):
                browser.pointer("move", x, 100)
            browser.pointer("up", 200, 100)
            turned = await browser.until(
                lambda p: bool((np.abs(p.astype(int) - first) > 20).mean() > 0.03)
            )
            browser.event("key_down", key="h", modifiers=[])
            await browser.until(lambda p: (p > 220).mean() > (turned > 220).mean() + 0.2)
        finally:
            widget._is_closed = True  # close() of rendercanvas 2.7 calls itself without end
            await asyncio.sleep(0.2)

    asyncio.run(look())
