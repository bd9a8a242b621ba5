"""What `scripts/gpu_check.py` measures, one part per process: kernels, solver, images, correlation.

Each part prints lines ``RESULT {json}`` as soon as it knows them, so that what a driver kills or
hangs later is not lost.
"""

from __future__ import annotations

import inspect
import json
import os
import platform
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import gpusim as gs
from benchmarks.gpu_cases import IMAGES
from benchmarks.render.cases import IMAGE_CASES
from benchmarks.solver.cases import CASES
from gpusim.bench.image_cases import ImageCase
from gpusim.bench.solver_cases import STEEL, Case
from gpusim.errors import GpusimError
from gpusim.gpu import Device, default_device, twin_checks
from gpusim.gpu.adapter import is_processor
from gpusim.mesh import bracket, quadratic, split

REFERENCE = Path(__file__).parent / "results" / "gpu_check_reference.npz"
PICTURES = ("crane-lit", "speckle", "faces")
_WARM = 3
_GRID = 16, 24  # blocks of an image whose means are compared
_CROP = 40  # px of the squares that are compared pixel by pixel


def tell(**values: Any) -> None:
    """One line for the process that waits; NaN and infinity become null."""
    plain = {
        k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in values.items()
    }
    print("RESULT " + json.dumps(plain), flush=True)


def adapter() -> None:
    """What runs here."""
    device = default_device()
    info = {key: str(value) for key, value in device.info.items()}
    tell(
        name=device.name, software=is_processor(device.info), info=info, real=device.real,
        features=sorted(device.adapter.features), timestamps=device.timer.enabled,
        limits={key: int(value) for key, value in sorted(device.limits.items())},
        gpusim=gs.__version__, python=platform.python_version(), numpy=np.__version__,
        system=platform.platform(), processor=_processor(), cores=os.cpu_count(),
    )  # fmt: skip


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()


def doctor(real: str, done: list[str]) -> None:
    """Every twin check but those ``done``, with 64-bit floats on the device or without."""
    device = Device(real=real)
    for stage, check in twin_checks().items():
        if stage in done:
            continue
        tell(stage=stage, verdict="began")
        start = time.perf_counter()
        try:
            check(device)
            verdict, message = "ok", ""
        except Exception as error:  # the others still count
            verdict, message = "wrong", f"{type(error).__name__}: {error}"
        tell(stage=stage, verdict=verdict, message=message, seconds=time.perf_counter() - start)
        if verdict != "ok":
            device = Device(real=real)  # what one broke mustn't count against the next


def _tet_bracket(around: int, radial: int, through: int, bend: int) -> gs.Mesh:
    size = {"around": around, "radial": radial, "through": through, "bend": bend}
    bricks = bracket(
        base_length=60.0, wall_height=80.0, width=40.0, thickness=5.0, fillet_radius=6.0,
        hole_diameter=12.0, **size,
    )  # fmt: skip
    return quadratic(split(bricks, "tet4"))


def _bracket(name: str, divisions: tuple[int, int, int, int]) -> Case:
    return Case(name, "bracket", "full", "tet10", "full", STEEL,
                partial(_tet_bracket, *divisions), (0.0, 20.0, -50.0))  # fmt: skip


_BRACKETS = (
    _bracket("bracket-660k", (72, 20, 7, 20)),
    _bracket("bracket-53k", (32, 8, 3, 8)),
)


def solver(name: str) -> None:
    """One case with multigrid forced onto the host, then onto the device."""
    case = next(one for one in (*_BRACKETS, *CASES) if one.name == name)
    model = case.model()
    rule = {case.kind: case.rule}
    host = _solved(model, rule, "numpy", 1e-6)
    exact = gs.solve(model, tolerance=1e-9, formulation=rule, backend="numpy", method="multigrid",
                     start=host.u)  # fmt: skip
    _tell_solved(case, "host", host, exact)
    device = default_device()
    for turn in ("device, first", "device"):
        before = device.timer.seconds()
        found = _solved(model, rule, "gpu", 1e-6)
        after = device.timer.seconds()
        _tell_solved(case, turn, found, exact, device=_spent(before, after))


def _solved(model: gs.Model, rule: dict[str, str], backend: str, tolerance: float) -> gs.Solution:
    return gs.solve(
        model, tolerance=tolerance, formulation=rule, backend=backend, method="multigrid"
    )


def _tell_solved(
    case: Case, where: str, found: gs.Solution, exact: gs.Solution, **more: Any
) -> None:
    error = float(np.abs(found.u - exact.u).max() / np.abs(exact.u).max())
    tell(
        case=case.name, where=where, unknowns=found.unknowns, iterations=found.iterations,
        converged=found.converged, error=error, stated=float(found.error_estimate),
        seconds=sum(found.timings.values()), timings=dict(found.timings),
        path=f"{found.method}, {found.backend}, {found.real}", **more,
    )  # fmt: skip


def _spent(before: dict[str, float], after: dict[str, float]) -> dict[str, float]:
    """Device seconds per stage between two readings of the timer."""
    spent = {stage: after[stage] - before.get(stage, 0.0) for stage in after}
    return {stage: seconds for stage, seconds in spent.items() if seconds > 0.0}


def image_case(name: str, scale: str) -> ImageCase:
    """The scene of an image; ``scale`` "full" or "quick"."""
    if not name.startswith("faces"):
        return IMAGE_CASES[name]("full" if scale == "full" else "standard")
    count = "3e5" if "300k" in name else "1e5"
    case = IMAGE_CASES[f"sheet-{count}"]("full" if scale == "full" else "small")
    lamp = gs.PointLight((-1.0, -2.0, 1.0), 50.0)
    return replace(case, name=name, lights=(lamp,))  # type: ignore[arg-type]


def image(name: str, scale: str, folder: Path) -> None:
    """One image: first and warm, on the host's clock and the device's, against the stored one."""
    case, device = image_case(name, scale), default_device()
    lights = list(case.lights) or None

    def drawn() -> tuple[float, gs.Frame]:
        start = time.perf_counter()
        frame = gs.render(case.surfaces, case.camera, lights, device=device)
        device.sync()
        return time.perf_counter() - start, frame

    first, frame = drawn()
    frame.release()
    warm, on_device = [], []
    for _ in range(_WARM):
        frame.release()
        before = device.timer.seconds()
        seconds, frame = drawn()
        warm.append(seconds)
        on_device.append(_spent(before, device.timer.seconds()))
    start = time.perf_counter()
    picture = frame.radiance
    read = time.perf_counter() - start
    best = int(np.argmin(warm))
    known = device.timer.enabled
    mean, most = difference(case, f"{name}-{scale}", picture)
    tell(
        case=name, width=case.camera.width, height=case.camera.height,
        triangles=len(case.soup.albedo), first=first, warm=warm[best], read=read,
        device=sum(on_device[best].values()) if known else None, stages=on_device[best],
        mean_difference=mean, most_difference=most,
    )  # fmt: skip
    if name.startswith(PICTURES):
        tell(picture=str(_write(picture, folder / f"{name}.png")))


def samples(case: ImageCase, picture: np.ndarray) -> dict[str, np.ndarray]:
    """What is kept of an image: means of blocks, and squares around its targets."""
    rows, columns = (np.linspace(0, n, k + 1).astype(int)[:-1]
                     for n, k in zip(picture.shape, _GRID, strict=True))  # fmt: skip
    total = np.add.reduceat(np.add.reduceat(picture.astype(np.float64), rows, 0), columns, 1)
    sizes = np.outer(np.diff([*rows, picture.shape[0]]), np.diff([*columns, picture.shape[1]]))
    squares = []
    for r0, r1, c0, c1 in case.windows[:3]:
        r, c = (r0 + r1 - _CROP) // 2, (c0 + c1 - _CROP) // 2
        squares.append(picture[r : r + _CROP, c : c + _CROP])
    return {"blocks": total / sizes, "squares": np.stack(squares)}


def difference(case: ImageCase, name: str, picture: np.ndarray) -> tuple[float, float]:
    """Largest difference of a block's mean and of a pixel of the squares, over the image's white;
    NaN where nothing is stored."""
    with np.load(REFERENCE) as stored:
        if f"{name}-blocks" not in stored:
            return float("nan"), float("nan")
        wanted = {key: stored[f"{name}-{key}"].astype(np.float64) for key in ("blocks", "squares")}
    got, white = samples(case, picture), wanted["squares"].max()
    blocks, squares = (np.abs(got[key] - wanted[key]).max() / white for key in wanted)
    return float(blocks), float(squares)


def _write(picture: np.ndarray, path: Path) -> Path:
    """An image as a PNG of at most about 1400 px, grey values with gamma 2.2."""
    import cv2

    step = max(1, picture.shape[1] // 1400)
    rows, columns = (n // step * step for n in picture.shape)
    small = picture[:rows, :columns].reshape(rows // step, step, columns // step, step).mean((1, 3))
    grey = np.clip(small / np.percentile(small, 99.8), 0.0, 1.0) ** (1 / 2.2)
    cv2.imwrite(str(path), np.rint(255.0 * grey).astype(np.uint8))
    return path


def write_reference() -> None:
    """Store what images are compared with, as this machine renders them."""
    kept = {}
    for scale, names in IMAGES.items():
        for name in names:
            case = image_case(name, scale)
            frame = gs.render(case.surfaces, case.camera, list(case.lights) or None)
            for key, values in samples(case, frame.radiance).items():
                kept[f"{name}-{scale}-{key}"] = values.astype(np.float32)
            frame.release()
            print(name, scale, flush=True)
    np.savez_compressed(REFERENCE, **kept)


def correlation(scale: str) -> None:
    """20,000 subsets of an exact pair of pictures, on the device and on the host."""
    from benchmarks.correlation import META, pictures

    side, step = (1044, 7) if scale == "full" else (544, 7)
    before, after = pictures(side)
    centre = (side - 1) / 2
    for where in ("device", "host"):
        best = first = float("inf")
        for turn in range(2 if where == "device" else 1):
            start = time.perf_counter()
            result = gs.measure.dic(before, after, subset=21, step=step, **_on(where))
            seconds = time.perf_counter() - start
            first, best = (seconds if turn == 0 else first), min(best, seconds)
        truth = (result.points - centre) @ np.array(META["gradient"]).T + META["shift"]
        off = (result.displacement - truth)[result.ok]
        tell(
            case=f"{side} x {side} px, subset 21, step {step}", where=where, first=first,
            warm=best, subsets=len(result.points), measured=int(result.ok.sum()),
            rms=float(np.sqrt((off**2).mean())),
        )  # fmt: skip


def _on(where: str) -> dict[str, Any]:
    """Arguments that choose the device, or the host."""
    if "backend" in inspect.signature(gs.measure.dic).parameters:
        return {"backend": "gpu" if where == "device" else "numpy"}
    return {"device": default_device() if where == "device" else None}


def run(part: str, options: dict[str, Any]) -> int:
    """Do one part; 0 if it came to its end."""
    kind, _, name = part.partition(":")
    scale, folder = options["scale"], Path(options["folder"])
    parts: dict[str, Callable[[], None]] = {
        "adapter": adapter,
        "doctor": lambda: doctor(name, options.get("done", [])),
        "fe": lambda: solver(name),
        "image": lambda: image(name, scale, folder),
        "dic": lambda: correlation(scale),
    }
    try:
        parts[kind]()
    except GpusimError as error:
        tell(failed=f"{type(error).__name__}: {error}")
        return 1
    return 0
