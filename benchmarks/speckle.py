"""The speckle plate: accuracy, size, coverage, time: ``python -m benchmarks.speckle [--write]``.

riley-raster renders the same plate in the same run where `GPUSIM_PEERS_PYTHON` (or
``benchmarks/peers/.venv``) has it; its texture is gpusim's own picture at one texel a pixel.
Accuracy: translations and 1 % strain of a flat plate, 8 bit, found by IC-GN with 31 px subsets and
a quintic spline, no filter.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics import Lens, photograph, psf

RESULTS = Path(__file__).parent / "results" / "speckle.md"
PEER = Path(__file__).parent / "peers" / "riley_speckle.py"
PEERS_PYTHON = os.environ.get("GPUSIM_PEERS_PYTHON", str(PEER.parent / ".venv" / "bin" / "python"))
MOVES = ((0.0, 0.0), (0.1, 0.0), (0.25, 0.0), (0.5, 0.0), (0.0, 0.01))
PAINT = gs.paint.Speckle(6.0, 0.5, 1.5, seed=1, dot=0.05, ground=0.95)
FRAME = (2464, 2056)


def plate(
    paint: gs.paint.Paint, width: int, height: int, move: tuple[float, float], margin: float = 40.0
) -> tuple[gs.Surface, gs.Camera]:
    """A plate whose unit of length is a pixel, larger than the image by ``margin``."""
    x, y, z = 0.5 * width + margin, 0.5 * height + margin, 4.0 * width
    rest = np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])
    points = rest + np.outer(move[0] + move[1] * rest[:, 0], [1.0, 0.0, 0.0])
    frame = gs.PaintFrame(np.array([-x, -y, z]), np.eye(3)[0], np.eye(3)[1])
    surface = gs.Surface(
        points, np.array([[0, 3, 2, 1]]), {"plate": paint}, reference=rest, frames={"plate": frame}
    )
    K = np.array([[z, 0.0, (width - 1) / 2], [0.0, z, (height - 1) / 2], [0.0, 0.0, 1.0]])
    return surface, gs.Camera(width, height, K)


def picture(
    move: tuple[float, float], size: tuple[int, int], device: Device, paint: gs.paint.Paint = PAINT
) -> np.ndarray:
    """8-bit image (H, W)."""
    surface, camera = plate(paint, *size, move)
    frame = gs.render([surface], camera, device=device)
    image: np.ndarray = gs.Sensor(8, 1.0).expose(frame)
    frame.release()
    return image


def riley(folder: Path, texture: np.ndarray, **meta: object) -> list[float] | str:
    """Seconds per frame of every run, or why there are none."""
    np.save(folder / "texture.npy", texture)
    (folder / "meta.json").write_text(json.dumps({"threads": os.cpu_count(), **meta}))
    try:
        done = subprocess.run(
            [PEERS_PYTHON, str(PEER), str(folder)], capture_output=True, text=True, check=False
        )
    except OSError as error:
        return str(error)
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["no message"])[-1]
    result: list[float] = json.loads(done.stdout.splitlines()[-1])
    return result


def accuracy(size: int, step: int, device: Device) -> list[str]:
    """Bias and standard deviation of measured displacements for every renderer."""
    texture = picture((0.0, 0.0), (size + 80, size + 80), device)
    paints = {"gpusim, speckle": PAINT, "gpusim, bitmap": gs.paint.Image(texture, 1.0)}
    images = {
        name: [picture(move, (size, size), device, paint) for move in MOVES]
        for name, paint in paints.items()
    }
    runs = [("cubic_catmull_rom", 4), ("quintic_bspline", 4)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        got = riley(
            folder, texture, width=size, height=size, moves=MOVES, runs=runs, repeats=1, keep=True
        )
        missing = f"\nriley: {got}" if isinstance(got, str) else ""
        for number, (sample, side) in enumerate([] if missing else runs):
            images[f"riley, {sample}, {side**2} samples"] = [
                np.load(folder / f"image_{number}_{k}.npy") for k in range(len(MOVES))
            ]
    lines = [
        f"Flat plate {size} x {size} px, speckle of {PAINT.diameter:g} px with edges "
        f"{PAINT.softness:g} px soft, 8 bit, 31 px subsets; bias / standard deviation, px"
        + missing,
        "",
        "| images | 0.1 px | 0.25 px | 0.5 px | strain 1 % |",
        "|---|---|---|---|---|",
    ]
    for title, (reference, *others) in images.items():
        cells = []
        for image, (shift, strain) in zip(others, MOVES[1:], strict=True):
            edge = 15
            found = gs.measure.dic(
                reference, image, subset=31, step=step, search_px=6,
                roi=(edge, edge, size - 1 - edge, size - 1 - edge), device=device,
            )  # fmt: skip
            x = found.points[:, 0] - (size - 1) / 2
            error = found.displacement[:, 0] - (shift + strain * x)
            error = error[np.isfinite(error)]
            cells.append(f"{error.mean():+.5f} / {error.std():.5f}")
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return lines


def chain(size: int, device: Device) -> list[str]:
    """Rigid shifts through a lens: PSF of 0.7 px, 8 bit."""
    lens = Lens(psf=psf.Gaussian(0.7))
    sensor = gs.Sensor(8, 1.0)
    lines = [
        f"Shifts of 0 to 1 px in steps of 0.05, Gaussian PSF of 0.7 px, {size} x {size} px, "
        "8 bit, 31 px subsets",
        "",
        "| speckle | worst bias px | largest standard deviation px |",
        "|---|---|---|",
    ]
    for name, softness in (("5 px, hard edges", 0.0), ("5 px, edges 0.4 px soft", 0.4)):
        paint = gs.paint.Speckle(5.0, 0.5, softness, seed=2, ground=0.95)
        found = []
        reference = None
        for shift in 0.05 * np.arange(21):
            surface, camera = plate(paint, size, size, (shift, 0.0))
            image = sensor.expose(photograph([surface], camera, lens=lens, device=device))
            reference = image if reference is None else reference
            edge = size - 9
            got = gs.measure.dic(
                reference, image, subset=31, step=11, search_px=3, roi=(8, 8, edge, edge),
                device=device,
            )  # fmt: skip
            error = got.displacement[:, 0] - shift
            error = error[np.isfinite(error)]
            found.append((abs(error.mean()), error.std()))
        bias, deviation = np.max(found, axis=0)
        lines.append(f"| {name} | {bias:.5f} | {deviation:.5f} |")
    return lines


def size_and_coverage(device: Device) -> list[str]:
    """What the pictures show of what was asked for: mean albedo, and the covariance's diameter."""
    lines = [
        f"Requested and measured, one picture of {FRAME[0]} x {FRAME[1]} px",
        "",
        "| diameter px | coverage | diameter found | coverage found |",
        "|---|---|---|---|",
    ]
    for diameter, coverage in ((5.0, 0.5), (8.0, 0.35)):
        paint = gs.paint.Speckle(diameter, coverage, seed=3, dot=0.0, ground=1.0)
        surface, camera = plate(paint, *FRAME, (0.0, 0.0))
        # a share of the pixel is covered: half of it decides what is paint
        radiance = gs.render([surface], camera, device=device).radiance
        cover = radiance < 0.5
        found = float(1.0 - radiance.mean())
        lags = np.arange(1, 4 * int(diameter))
        span = FRAME[0] - len(lags) - 1
        measured = np.array(
            [(cover[:, :span] & cover[:, k : k + span]).mean(dtype=float) for k in lags]
        )
        share = float(cover.mean())

        def misfit(d: float, measured=measured, lags=lags, share=share) -> float:
            h = np.minimum(lags / d, 1.0)
            shared = 2.0 / np.pi * (np.arccos(h) - h * np.sqrt(1.0 - h * h))
            model = 2.0 * share - 1.0 + (1.0 - share) ** (2.0 - shared)
            return float(np.sum((measured - model) ** 2))

        fitted = minimize_scalar(misfit, (0.5 * diameter, diameter, 2.0 * diameter)).x
        lines.append(f"| {diameter:g} | {coverage:g} | {fitted:.3f} | {found:.4f} |")
    return lines


def timing(device: Device, repeats: int) -> list[str]:
    """Seconds a frame of the full plate, patterns and peers in turn."""
    texture = picture((0.0, 0.0), (FRAME[0] + 80, FRAME[1] + 80), device)
    paints = {
        "plain": gs.paint.Plain(0.5),
        "speckle, soft": PAINT,
        "speckle, hard": gs.paint.Speckle(6.0, 0.5, seed=1),
        "checker": gs.paint.Checker(11.3),
        "dots": gs.paint.Dots(6.0, 9.1),
        "bitmap": gs.paint.Image(texture, 1.0),
    }
    pixels = FRAME[0] * FRAME[1]
    lines = [
        f"Plate {FRAME[0]} x {FRAME[1]} px, unlit; warm: least of {repeats} frames; processor: "
        "its time over all threads",
        "",
        "| | cold s | warm s | ns/px | processor ns/px |",
        "|---|---|---|---|---|",
    ]
    for name, paint in paints.items():
        wall, busy = [], []
        for k in range(repeats + 1):
            surface, camera = plate(paint, *FRAME, (0.01 * k, 0.0))
            device.sync()
            start, used = time.perf_counter(), time.process_time()
            frame = gs.render([surface], camera, device=device)
            device.sync()
            wall.append(time.perf_counter() - start)
            busy.append(time.process_time() - used)
            frame.release()
        warm = min(wall[1:])
        lines.append(
            f"| gpusim, {name} | {wall[0]:.2f} | {warm:.3f} | {1e9 * warm / pixels:.0f} "
            f"| {1e9 * min(busy[1:]) / pixels:.0f} |"
        )
    runs = [("cubic_catmull_rom", 2), ("cubic_catmull_rom", 4), ("quintic_bspline", 4)]
    with tempfile.TemporaryDirectory() as folder:
        got = riley(
            Path(folder), texture[40:-40, 40:-40], width=FRAME[0], height=FRAME[1],
            moves=[[0.01, 0.0]], runs=runs, repeats=repeats, keep=False,
        )  # fmt: skip
    if isinstance(got, str):
        return [*lines, "", f"riley: {got}"]
    for (sample, side), seconds in zip(runs, got, strict=True):
        lines.append(
            f"| riley, {sample}, {side**2} samples | | {seconds:.3f} | {1e9 * seconds / pixels:.0f}"
            " | |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=800, help="of the accuracy test, px")
    parser.add_argument("--step", type=int, default=20, help="between its points, px")
    parser.add_argument("--repeats", type=int, default=5, help="warm frames")
    parser.add_argument("--write", action="store_true", help=f"also write {RESULTS.name}")
    arguments = parser.parse_args()
    device = Device()
    lines = ["# Speckle plate", "", device.name, ""]
    for part in (
        timing(device, arguments.repeats),
        accuracy(arguments.size, arguments.step, device),
        chain(arguments.size // 4 + 20, device),
        size_and_coverage(device),
    ):
        print("\n".join(part), flush=True)
        print()
        lines += [*part, ""]
    if arguments.write:
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
