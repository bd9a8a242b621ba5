"""Run time of a frame against the error of its image, on this machine's adapter."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.bench.image_cases import IMAGE_CASES, ImageCase
from gpusim.bench.supersample import compare, reference_windows
from gpusim.gpu import Device, default_device
from gpusim.optics import render

__all__ = ["ImagePoint", "ImageResult", "run_image_bench"]

Array = npt.NDArray[np.float64]
Tell = Callable[[str], None]
_WARM = 4


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

    @classmethod
    def of(cls, case: ImageCase) -> ImageResult:
        camera, triangles = case.camera, len(case.soup.albedo)
        return cls(case.name, camera.width, camera.height, triangles, bool(case.lights))

    def own(self) -> ImagePoint | None:
        return next((p for p in self.points if p.renderer == "gpusim"), None)

    def add(
        self, renderer: str, seconds: float, windows: list[Array], wanted: list[Array], tell: Tell
    ) -> None:
        """Enter an image's windows, beside the reference's if there is one."""
        white = max(float(part.max()) for part in wanted) if wanted and self.lit else 1.0
        off = compare(windows, wanted, white) if wanted else None
        numbers = (off.rms, off.shift_rms, off.bias) if off else (np.nan,) * 3
        self.points.append(ImagePoint(renderer, seconds, *numbers))
        tell(f"{self.case}: {describe(self.points[-1])}")


def run_image_bench(
    names: Sequence[str],
    size: str,
    work: Path,
    tell: Tell,
    save: Callable[[list[ImageResult]], object],
) -> list[ImageResult]:
    """Render every case; ``work`` keeps references. Lit images have none here: their times only."""
    device, results = default_device(), []
    for name in names:
        case = IMAGE_CASES[name](size)
        folder = work / f"{name}-{size}"
        folder.mkdir(parents=True, exist_ok=True)
        wanted = [] if case.lights else unlit_reference(case, folder / "reference.npz", tell)
        results.append(ImageResult.of(case))
        results[-1].add("gpusim", *render_warm(case, device), wanted, tell)
        save(results)
    return results


def render_warm(case: ImageCase, device: Device) -> tuple[float, list[Array]]:
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


def unlit_reference(case: ImageCase, path: Path, tell: Tell) -> list[Array]:
    """The windows' pixels from float64 samples of triangles and discs; ``path`` keeps them."""
    if not path.is_file():
        tell(f"{case.name}: reference")
        np.savez(path, *reference_windows(case))
    return load_windows(path)


def load_windows(path: Path) -> list[Array]:
    """The arrays of an npz file, in order."""
    with np.load(path) as stored:
        return [stored[name] for name in stored.files]


def describe(point: ImagePoint) -> str:
    """One line for the screen."""
    if not np.isfinite(point.rms):
        return f"{point.renderer}: {point.seconds:.3f} s, no reference to tell its error"
    return (
        f"{point.renderer}: {point.seconds:.3f} s, RMS {point.rms:.1e}, "
        f"shift {point.shift_rms:.1e} px, bias {point.bias:.1e} px"
    )
