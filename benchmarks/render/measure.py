"""The render benchmark: run time against error of the image, beside other renderers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.render.cases import IMAGE_CASES, lamp_sides
from benchmarks.render.disc_texture import disc_texture
from benchmarks.solver.peers import SCRIPTS
from gpusim.bench.image_cases import ImageCase
from gpusim.bench.images import ImageResult, Tell, load_windows, render_warm, unlit_reference
from gpusim.bench.solver import machine
from gpusim.gpu import Device, default_device

__all__ = ["IMAGE_PEERS", "ImagePeer", "RenderResult", "run_render_bench"]

Array = npt.NDArray[np.float64]
CONVERGED = 1024
_LIMIT_S = 1800.0


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


@dataclass
class RenderResult:
    """Everything measured, for `benchmarks.render.tables`."""

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
    device, result = default_device(), RenderResult(machine())
    for name in names:
        case = IMAGE_CASES[name](size)
        result.cases.append(_run_case(case, work / f"{name}-{size}", peers, device, tell))
        save(result)
    return result


def _run_case(
    case: ImageCase, folder: Path, peers: Sequence[ImagePeer], device: Device, tell: Tell
) -> ImageResult:
    found = ImageResult.of(case)
    folder.mkdir(parents=True, exist_ok=True)
    _write_problem(case, folder)
    wanted = _reference(case, folder, found, tell)
    found.add("gpusim", *render_warm(case, device), wanted, tell)
    for peer in peers:
        if not (peer.lit if found.lit else peer.unlit):
            continue
        samples = [n for n in peer.samples if n * case.pixels <= peer.most_samples]
        for variant in run_image_peer(peer, folder, samples) if samples else ():
            if "failed" in variant:
                found.failures.append(f"{peer.name}: {variant['failed']}")
                tell(f"{case.name}: {found.failures[-1]}")
                continue
            windows = load_windows(Path(variant["windows"]))
            found.add(variant["name"], variant["seconds"], windows, wanted, tell)
    return found


def _reference(case: ImageCase, folder: Path, found: ImageResult, tell: Tell) -> list[Array]:
    path = folder / "reference.npz"
    if not case.lights:
        return unlit_reference(case, path, tell)
    if not path.is_file():
        tell(f"{case.name}: reference")
        mitsuba = next(peer for peer in IMAGE_PEERS if peer.name == "Mitsuba")
        (made,) = run_image_peer(mitsuba, folder, [CONVERGED], "windows-")
        if "failed" in made:
            found.failures.append(f"no reference: {made['failed']}")
            return []
        np.savez(path, *load_windows(Path(made["windows"])))
    return load_windows(path)


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
    if case.speckle is not None:
        plate = case.surfaces[0].frames["plate"]
        st = plate.coordinates(case.soup.corners)
        wide, tall = st.reshape(-1, 2).max(axis=0)
        arrays["uv"] = st / [wide, tall]
        pixel = float(np.linalg.norm(plate.origin - camera.eye)) / camera.K[0, 0]
        arrays["texture"] = disc_texture(case.speckle, (wide, tall), 0.5 * pixel)
    np.savez(folder / "problem.npz", allow_pickle=False, **arrays)
    facts = {"width": camera.width, "height": camera.height, "focal": camera.K[0, 0],
             "lit": bool(case.lights)}  # fmt: skip
    (folder / "problem.json").write_text(json.dumps(facts), encoding="utf-8")


def run_image_peer(
    peer: ImagePeer,
    folder: Path,
    samples: Sequence[int],
    tag: str = "",
    scripts: Path = SCRIPTS,
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
