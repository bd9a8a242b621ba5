"""What colour costs: ``python -m benchmarks.color [--faces 10000] [--width 1395] [--rounds 3]``.

Pictures of the scenes of `benchmarks.faces` under grey and under coloured lamps, by turns; without
lamps the background has the colour. Printed is the fastest of each, and their ratio.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace

import gpusim as gs
from benchmarks.faces import camera_of, scene_of
from gpusim.gpu import Device
from gpusim.optics.light.lights import Light

SCENES = ("crane", "beam-soft", "flanges-soft", "sheet-shadows", "speckle", "board", "board, unlit")
WARM = (1.3, 1.0, 0.7)


def seconds(
    shown: Sequence[gs.Surface],
    camera: gs.Camera,
    lights: Sequence[Light] | None,
    background: float | tuple[float, float, float],
    device: Device,
) -> float:
    """Of one picture, all of it on the device."""
    start = time.perf_counter()
    frame = gs.render(shown, camera, lights, background=background, device=device)
    device.sync()
    result = time.perf_counter() - start
    frame.release()
    return result


def compare(name: str, faces: int, width: int, rounds: int, device: Device) -> str:
    """A row: scene, seconds in grey and in colour, ratio."""
    body, behind, lamps = scene_of(name.removesuffix(", unlit"), faces)
    camera, shown = camera_of(name.removesuffix(", unlit"), width), [body, *behind]
    grey: tuple[Sequence[Light] | None, float] = lamps, 0.0
    coloured: tuple[Sequence[Light] | None, tuple[float, float, float]] = (
        [replace(lamp, color=WARM) for lamp in lamps], (0.0, 0.0, 0.0)
    )  # fmt: skip
    if name.endswith("unlit"):
        grey, coloured = (None, 0.0), (None, (0.1, 0.0, 0.0))
    best = [float("inf"), float("inf")]
    for turn in range(rounds + 1):
        for k, (lights, background) in enumerate((grey, coloured)):
            found = min(seconds(shown, camera, lights, background, device) for _ in range(3))
            if turn:
                best[k] = min(best[k], found)
    return f"| {name} | {best[0]:.3f} | {best[1]:.3f} | {best[1] / best[0]:.2f} |"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.color")
    parser.add_argument("--faces", type=int, default=10_000)
    parser.add_argument("--width", type=int, default=1395)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    device = Device()
    print(f"{device.name}, {given.faces} faces, {given.width} px\n")
    print("| scene | grey s | coloured s | ratio |\n|---|---|---|---|")
    for name in SCENES:
        print(compare(name, given.faces, given.width, given.rounds, device), flush=True)


if __name__ == "__main__":
    main()
