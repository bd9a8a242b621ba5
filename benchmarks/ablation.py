"""What each shortcut of a frame's plan gains: ``python -m benchmarks.ablation [NAME...]``.

Every shortcut of `gpusim.optics.rendering.frame_plan` has a scene that users have, in which it has
to gain 1.2 times. Each is rendered with and without it, by turns; the ratio is that of the fastest.
Ends with 1 where one gains less: such a path goes. Times are of all processors together.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from unittest import mock

import gpusim as gs
from benchmarks.faces import camera_of, scene_of
from gpusim.bench.image_cases import IMAGE_CASES
from gpusim.gpu import Device, default_device
from gpusim.optics.light.lights import Light
from gpusim.optics.rendering.frame_plan import SHORTCUTS, FramePlan, plan_frame

GAIN = 1.2
"""At least, of a special path."""

Scene = tuple[list[gs.Surface], gs.Camera, list[Light] | None]


def sheets(name: str, faces: int, width: int) -> Scene:
    """A scene of `benchmarks.faces`."""
    surface, behind, lights = scene_of(name, faces)
    return [surface, *behind], camera_of(name, width), lights


def picture(name: str) -> Scene:
    """An image case of ``gpusim bench render``, in full size."""
    case = IMAGE_CASES[name]("full")
    return list(case.surfaces), case.camera, list(case.lights) or None


CASES: dict[str, tuple[str, Callable[[], Scene]]] = {
    "deferred": ("board of 300,000 faces", lambda: sheets("board", 300_000, 2790)),
    "checker_lines": ("unlit board", lambda: picture("board")),
    "tile_light": ("lit crane, 21 Mpx", lambda: picture("crane-lit")),
    "plate_border": ("unlit board", lambda: picture("board")),
}


def seconds(scene: Scene, device: Device, plan: Callable[..., FramePlan]) -> float:
    """Of one image."""
    surfaces, camera, lights = scene
    with mock.patch.object(import_module("gpusim.optics.rendering.renderer"), "plan_frame", plan):
        start = time.process_time()
        frame = gs.render(surfaces, camera, lights, device=device)
        device.sync()
        spent = time.process_time() - start
    frame.release()
    return spent


def gain(name: str, device: Device, repeats: int) -> tuple[float, float]:
    """Seconds with and without a shortcut, the fastest of so many turns each."""
    scene = CASES[name][1]()

    def without(*args: object, **kwargs: object) -> FramePlan:
        return plan_frame(*args, **kwargs).replace(**{name: False})  # type: ignore[arg-type]

    spent: tuple[list[float], list[float]] = [], []
    for turn in range(repeats + 1):
        for times, plan in zip(spent, (plan_frame, without), strict=True):
            taken = seconds(scene, device, plan)
            if turn:  # the first ones compile
                times.append(taken)
    return min(spent[0]), min(spent[1])


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit status: 1 where a shortcut gains too little."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(SHORTCUTS), metavar="NAME")
    parser.add_argument("--repeats", type=int, default=5)
    asked = parser.parse_args(arguments)
    device, poor = default_device(), []
    print("| shortcut | scene | with | without | gain |\n|---|---|---|---|---|")
    for name in asked.names:
        used, left_out = gain(name, device, asked.repeats)
        ratio = left_out / used
        print(f"| {name} | {CASES[name][0]} | {1e3 * used:.0f} ms | {1e3 * left_out:.0f} ms "
              f"| {ratio:.2f} |", flush=True)  # fmt: skip
        poor += [name] if ratio < GAIN else []
    if poor:
        print(f"less than {GAIN}: {', '.join(poor)}", file=sys.stderr)
    return 1 if poor else 0


if __name__ == "__main__":
    sys.exit(main())
