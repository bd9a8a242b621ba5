"""The window on a display of its own, with real events of mouse and keyboard; and what is said
where there is none."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gpusim.gpu import Device
from gpusim.scene.toml_text import toml_text
from gpusim.view.content.loading import load_content
from gpusim.view.screenshot import screenshot
from gpusim.view.viewer import Viewer
from tests.support.gmsh_meshes import Gmsh
from tests.support.small_scene import DOCUMENT
from tests.support.x_display import XDisplay, missing_display, x_display

pytest.importorskip("glfw")
pytest.importorskip("rendercanvas")

SECONDS = 90.0
"""Of patience: machines are busy."""


def heard() -> None:
    """Ctrl-C isn't ignored, as it is by what a shell runs in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Window:
    """A preview window in a process of its own, and the display that it is on."""

    def __init__(self, display: XDisplay, folder: Path, *arguments: str) -> None:
        self.display = display
        self.process = subprocess.Popen(
            [sys.executable, "-m", "gpusim", "view", *arguments], cwd=folder, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=1, preexec_fn=heard,
            env={**os.environ, "DISPLAY": display.name, "PYTHONPATH": os.pathsep.join(sys.path)},
        )  # fmt: skip
        self.lines: queue.Queue[str] = queue.Queue()
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stdout
        for line in self.process.stdout:
            self.lines.put(line.rstrip("\n"))

    def until(self, what: str, shown: Callable[[np.ndarray], bool]) -> np.ndarray:
        """The picture, once it is as wanted."""
        end = time.monotonic() + SECONDS
        while time.monotonic() < end:
            picture = self.display.picture()
            if shown(picture):
                return picture
            assert self.process.poll() is None, self.process.stderr and self.process.stderr.read()
            time.sleep(0.05)
        raise AssertionError(f"not seen in {SECONDS:g} s: {what}")

    def steady(self) -> np.ndarray:
        """The picture, once it has stopped changing."""
        last, since = self.display.picture(), time.monotonic()

        def still(picture: np.ndarray) -> bool:
            nonlocal last, since
            if (picture != last).any():
                last, since = picture, time.monotonic()
            return time.monotonic() - since > 1.0

        return self.until("a steady picture", still)

    def printed(self, start: str) -> str:
        """The next line that begins like this."""
        while True:
            line = self.lines.get(timeout=SECONDS)
            if line.startswith(start):
                return line


@contextmanager
def opened(folder: Path, *arguments: str) -> Iterator[Window]:
    if missing_display():
        pytest.skip(missing_display())
    with x_display() as display:
        made = Window(display, folder, *arguments, "--size", "640x400")
        try:
            yield made
        finally:
            made.process.kill()
            made.process.wait()
            made.reader.join()
            for pipe in (made.process.stdout, made.process.stderr):
                assert pipe is not None
                pipe.close()


@pytest.fixture
def window(tmp_path: Path) -> Iterator[Window]:
    (tmp_path / "bar.toml").write_text(toml_text(DOCUMENT), encoding="utf-8")
    with opened(tmp_path, "bar.toml") as made:
        yield made


def body(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre (x, y) and spread of what is as bright as the bar in the window's middle."""
    part = picture[60:330, :500].mean(axis=2)
    row, column = np.nonzero(part > part.mean() + 40.0)
    return np.array([column.mean(), row.mean() + 60]), np.array([np.ptp(column), np.ptp(row)])


def solved(picture: np.ndarray) -> bool:
    """Whether there is the blue of the slider."""
    part = picture[360:400, :640].astype(int)
    return bool((part[..., 2] - part[..., 0] > 60).mean() > 0.05)


def test_a_user_at_the_window(window: Window, tmp_path: Path) -> None:
    display = window.display
    window.until("the bar", lambda picture: picture[60:330, :500].std() > 15.0)
    display.move(320, 200)
    window.until("the slider, once it is solved", solved)
    first = window.steady()
    display.drag((320, 250), (460, 250))
    turned = window.steady()
    assert (turned != first).mean() > 0.01
    display.key("1")
    front = window.steady()
    centre, spread = body(front)
    display.move(int(centre[0]), int(centre[1]))
    for _ in range(3):
        display.click(4)
    nearer = window.until("a zoom", lambda p: (p != front).mean() > 0.01)
    nearer = window.steady()
    assert body(nearer)[1][1] > 1.15 * spread[1]
    np.testing.assert_allclose(body(nearer)[0][1], centre[1], atol=6.0)
    display.key("c")
    assert window.printed("position_mm").startswith("position_mm = [")
    display.key("Home")
    window.steady()
    display.key("s")
    path = tmp_path / "bar-001.png"
    window.until("a saved picture", lambda _: path.exists())
    saved = np.asarray(Image.open(path))
    seen = window.steady()[:400, :640]
    assert saved.shape == (400, 640, 3)
    assert (np.abs(saved[60:310].astype(int) - seen[60:310]) <= 1).mean() > 0.99
    # another scene, then a fault
    scene = tmp_path / "bar.toml"
    text = scene.read_text(encoding="utf-8")
    scene.write_text(text.replace("20.0, 10.0]", "20.0, 40.0]"), encoding="utf-8")
    window.until("a thicker bar", lambda p: body(p)[1][1] > 1.5 * spread[1])
    good = window.steady()
    scene.write_text(text.replace("size_mm", "size_m"), encoding="utf-8")
    red = window.until("a fault", lambda p: (p[..., 0].astype(int) - p[..., 1] > 90).any())
    assert (red[60:200, :640] == good[60:200, :640]).mean() > 0.9  # over the last good view
    # Ctrl-C, in the middle of a picture as likely as not
    display.button(1, True)
    for x in range(200, 400, 20):
        display.move(x, 250)
    window.process.send_signal(signal.SIGINT)
    assert window.process.wait(SECONDS) == 130
    assert window.process.stderr and window.process.stderr.read() == "reading bar.toml …\n"


def test_from_a_step_part_to_a_camera_that_frames_it(
    tmp_path: Path, checkout: Path, device: Device
) -> None:
    """As docs/view.md says, with its scene: what `c` copies sees the same."""
    with Gmsh() as gmsh:
        occ = gmsh.model.occ
        occ.fuse([(3, occ.addBox(0, 0, 0, 80, 50, 6))], [(3, occ.addBox(0, 0, 0, 6, 50, 60))])
        occ.synchronize()
        gmsh.write(str(tmp_path / "bracket.step"))
    with opened(tmp_path, "bracket.step") as window:
        display = window.display
        display.move(320, 200)
        window.until("the part", lambda picture: picture[60:330, :600].std() > 15.0)
        display.drag((320, 250), (220, 300))
        display.click(5)
        display.drag((320, 200), (340, 180), button=2)
        display.key("Home")
        seen = window.steady()[:400, :640]
        display.key("c")
        lines = [window.printed("[[camera]]"), *(window.printed("") for _ in range(7))]
        assert display.clipboard().splitlines() == lines
    document = (checkout / "docs" / "view.md").read_text(encoding="utf-8")
    scene = document.split("```toml")[1].split("# the lines of the camera")[0]
    (tmp_path / "bracket.toml").write_text(scene + "\n".join(lines), encoding="utf-8")
    content = load_content(tmp_path / "bracket.toml")
    part = Viewer(device, tmp_path / "bracket.step", (640, 400))
    part.look(part.view.of_camera(content.cameras[0], content.outline(0, 1.0).mean(axis=0)))
    again = screenshot(part)
    part.close()
    assert seen[40:300].std() > 15.0
    assert (np.abs(seen.astype(int) - again) <= 1).mean() > 0.999
    assert (np.abs(seen.astype(int) - np.roll(again, 1, axis=1)) <= 1).mean() < 0.99
