"""The render benchmark: run time against error of the image, beside other renderers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim._version import __version__
from gpusim.bench.images import IMAGE_CASES, ImageCase, lamp_sides
from gpusim.bench.peers import peer_folder
from gpusim.bench.supersample import compare, disc_texture, reference_windows
from gpusim.gpu import Device, default_device
from gpusim.optics import render

__all__ = ["IMAGE_PEERS", "ImagePeer", "ImagePoint", "RenderResult", "run_render_bench"]

Array = npt.NDArray[np.float64]
Tell = Callable[[str], None]
CONVERGED = 1024
_LIMIT_S = 1800.0
_WARM = 4


@dataclass(frozen=True)
class ImagePeer:
    """A script of ``benchmarks/peers``; ``python`` names the variable with its interpreter."""

    name: str
    script: str
    samples: tuple[int, ...]
    lit: bool
    unlit: bool
    python: str = "GPUSIM_PEERS_PYTHON"
    most_samples: float = 4e8
    """Pixels times samples that are tried."""
    most_asked: float = 0.0
    """The same where the peer is asked for by its name, if that is more."""

    def asked(self) -> ImagePeer:
        """The peer with as many samples as whoever asks for it waits for."""
        return replace(self, most_samples=max(self.most_samples, self.most_asked))


IMAGE_PEERS = (
    ImagePeer("riley", "riley_raster.py", (1, 4, 16, 64, 256), False, True, most_samples=1e9),
    ImagePeer("Mitsuba", "mitsuba3.py", (4, 16, 64), True, True),
    ImagePeer("VTK", "vtk_gl.py", (1, 8), False, True, most_samples=1e9),
    ImagePeer("Cycles", "blender_cycles.py", (4, 16), True, True, "GPUSIM_BPY_PYTHON", 5e7, 1e8),
)


@dataclass(frozen=True)
class ImagePoint:
    """One renderer at one setting: warm seconds of a frame and what the image is off by."""

    renderer: str
    seconds: float
    rms: float
    shift_rms: float
    bias: float


@dataclass
class ImageResult:
    case: str
    width: int
    height: int
    triangles: int
    lit: bool
    points: list[ImagePoint] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def own(self) -> ImagePoint | None:
        return next((p for p in self.points if p.renderer == "gpusim"), None)


@dataclass
class RenderResult:
    """Everything measured, for `gpusim.bench.render_tables`."""

    machine: str
    cases: list[ImageResult] = field(default_factory=list)


def run_render_bench(
    names: Sequence[str],
    size: str,
    work: Path,
    *,
    peers: Sequence[ImagePeer] = IMAGE_PEERS,
    tell: Tell = print,
    save: Callable[[RenderResult], object] = lambda result: None,
) -> RenderResult:
    """Render every case; ``work`` keeps references and the peers' arrays.

    Unlit references are float64 samples of the triangles and discs themselves; lit ones are
    Mitsuba's windows at 1024 samples, and without it lit cases have times only.
    """
    device = default_device()
    machine = f"gpusim {__version__}, {device.name}, {os.cpu_count()} cores"
    result = RenderResult(machine)
    for name in names:
        case = IMAGE_CASES[name](size)
        result.cases.append(_run_case(case, work / f"{name}-{size}", peers, device, tell))
        save(result)
    return result


def _run_case(
    case: ImageCase, folder: Path, peers: Sequence[ImagePeer], device: Device, tell: Tell
) -> ImageResult:
    camera, lit = case.camera, bool(case.lights)
    found = ImageResult(case.name, camera.width, camera.height, len(case.soup.albedo), lit)
    folder.mkdir(parents=True, exist_ok=True)
    scripts = peer_folder() if peers else None
    _write_problem(case, folder)
    wanted = _reference(case, folder, scripts, found, tell)
    white = max(float(part.max()) for part in wanted) if wanted and lit else 1.0

    def enter(name: str, seconds: float, windows: list[Array]) -> None:
        off = compare(windows, wanted, white) if wanted else None
        numbers = (off.rms, off.shift_rms, off.bias) if off else (np.nan,) * 3
        point = ImagePoint(name, seconds, *numbers)
        found.points.append(point)
        tell(f"{case.name}: {describe(point)}")

    enter("gpusim", *_own(case, device))
    for peer in peers:
        if scripts is None or not (peer.lit if lit else peer.unlit):
            continue
        samples = [n for n in peer.samples if n * case.pixels <= peer.most_samples]
        for variant in run_image_peer(peer, scripts, folder, samples) if samples else ():
            if "failed" in variant:
                found.failures.append(f"{peer.name}: {variant['failed']}")
                tell(f"{case.name}: {found.failures[-1]}")
                continue
            enter(variant["name"], variant["seconds"], _load(Path(variant["windows"])))
    return found


def _own(case: ImageCase, device: Device) -> tuple[float, list[Array]]:
    """Seconds of a warm frame until it lies on the device, and the windows of its image."""
    lights = list(case.lights) or None
    seconds = []
    for _ in range(1 + _WARM):
        start = time.perf_counter()
        frame = render(case.surfaces, case.camera, lights, device=device)
        device.sync()
        seconds.append(time.perf_counter() - start)
        if len(seconds) <= _WARM:
            frame.release()
    image = frame.radiance
    frame.release()
    return min(seconds[1:]), [
        image[r0:r1, c0:c1].astype(np.float64) for r0, r1, c0, c1 in case.windows
    ]


def _reference(
    case: ImageCase, folder: Path, scripts: Path | None, found: ImageResult, tell: Tell
) -> list[Array]:
    path = folder / "reference.npz"
    if path.is_file():
        return _load(path)
    tell(f"{case.name}: reference")
    if not case.lights:
        windows = reference_windows(case)
    else:
        mitsuba = next(peer for peer in IMAGE_PEERS if peer.name == "Mitsuba")
        if scripts is None:
            found.failures.append(
                "no error is told: the reference of lit images is Mitsuba's, which is run from a "
                "checkout only"
            )
            return []
        (made,) = run_image_peer(mitsuba, scripts, folder, [CONVERGED], "windows-")
        if "failed" in made:
            found.failures.append(f"no reference: {made['failed']}")
            return []
        windows = _load(Path(made["windows"]))
    np.savez(path, *windows)
    return windows


def _load(path: Path) -> list[Array]:
    with np.load(path) as stored:
        return [stored[name] for name in stored.files]


def _write_problem(case: ImageCase, folder: Path) -> None:
    """The scene as the peers read it: see ``benchmarks/peers/pictures.py``."""
    camera = case.camera
    R = camera.camera_from_world[:3, :3]
    arrays: dict[str, npt.NDArray[Any]] = {
        "corners": camera.to_camera(case.soup.corners),
        "albedo": np.asarray(case.soup.albedo),
        "windows": np.array(case.windows),
        "lamps": np.zeros((0, 3, 3)),
        "radiance": np.zeros(0),
    }
    if case.lights:
        lamps, radiance = [], []
        for lamp in case.lights:
            centre, a, b = lamp_sides(lamp)
            lamps.append(np.stack([camera.to_camera(centre), R @ a, R @ b]))
            radiance.append(lamp.power / (4.0 * np.pi * np.linalg.norm(np.cross(a, b))))
        arrays |= {"lamps": np.stack(lamps), "radiance": np.array(radiance)}
    if case.texture is not None:
        plate = case.texture
        relative = case.soup.corners - plate.origin
        st = np.stack([relative @ plate.s_axis, relative @ plate.t_axis], axis=-1)
        arrays["uv"] = st / np.array(plate.size)
        pixel = float(np.linalg.norm(plate.origin - camera.eye)) / camera.K[0, 0]
        arrays["texture"] = disc_texture(plate, 0.5 * pixel)
    np.savez(folder / "problem.npz", allow_pickle=False, **arrays)
    facts = {"width": camera.width, "height": camera.height, "focal": camera.K[0, 0],
             "lit": bool(case.lights)}  # fmt: skip
    (folder / "problem.json").write_text(json.dumps(facts), encoding="utf-8")


def run_image_peer(
    peer: ImagePeer, scripts: Path, folder: Path, samples: Sequence[int], tag: str = ""
) -> list[dict[str, Any]]:
    """The peer's variants: {"name", "seconds", "windows"}, or one {"failed"}."""
    own = scripts / ".venv" / "bin" / "python"
    python = os.environ.get(peer.python) or (str(own) if own.is_file() else sys.executable)
    options = json.dumps({"samples": list(samples), "tag": tag})
    try:
        done = subprocess.run(
            [python, str(scripts / peer.script), str(folder), options],
            capture_output=True, text=True, timeout=_LIMIT_S, cwd=scripts,
            env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
        )  # fmt: skip
    except FileNotFoundError as error:
        return [{"failed": f"missing: {error.filename}"}]
    except subprocess.TimeoutExpired:
        return [{"failed": f"stopped after {_LIMIT_S:.0f} s"}]
    lines = [line for line in done.stdout.splitlines() if line.startswith('{"variants"')]
    if done.returncode != 0 or not lines:
        said = (done.stderr.strip() or done.stdout.strip()).splitlines()
        return [{"failed": (said[-1] if said else f"ended with {done.returncode}")[:200]}]
    variants: list[dict[str, Any]] = json.loads(lines[-1])["variants"]
    return variants


def describe(point: ImagePoint) -> str:
    """One line for the screen."""
    if not np.isfinite(point.rms):
        return f"{point.renderer}: {point.seconds:.3f} s, no reference to tell its error"
    return (
        f"{point.renderer}: {point.seconds:.3f} s, RMS {point.rms:.1e}, "
        f"shift {point.shift_rms:.1e} px, bias {point.bias:.1e} px"
    )
