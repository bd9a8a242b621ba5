"""Time of an image against its number of faces: ``python -m benchmarks.faces [--write]``.

A bumpy plate fills the image, patterned and lit, or stands as a bent sheet before a wall, or a bent
beam or round bar does, a closed body. Faces are cut finer and finer, and nothing else changes: what
they cost is what the image's time grows by.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.light import Light

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
)
"""A plate of squares under a lamp without shadows, the same with shadows, speckle without; a beam,
a sheet or a round bar before a wall under a lamp without shadows, with them, and with soft ones."""

COUNTS = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)


@dataclass(frozen=True)
class Timing:
    """Seconds with about ``faces`` quads: a warm image, what it takes of all processors together
    (host and device overlap), the same where every image shows the vertices elsewhere, and the
    first image, which finds the surface's topology and compiles."""

    faces: int
    image: float
    processor: float
    moved: float
    moved_processor: float
    first: float


def plate(faces: int, paint: gs.paint.Paint | None = None) -> gs.Surface:
    """A plate of 1 x 0.66 with gentle bumps, painted with squares if with nothing else, in about
    ``faces`` quads."""
    rows = max(int(np.sqrt(faces / 1.5)), 2)
    columns = max(faces // rows, 2)
    x, z = np.linspace(-0.5, 0.5, columns + 1), np.linspace(-0.33, 0.33, rows + 1)
    flat = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    bumpy = flat.copy()
    bumpy[:, 1] = 0.01 * np.sin(7.0 * flat[:, 0]) * np.cos(5.0 * flat[:, 2])
    number = np.arange(len(flat)).reshape(columns + 1, rows + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    return gs.Surface(bumpy, quads.reshape(-1, 4), paint or gs.paint.Checker(0.05), reference=flat)


def bent_sheet(faces: int) -> gs.Surface:
    """A smaller plate, bent, before the place of the wall."""
    flat = plate(faces)
    points = flat.points * [0.6, 1.0, 0.6]
    points[:, 1] += 0.05 * np.sin(4.0 * flat.points[:, 0]) - 0.1
    return gs.Surface(points, flat.faces, gs.paint.Plain(0.5))


def beam(faces: int) -> gs.Surface:
    """The skin of a bent beam of 1 x 0.1 x 0.1 in about ``faces`` quads, squares on its front."""
    across = max(int(np.sqrt(faces / 42.0)), 1)
    cells = np.array([10 * across, across, across])
    places, quads = [], []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        grid = np.meshgrid(*(np.arange(cells[k] + 1) for k in (first, second)), indexing="ij")
        number = np.arange(grid[0].size).reshape(grid[0].shape)
        own = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
        for end, way in ((cells[axis], 1), (0, -1)):
            place = np.empty((grid[0].size, 3))
            place[:, axis], place[:, first], place[:, second] = end, *(v.reshape(-1) for v in grid)
            quads.append(own.reshape(-1, 4)[:, ::way] + sum(len(v) for v in places))
            places.append(place)
    front = np.repeat(np.arange(6) == 3, [len(v) for v in quads])
    whole, which = np.unique(np.concatenate(places), axis=0, return_inverse=True)
    rest = whole / cells * [1.0, 0.1, 0.1] - [0.5, 0.05, 0.05]
    points = rest - [0.0, 0.0, 0.08] * (rest[:, :1] + 0.5) ** 2
    return gs.Surface(
        points, which.reshape(-1)[np.concatenate(quads)],
        {"front": gs.paint.Checker(0.02), "rest": gs.paint.Plain(0.6)},
        region=np.where(front, 0, 1).astype(np.int32), reference=rest,
    )  # fmt: skip


def rod(faces: int) -> gs.Surface:
    """The skin of a bent round bar of 1 x 0.16 in about ``faces`` quads, closed by round ends."""
    around = max(int(np.sqrt(2.0 * faces)), 8)
    along = max(faces // around, 8)
    turn = np.arange(around) * (2.0 * np.pi / around)
    place = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, along + 2)[1:-1])
    radius = 0.08 * np.sqrt(1.0 - place**16)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    cuts = [np.insert(r * ring, 0, 0.5 * at, axis=1) for at, r in zip(place, radius, strict=True)]
    points = np.concatenate([*cuts, [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]])
    points[:, 1] -= 0.1
    points[:, 2] -= 0.05 * (points[:, 0] + 0.5) ** 2
    first = np.arange(around)
    after = np.roll(first, -1)
    row = around * np.arange(along - 1)[:, None]
    quads = np.stack([first + row, after + row, after + row + around, first + row + around], -1)
    none, last = np.full(around, -1), around * (along - 1)
    ends = [
        np.stack([np.full(around, len(points) - 2), after, first, none], axis=1),
        np.stack([np.full(around, len(points) - 1), first + last, after + last, none], axis=1),
    ]
    return gs.Surface(points, np.concatenate([quads.reshape(-1, 4), *ends]), gs.paint.Plain(0.5))


def wall() -> gs.Surface:
    """Behind the beam."""
    corners = [[-1.0, 0.4, -0.8], [1.0, 0.4, -0.8], [1.0, 0.4, 0.8], [-1.0, 0.4, 0.8]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), gs.paint.Plain())


def scene_of(name: str, faces: int) -> tuple[gs.Surface, list[gs.Surface], list[Light]]:
    """The surface that is cut, those behind it, and the lamps."""
    lamps: list[Light] = [gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows="shadows" in name)]
    if name.endswith("soft"):
        lamps = [gs.AreaLight((-1.0, -2.0, 1.0), (0.0, 0.0, 0.0), (0.3, 0.2), 50.0)]
    before = {"beam": beam, "sheet": bent_sheet, "rod": rod}.get(name.split("-")[0])
    if before is not None:
        return before(faces), [wall()], lamps
    return plate(faces, gs.paint.Speckle(diameter=0.004) if name == "speckle" else None), [], lamps


def measure(faces: int, width: int, device: Device, repeats: int, scene: str) -> Timing:
    """The fastest of ``repeats`` warm images of either kind, and the first one."""
    surface, behind, lights = scene_of(scene, faces)
    eye = (0.2, -1.2, 0.5) if behind else (0.1, -1.0, 0.1)
    camera = gs.Camera.from_lens((36.0, 24.0), 34.0, (width, width * 2 // 3), eye, (0, 0, 0))

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
    return Timing(faces, image, processor, moved_image, moved_processor, still[0][0])


def plot(rows: list[Timing], title: str, path: Path) -> None:
    """Seconds over faces."""
    matplotlib.use("Agg")
    from matplotlib import pyplot

    faces = [row.faces for row in rows]
    figure, axes = pyplot.subplots(figsize=(6.0, 4.0))
    axes.semilogx(faces, [row.image for row in rows], "o-", label="image")
    axes.semilogx(faces, [row.processor for row in rows], "s--", label="processor seconds")
    axes.semilogx(faces, [row.moved for row in rows], "^:", label="image, vertices elsewhere")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("faces")
    axes.set_ylabel("s")
    axes.set_title(title)
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=2790, help="px (5.2 Mpx; 5616: 21 Mpx)")
    parser.add_argument("--most", type=int, default=COUNTS[-1], help="faces")
    parser.add_argument("--scene", choices=SCENES, default="board", help="paint and lamp")
    parser.add_argument("--repeats", type=int, default=3, help="warm images of each")
    parser.add_argument("--write", action="store_true", help="also write results/faces.*")
    arguments = parser.parse_args()
    device = Device()
    size = f"{arguments.width} x {arguments.width * 2 // 3} px"
    lines = [
        "# Faces", "",
        f"{device.name}; {size}, lit, {arguments.scene}", "",
        "| faces | image s | processor s | moved: image s | processor s | first image s |",
        "|---|---|---|---|---|---|",
    ]  # fmt: skip
    print("\n".join(lines), flush=True)
    rows = []
    for faces in (n for n in COUNTS if n <= arguments.most):
        row = measure(faces, arguments.width, device, arguments.repeats, arguments.scene)
        rows.append(row)
        numbers = (row.image, row.processor, row.moved, row.moved_processor, row.first)
        lines.append(f"| {faces} | " + " | ".join(f"{n:.3f}" for n in numbers) + " |")
        print(lines[-1], flush=True)
    if arguments.write:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / "faces.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
        plot(rows, f"{size}, lit, {arguments.scene}", RESULTS / "faces.png")


if __name__ == "__main__":
    main()
