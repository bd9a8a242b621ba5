"""Time of images against their number of faces: ``python -m benchmarks.faces [--write]``.

A bumpy plate fills the image, patterned and lit, or a body of `benchmarks.bodies` stands before a
wall. Faces are cut finer and finer, and nothing else changes: what they cost is what the image's
time grows by. The same outlines and creases become more edges then, too, about as the root of the
number of faces.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np

import gpusim as gs
from benchmarks.bodies import (
    beam,
    bent_sheet,
    crane,
    crane_wall,
    eggs,
    flanges,
    plate,
    rod,
    tube,
    wall,
)
from gpusim.errors import InputError, OutOfDeviceMemory
from gpusim.gpu import Device
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import Light

RESULTS = Path(__file__).parent / "results"
SCENES = (
    "board",
    "shadows",
    "speckle",
    "beam",
    "beam-shadows",
    "beam-soft",
    "sheet-shadows",
    "sheet-soft",
    "rod-shadows",
    "rod-soft",
    "tube-shadows",
    "tube-soft",
    "flanges-shadows",
    "flanges-soft",
    "flanges-low",
    "eggs-shadows",
    "eggs-low",
    "crane",
)
"""A plate of squares under a lamp without shadows, the same with shadows, speckle without; a beam,
a sheet, a round bar, and bodies that hide parts of themselves (open tube, I beam, egg box) before a
wall under a lamp without shadows, with them, with soft ones, and with soft ones in grazing
light; the example's crane, bent, of steel with markers, its two lamps, its room and its wall."""

CRANE_LAMPS = ((-0.5, -2.0, 0.1), (-1.3, -2.1, 0.05))
LAMPS = {"soft": ((-1.0, -2.0, 1.0), 50.0), "low": ((-2.0, -0.45, 0.3), 80.0)}
BEFORE = {
    "beam": beam,
    "sheet": bent_sheet,
    "rod": rod,
    "tube": tube,
    "flanges": flanges,
    "eggs": eggs,
}

COUNTS = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)


@dataclass(frozen=True)
class Timing:
    """Seconds with about ``faces`` quads: a warm image, what it takes of all processors together
    (host and device overlap), the same where every image shows the vertices elsewhere, and the
    first image, which finds the surface's topology and compiles. ``edges``: of outlines, creases
    and regions in the image."""

    faces: int
    edges: int
    image: float
    processor: float
    moved: float
    moved_processor: float
    first: float


def scene_of(name: str, faces: int) -> tuple[gs.Surface, list[gs.Surface], list[Light]]:
    """The surface that is cut, those behind it, and the lamps."""
    lamps: list[Light] = [gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows="shadows" in name)]
    if name == "crane":
        aim, size = (0.3, -0.02, 0.3), (0.12, 0.08)
        lamps = [gs.AreaLight(place, aim, size, 60.0) for place in CRANE_LAMPS]
        room = gs.EnvironmentLight(1.6, 0.6)
        return crane(faces), [crane_wall()], [*lamps, room]
    body, _, kind = name.partition("-")
    if kind in LAMPS:
        place, power = LAMPS[kind]
        lamps = [gs.AreaLight(place, (0.0, 0.0, 0.0), (0.3, 0.2), power)]
    before = BEFORE.get(body)
    if before is not None:
        return before(faces), [wall()], lamps
    return plate(faces, gs.paint.Speckle(diameter=0.004) if name == "speckle" else None), [], lamps


def camera_of(name: str, width: int) -> gs.Camera:
    """Before the bodies, or near the plate."""
    size = (width, width * 2 // 3)
    if name == "crane":
        return gs.Camera.from_lens((36.0, 24.0), 30.0, size, (0.3, -1.02, 0.29), (0.3, -0.02, 0.29))
    eye = (0.2, -1.2, 0.5) if name.partition("-")[0] in BEFORE else (0.1, -1.0, 0.1)
    return gs.Camera.from_lens((36.0, 24.0), 34.0, size, eye, (0, 0, 0))


def measure(faces: int, width: int, device: Device, repeats: int, scene: str) -> Timing:
    """The fastest of ``repeats`` warm images of either kind, and the first one."""
    surface, behind, lights = scene_of(scene, faces)
    camera = camera_of(scene, width)

    def timed(shown: gs.Surface) -> tuple[float, float]:
        start, used = time.perf_counter(), time.process_time()
        frame = gs.render([shown, *behind], camera, lights, device=device)
        device.sync()
        result = time.perf_counter() - start, time.process_time() - used
        frame.release()
        return result

    # the first one compiles, the second one puts on the device what stays there
    still = [timed(surface) for _ in range(repeats + 2)]
    step = np.array([0.0, 1e-5, 0.0])
    series = [surface.moved(surface.points + k * step) for k in range(1, repeats + 2)]
    moved = [timed(shown) for shown in series][1:]
    image, processor = np.min(still[2:], axis=0).tolist()
    moved_image, moved_processor = np.min(moved, axis=0).tolist()
    edges = len(look([surface, *behind], camera, lit=True).edges)
    return Timing(faces, edges, image, processor, moved_image, moved_processor, still[0][0])


def _growth(rows: list[Timing]) -> str:
    """How many times the last is the first."""
    first, last = rows[0], rows[-1]
    return (
        f"\nfaces x {last.faces / first.faces:.0f}, edges x {last.edges / first.edges:.1f}, "
        f"image x {last.image / first.image:.1f}, moved x {last.moved / first.moved:.1f}"
    )


def plot(found: dict[str, list[Timing]], title: str, path: Path) -> None:
    """Seconds of a warm image over faces, scene by scene, beside what grows with them."""
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8.0, 5.2))
    markers = "os^vDPX*<>hp"
    for k, (scene, rows) in enumerate(found.items()):
        axes.loglog(
            [row.faces for row in rows], [row.image for row in rows],
            marker=markers[k % len(markers)], linestyle="-" if k < 10 else "--", label=scene,
        )  # fmt: skip
    low, high = 1e3, max(row.faces for rows in found.values() for row in rows)
    axes.loglog([low, high], [0.05, 0.05 * high / low], "k:", label="as faces grow")
    axes.loglog([low, high], [0.05, 0.05 * (high / low) ** 0.5], "k--", label="as edges grow")
    axes.set_xlabel("faces")
    axes.set_ylabel("s")
    axes.set_title(title)
    axes.grid(True, which="both", alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize="small")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=2790, help="px (5.2 Mpx; 5616: 21 Mpx)")
    parser.add_argument("--faces", type=int, nargs="+", default=COUNTS, help="about so many")
    parser.add_argument("--scene", choices=SCENES, nargs="+", default=["board"], help="see SCENES")
    parser.add_argument("--repeats", type=int, default=3, help="warm images of each")
    parser.add_argument("--write", action="store_true", help="also write results/faces.*")
    arguments = parser.parse_args()
    device = Device()
    size = f"{arguments.width} x {arguments.width * 2 // 3} px"
    lines = ["# Faces", "", f"{device.name}; {size}, lit."]
    print("\n".join(lines), flush=True)
    found: dict[str, list[Timing]] = {}
    for scene in arguments.scene:
        head = [
            "", f"`{scene}`:", "",
            "| faces | edges | image s | processor s | moved: image s | processor s | first s |",
            "|---|---|---|---|---|---|---|",
        ]  # fmt: skip
        print("\n".join(head), flush=True)
        lines += head
        rows = found.setdefault(scene, [])
        for faces in arguments.faces:
            try:
                row = measure(faces, arguments.width, device, arguments.repeats, scene)
            except (InputError, OutOfDeviceMemory) as error:
                lines.append(f"| {faces} | refused: {str(error).split(';')[1].strip()} |")
                print(lines[-1], flush=True)
                break
            rows.append(row)
            numbers = (row.image, row.processor, row.moved, row.moved_processor, row.first)
            lines.append(
                f"| {faces} | {row.edges} | " + " | ".join(f"{n:.3f}" for n in numbers) + " |"
            )
            print(lines[-1], flush=True)
        if len(rows) > 1:
            lines.append(_growth(rows))
            print(lines[-1], flush=True)
    if arguments.write:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / "faces.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
        plot(found, f"{size}, lit: a warm image", RESULTS / "faces.png")


if __name__ == "__main__":
    main()
