"""What a dispatch of no workgroups costs, program by program.

Some drivers compile a program anew at each dispatch. Mesa lavapipe does where branches depend on
uniforms alone and half of the program goes if these are known: 5 to 20 ms each time, of images that
take 30. In WGSL `a & b`, where b isn't uniform, is no such branch, as `a && b` is. Programs above
1 ms are marked.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import gpusim as gs
from benchmarks.faces import SCENES, camera_of, scene_of
from gpusim.gpu.recording import Recording

REPEATS = 5

MARKED = 1e-3
"""Seconds."""


@contextmanager
def measured(found: dict[str, float]) -> Iterator[None]:
    """Fill ``found``: by name of each program that is dispatched meanwhile, what a dispatch of no
    workgroups costs, measured after the recording that it is part of."""
    begin, leave = Recording._begin_computing, Recording.__exit__
    used: dict[str, tuple[Any, Any]] = {}

    def begun(recording: Recording, kernel: Any, bindings: Any) -> None:
        used[kernel.name] = kernel, bindings
        begin(recording, kernel, bindings)

    def left(recording: Recording, *error: Any) -> None:
        leave(recording, *error)
        mine, Recording.__exit__ = dict(used), leave  # type: ignore[method-assign]
        for name, (kernel, bindings) in mine.items():
            cost = seconds(recording.device, kernel, bindings)
            found[name] = max(found.get(name, 0.0), cost)
        Recording.__exit__ = left  # type: ignore[method-assign]
        used.clear()

    Recording._begin_computing = begun  # type: ignore[method-assign]
    Recording.__exit__ = left  # type: ignore[method-assign]
    try:
        yield
    finally:
        Recording._begin_computing = begin  # type: ignore[method-assign]
        Recording.__exit__ = leave  # type: ignore[method-assign]


def seconds(device: gs.Device, kernel: Any, bindings: Any) -> float:
    """Processor time of one dispatch of no workgroups, in a pass of its own."""
    best = float("inf")
    for _ in range(3):
        device.sync()
        start = time.process_time()
        with device.recording("empty") as recording:
            for _ in range(REPEATS):
                recording.begin("empty")
                recording._begin_computing(kernel, bindings)
                recording._pass.dispatch_workgroups(0, 1, 1)
        device.sync()
        best = min(best, (time.process_time() - start) / REPEATS)
    return best


def main() -> None:
    """Print them, the dearest first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE")
    parser.add_argument("--faces", type=int, default=1000)
    parser.add_argument("--width", type=int, default=700)
    given = parser.parse_args()
    found: dict[str, float] = {}
    for name in given.scenes:
        device = gs.Device()
        surface, behind, lights = scene_of(name, given.faces)
        camera = camera_of(name, given.width)
        gs.render([surface, *behind], camera, lights, device=device).release()
        with measured(found):
            gs.render([surface, *behind], camera, lights, device=device).release()
    for program, cost in sorted(found.items(), key=lambda one: -one[1]):
        print(f"{1e3 * cost:7.2f} ms  {program}{'  <--' if cost > MARKED else ''}")


if __name__ == "__main__":
    main()
