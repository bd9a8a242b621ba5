"""How the preview window feels: first picture, frames a second while it turns, reload, memory.

    python -m benchmarks.view                       a minute, on a display of its own (Xvfb)
    python -m benchmarks.view --minutes 10          memory over ten minutes
    python -m benchmarks.view --display :0          on a screen

The window is opened by this process and turned by itself, as a mouse would: each frame is drawn by
the window's own code and shown on the display. Processor time stands beside each time: on a busy
machine that tells more.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "crane.toml"


def memory_mb() -> float:
    """What this process has in memory now."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * resource.getpagesize() / 1e6


class Session:
    """A window that is turned and reloaded, and what that took."""

    def __init__(self, scene: Path, size: tuple[int, int], seconds: float, begun: float) -> None:
        from gpusim.gpu import default_device
        from gpusim.view.viewer import Viewer

        self.scene, self.seconds, self.begun = scene, seconds, begun
        self.viewer = Viewer(default_device(), scene, size)
        self.frames, self.start, self.spent = 0, 0.0, 0.0
        self.memory: list[float] = []
        self.state, self.touched = "first", 0.0

    def drawn(self, window: object) -> None:
        """After each picture: what comes next."""
        viewer, now = self.viewer, time.monotonic()
        if self.state == "first":
            spent = time.process_time()
            print(f"first picture     {now - self.begun:8.2f} s {spent:8.2f} s of processor time")
            self.state = "solving"
        elif self.state == "solving" and viewer.solver is None and viewer.picture.complete:
            print(f"solved and exact  {now - self.begun:8.2f} s")
            self.state, self.start, self.spent = "turning", now, time.process_time()
        elif self.state == "turning":
            self.frames += 1
            if now - self.start - len(self.memory) * 5.0 > 0.0:
                self.memory.append(memory_mb())
            if now - self.start > self.seconds:
                self._turned(now)
        elif self.state == "reloading" and viewer.content is not self.content:
            print(f"reload            {now - self.touched:8.2f} s")
            window.canvas.close()  # type: ignore[attr-defined]
        if self.state == "turning":
            viewer.look(viewer.view.orbit(4.0, 0.0, viewer.size[1]))
            window.canvas.request_draw()  # type: ignore[attr-defined]

    def _turned(self, now: float) -> None:
        rate = self.frames / (now - self.start)
        spent = (time.process_time() - self.spent) / self.frames
        picture = self.viewer.picture
        size = picture.base and (picture.base.width, picture.base.height)
        print(f"turning           {rate:8.1f} frames/s, {1e3 * spent:.0f} ms of processor time a "
              f"frame, at {size} px")  # fmt: skip
        third = self.memory[len(self.memory) // 3 :]
        print(f"memory            {third[0]:8.0f} MB, then {third[-1]:.0f} MB")
        self.state, self.touched, self.content = "reloading", now, self.viewer.content
        text = self.scene.read_text(encoding="utf-8")
        self.scene.write_text(text.replace("albedo = 0.56", "albedo = 0.5"), encoding="utf-8")


def main() -> None:
    begun = time.monotonic()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", type=Path, default=EXAMPLE)
    parser.add_argument("--minutes", type=float, default=0.25)
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 800))
    parser.add_argument("--display")
    given = parser.parse_args()
    if given.display:
        os.environ["DISPLAY"] = given.display
    elif "GPUSIM_BENCH_DISPLAY" not in os.environ:
        screen = ["-screen", "0", "2000x1300x24"]
        command = ["xvfb-run", "-a", "-s", " ".join(screen), sys.executable, "-m", __spec__.name]
        os.environ["GPUSIM_BENCH_DISPLAY"] = "own"
        raise SystemExit(subprocess.call([*command, *sys.argv[1:]]))

    from gpusim.view import window

    with tempfile.TemporaryDirectory() as folder:
        scene = Path(shutil.copy(given.scene, folder))
        session = Session(scene, tuple(given.size), 60.0 * given.minutes, begun)
        draw = window.WindowView.draw

        def draw_and_go_on(self: window.WindowView) -> None:
            draw(self)
            session.drawn(self)

        window.WindowView.draw = draw_and_go_on  # type: ignore[method-assign]
        window.open_window(session.viewer)


if __name__ == "__main__":
    main()
