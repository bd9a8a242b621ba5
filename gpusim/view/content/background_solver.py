"""A scene solved in another process, which tells how far it is.

Not in a thread: short array operations of two threads of Python hold each other up, and the view
would jerk. The process ends when it is done, when it is stopped, or when this one ends.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

from gpusim.scene import Scene
from gpusim.scene.cost import Counts

_CHILD = (
    "import os, pickle, sys; getattr(os, 'nice', int)(10); "  # the window comes first
    "sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from gpusim.view.content.background_solver import solve_here; solve_here()"
)


class BackgroundSolver:
    """The solution of a scene in the making; ``made``: how large its meshes are.

    ``progress``: 0 to 1, and words. ``done``: with files below ``folder`` as a run writes them.
    ``fault``: what ended it otherwise.
    """

    def __init__(self, scene: Scene, made: Counts | None = None) -> None:
        self.progress: tuple[float, str] = (0.0, "solving")
        self.done, self.fault = False, ""
        self._folder = tempfile.TemporaryDirectory(prefix="gpusim-view-")
        self.folder = Path(self._folder.name)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, env={**os.environ, "PYTHONWARNINGS": "ignore"},
        )  # fmt: skip
        call = pickle.dumps(sys.path) + pickle.dumps((os.getpid(), scene, made, self.folder))
        self._thread = threading.Thread(target=self._follow, args=(call,), daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether there is something to wait for."""
        return not self.done and not self.fault

    def stop(self) -> None:
        """End it, and delete its files."""
        self.fault = self.fault or "stopped"
        self._process.kill()
        self._process.wait()
        self._thread.join()
        for pipe in (self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()
        self._folder.cleanup()

    def _follow(self, call: bytes) -> None:
        process = self._process
        assert process.stdin and process.stdout and process.stderr
        with suppress(OSError):  # it has died: its last words follow
            process.stdin.write(call)
            process.stdin.close()
        for line in process.stdout:
            with suppress(ValueError):
                said: dict[str, Any] = json.loads(line)
                self.progress = said.get("share", 1.0), said.get("text", "")
                self.fault = self.fault or said.get("fault", "")
        words = process.stderr.read().decode("utf-8", "replace").strip()
        if process.wait() == 0 and not self.fault:
            self.done = True
        elif not self.fault:
            self.fault = words.splitlines()[-1] if words else "the process that solves has died"


def solve_here() -> None:
    """What the other process does."""
    from gpusim.errors import GpusimError
    from gpusim.parallel.processes import end_with
    from gpusim.view.content.loading import check_room

    parent, scene, made, folder = pickle.load(sys.stdin.buffer)
    end_with(parent)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def tell(**words: Any) -> None:
        answers.write(json.dumps(words) + "\n")
        answers.flush()

    try:
        check_room(scene, "model", "solve", "stress", made=made)
        _solve(scene, folder, lambda share, text: tell(share=share, text=text))
    except GpusimError as error:
        tell(fault=str(error))
    except Exception as error:
        tell(fault=f"{type(error).__name__}: {error}")


def _solve(scene: Scene, folder: Path, progress: Any) -> None:
    """Solution and stress of a scene, as a run makes them, into ``folder``."""
    from gpusim.pipeline.runner.part import make_part

    document = scene.document
    document["output"] = {"stress": True}
    whole = Scene.from_document(document, source=scene.source, files=scene.files)
    shares = {"solve": (0.05, 0.45), "equilibria": (0.45, 0.85), "stress": (0.85, 1.0)}
    make_part(whole, shares, folder, progress)
