"""Image correlation against peers: ``python -m benchmarks.correlation [--write]``.

In one run gpusim and, where installed, pyvale's compiled DIC and al-dic's local mode
(`benchmarks/peers`) correlate exact pairs of pictures (plane waves, affinely moved, with noise, 8
bit) and the star pattern of the DIC Challenge that comes with pyvale, which moves by 0.5 px along
its middle line; there without the check for tears, so that all codes are judged by the same
points; and stars of our own that move on by a part of a pixel, too. OpenCorr isn't in the package
registries. Then, gpusim alone: a bracket before a
plain background (rendered; whole picture and region of interest), a series of ten frames, a torn
picture.

Times are the least of several; processor seconds count all threads, so that a busy machine
distorts them less than wall time. `GPUSIM_PEERS_PYTHON` names the peers' interpreter.

What a processor has to do: a subset of n pixels costs 2 n + i n visits, i iterations (2 on a good
start). A visit of an iteration is some 250 operations of eight lanes in 4.3 ns a pixel, one of the
setup 1.5 ns; 16,384 subsets of 21 px so take 0.1 s of a processor, half of that on two. All else is
start values, neighbours and checks. Fronts don't lie side by side: what a subset reads comes from
farther than the first caches, and takes 0.17 s.

Of pyvale's star our error is the larger one, and stays so: it moves by exactly half a pixel.
Noise of an image read between its pixels is weakest there, so that the minimum of the residual,
which pyvale looks for (it weighs what is left by the deformed image's slopes), is drawn there, too;
weighed by the reference's slopes it isn't. Stars that move on by another quarter or half of a pixel
tell (`moved_star`): of waves that a subset can follow pyvale's error is the larger one there, the
more so the more noise, and ours is the same as before.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import gpusim as gs
from gpusim.gpu import Device
from gpusim.measure import dic, dic_sequence
from tests.support.measure_images import Waves

RESULTS = Path(__file__).parent / "results" / "correlation.md"
PEERS = Path(__file__).resolve().parent / "peers"
MOTION: dict[str, Any] = {
    "search_px": 16,
    "gradient": [[0.004, 0.002], [-0.003, 0.001]],
    "shift": [0.37, -0.21],
    "margin": 30,
}
CASES = (
    MOTION | {"side": 1000, "subset": 31, "step": 10, "noise": 2.0},
    MOTION | {"side": 1044, "subset": 21, "step": 8, "noise": 1.0},
)
STAR: dict[str, Any] = {
    "star": True,
    "peak": 0.5,
    "apart_px": np.inf,
    "subset": 17,
    "step": 1,
    "search_px": 10,
    "margin": 50,
    "noise": 0.0,
}
# px: its width, and the shortest and longest of its waves
STAR_SIZE, STAR_WAVES = (2000, 201), (10.0, 300.0)
HEAD = (
    "| code | stop at | points | wall s | points/s | processor s | points per processor s | "
    "RMS error px |"
)
PLATE = np.array(
    [
        [150.0, 100],
        [450, 100],
        [450, 480],
        [1050, 480],
        [1050, 700],
        [150, 700],
        [150, 480],
        [450, 700],
    ]
)
PLATE_FACES = np.array([[0, 6, 2, 1], [6, 5, 7, 2], [2, 7, 4, 3]])


def pictures(meta: dict[str, Any], motion: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """(side, side) uint8, before and after."""
    side = meta["side"]
    centre = (side - 1) / 2
    gradient, shift = motion * np.array(meta["gradient"]), motion * np.array(meta["shift"])
    waves, rng = Waves(seed=4, number=100), np.random.default_rng(9)
    y, x = np.indices((side, side), dtype=np.float64)
    place = np.stack([x - centre - shift[0], y - centre - shift[1]])
    back = np.einsum("ij,jrc->irc", np.linalg.inv(np.eye(2) + gradient), place) + centre
    images = [waves.at(x, y), waves.at(*back)]
    noisy = [image + meta["noise"] * rng.normal(size=image.shape) for image in images]
    before, after = (np.clip(np.rint(i), 0, 255).astype(np.uint8) for i in noisy)
    return before, after


def moved_star(offset: float, noise: float) -> list[np.ndarray]:
    """Up and down by 0.5 px in waves that become longer to the right, and by ``offset``, px."""
    (width, height), (first, last) = STAR_SIZE, STAR_WAVES
    y, x = np.indices((height, width), dtype=np.float64)
    number = 2.0 * np.pi / (first * (last / first) ** (x / (width - 1)))
    before = y.copy()
    for _ in range(80):
        before = y - offset - 0.5 * np.cos(number * (before - height // 2))
    waves, rng = Waves(seed=4, number=100), np.random.default_rng(5)
    images = [
        image + noise * rng.normal(size=x.shape) for image in (waves.at(x, y), waves.at(x, before))
    ]
    return [np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in images]


def bracket(device: Device) -> list[np.ndarray]:
    """An L of speckle before a plain grey, 1200 x 800 px, with noise; before and after."""
    width, height, far = 1200, 800, 4000.0
    flat = PLATE - [(width - 1) / 2, (height - 1) / 2]
    rest = np.column_stack([flat, np.full(len(flat), far)])
    frame = gs.PaintFrame(np.array([-600.0, -400.0, far]), np.eye(3)[0], np.eye(3)[1])
    paint = gs.paint.Speckle(6.0, 0.5, 1.5, seed=1, dot=0.05, ground=0.9)
    camera = gs.Camera(
        width,
        height,
        np.array([[far, 0, (width - 1) / 2], [0, far, (height - 1) / 2], [0, 0, 1.0]]),
    )
    sensor = gs.Sensor(8, 1.0, full_well=10_000.0, read_noise=20.0)
    turn = np.array([[1.001, -0.002], [0.002, 1.001]])
    images = []
    for seed, matrix, shift in ((1, np.eye(2), [0.0, 0.0]), (2, turn, [0.37, -0.61])):
        points = rest.copy()
        points[:, :2] = flat @ matrix.T + shift
        surface = gs.Surface(
            points, PLATE_FACES, {"plate": paint}, reference=rest, frames={"plate": frame}
        )
        rendered = gs.render([surface], camera, background=0.4, device=device)
        images.append(sensor.expose(rendered, seed=seed))
    return images


def timed(work: Callable[[], Any], repeats: int) -> tuple[dict[str, Any], Any]:
    """Least wall and processor seconds of several, after one that compiles, and the result."""
    best: dict[str, Any] = {}
    for turn in range(repeats + 1):
        wall, cpu = time.perf_counter(), time.process_time()
        result = work()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        if turn and (not best or cpu < best["cpu"]):
            best = {"wall": wall, "cpu": cpu}
    return best, result


def ours(
    images: list[np.ndarray], meta: dict[str, Any], tolerance: float, repeats: int
) -> dict[str, Any]:
    """Seconds and error on the default device."""
    device, roi, margin = Device(), None, meta["margin"]
    middle = (np.array(images[0].shape[::-1]) - 1) / 2
    if "star" in meta:
        roi = star_roi(images[0], meta)
    best, result = timed(
        lambda: dic(
            *images, subset=meta["subset"], step=meta["step"], search_px=meta["search_px"],
            tolerance=tolerance, device=device, roi=roi, apart_px=meta.get("apart_px", 0.1),
            shape=meta.get("shape", "affine"),
        ),
        repeats,
    )  # fmt: skip
    points = result.points
    if "star" in meta:
        error = result.displacement[result.ok, 1] - meta["peak"]
    else:
        inner = ((points >= margin) & (points <= 2 * middle - margin)).all(axis=1) & result.ok
        truth = (points - middle) @ np.array(meta["gradient"]).T + meta["shift"]
        error = (result.displacement - truth)[inner]
    return best | {"points": len(points), "rms": float(np.sqrt((error**2).mean()))}


def star_roi(image: np.ndarray, meta: dict[str, Any]) -> tuple[int, int, int, int]:
    """The middle line of the star pattern, as in pyvale's example."""
    half, row, width = meta["subset"] // 2, image.shape[0] // 2, image.shape[1]
    left = meta.get("left", meta["margin"])
    return left, row - half, width - 1 - meta["margin"], row + half


def peer(
    script: str, images: list[np.ndarray], meta: dict[str, Any], precision: float, repeats: int
) -> dict[str, Any]:
    """The same of a peer, or why not."""
    python = os.environ.get("GPUSIM_PEERS_PYTHON", str(PEERS / ".venv" / "bin" / "python"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for stem, image in zip(("reference", "deformed"), images, strict=True):
            np.save(folder / f"{stem}.npy", image)
        centre = [(n - 1) / 2 for n in images[0].shape[::-1]]
        more = {"centre": centre, "precision": precision, "repeats": repeats}
        if "star" in meta:
            more["box"] = star_roi(images[0], meta)
        (folder / "meta.json").write_text(json.dumps(meta | more))
        return answer([python, str(PEERS / script), name])


def answer(command: list[str]) -> dict[str, Any]:
    """What a peer prints on its last line, or why it doesn't."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        return {"missing": str(error)}
    if done.returncode:
        return {"missing": (done.stderr.strip().splitlines() or ["failed"])[-1]}
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def compared(
    title: str,
    images: list[np.ndarray],
    meta: dict[str, Any],
    limits: tuple[float, ...],
    repeats: int,
) -> list[str]:
    """A table of all codes on one pair; al-dic has a stopping rule of its own."""
    lines = [f"{title}, subset {meta['subset']} px, step {meta['step']} px, affine", "", HEAD]
    lines.append("|---" * 8 + "|")
    runs: list[tuple[str, str, dict[str, Any]]] = []
    for limit in limits:
        runs.append(("gpusim", f"{limit:g} px", ours(images, meta, limit, repeats)))
        runs.append(
            ("pyvale", f"{limit:g} px", peer("pyvale_dic.py", images, meta, limit, repeats))
        )
    if "star" not in meta and meta["step"] & (meta["step"] - 1) == 0:
        runs.append(("al-dic, local", "0.01", peer("al_dic_local.py", images, meta, 0.01, repeats)))
    for name, stop, found in runs:
        if "missing" in found:
            lines.append(f"| {name} | {stop} | {found['missing']} ||||||")
            continue
        count, wall, cpu = found["points"], found["wall"], found["cpu"]
        lines.append(
            f"| {name} | {stop} | {count} | {wall:.2f} | {count / wall:.0f} | "
            f"{cpu:.2f} | {count / cpu:.0f} | {found['rms']:.5f} |"
        )
    print(*lines, "", sep="\n", flush=True)
    return [*lines, ""]


def alone(repeats: int) -> list[str]:
    """What parts of a picture, series and tears cost, gpusim alone."""
    device = Device()
    settings: dict[str, Any] = {"subset": 21, "step": 8, "device": device}
    first, second = bracket(device)
    mask = np.zeros(first.shape, dtype=bool)
    mask[100:700, 150:450] = mask[480:700, 150:1050] = True
    before, after = pictures(CASES[1])
    series = [pictures(CASES[1], motion)[1] for motion in np.linspace(0.3, 3.0, 10)]
    torn = after.copy()
    torn[522:] = np.roll(after[522:], 1, axis=1)
    runs: list[tuple[str, Callable[[], Any]]] = [
        ("bracket, region of interest (a mask)", lambda: dic(first, second, mask=mask, **settings)),
        ("bracket, whole picture", lambda: dic(first, second, **settings)),
        ("1044 x 1044 px", lambda: dic(before, after, **settings)),
        ("the same without the check for tears",
         lambda: dic(before, after, apart_px=np.inf, **settings)),
        ("the same torn across by 1 px", lambda: dic(before, torn, **settings)),
        ("torn, without the check", lambda: dic(before, torn, apart_px=np.inf, **settings)),
        ("ten frames one by one", lambda: [dic(before, image, **settings) for image in series]),
        ("ten frames as a series", lambda: dic_sequence(before, series, **settings)),
    ]  # fmt: skip
    lines = [
        "gpusim alone, subset 21 px, step 8 px",
        "",
        "| | wall s | processor s |",
        "|---|---|---|",
    ]
    for title, work in runs:
        best, _ = timed(work, repeats)
        lines.append(f"| {title} | {best['wall']:.2f} | {best['cpu']:.2f} |")
    print(*lines, sep="\n", flush=True)
    return lines


def main() -> None:
    """Print the tables; with --write, keep them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--repeats", type=int, default=4)
    choice = parser.parse_args()
    lines: list[str] = []
    for meta in CASES:
        title = f"{meta['side']} x {meta['side']} px, 8 bit, noise {meta['noise']:g} grey levels"
        lines += compared(title, list(pictures(meta)), meta, (1e-3, 1e-4), choice.repeats)
    star = peer_star()
    if isinstance(star, str):
        lines += [f"Star pattern: {star}", ""]
    else:
        lines += compared(
            "Star pattern of pyvale, middle line", star, STAR, (1e-3,), choice.repeats
        )
    lines += stars(1) + alone(choice.repeats)
    text = "\n".join(lines) + "\n"
    if choice.write:
        RESULTS.write_text(f"# Image correlation: time and error\n\n{text}")


def stars(repeats: int) -> list[str]:
    """RMS errors of stars that move on, with and without noise, by both shape functions."""
    lines = [
        "Stars of our own, subset 17 px: RMS error px along the middle line where waves are longer "
        "than 55 px, gpusim / pyvale",
        "",
        "| noise | shape | moved 0.5 px there | 0.75 px | 1 px |",
        "|---|---|---|---|---|",
    ]
    for noise in (0.0, 4.0, 8.0):
        for shape in ("affine", "quadratic"):
            cells = []
            for offset in (0.0, 0.25, 0.5):
                meta = STAR | {"shape": shape, "peak": 0.5 + offset, "margin": 20, "left": 1000}
                images = moved_star(offset, noise)
                own = ours(images, meta, 1e-4, repeats)
                other = peer("pyvale_dic.py", images, meta, 1e-4, repeats)
                cells.append(f"{own['rms']:.4f} / {other.get('rms', np.nan):.4f}")
            lines.append(f"| {noise:g} | {shape} | {' | '.join(cells)} |")
    print(*lines, "", sep="\n", flush=True)
    return [*lines, ""]


def peer_star() -> list[np.ndarray] | str:
    """The pictures that come with pyvale, or why there are none."""
    python = os.environ.get("GPUSIM_PEERS_PYTHON", str(PEERS / ".venv" / "bin" / "python"))
    code = (
        "import json; from pyvale import data; "
        "print(json.dumps([str(data.dic_chal_2d_ref()), str(data.dic_chal_2d_def())]))"
    )
    found: Any = answer([python, "-c", code])
    if "missing" in found:
        return str(found["missing"])
    return [gs.export.read_image(path) for path in found]


if __name__ == "__main__":
    main()
