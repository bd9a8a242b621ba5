"""Run time of a frame against the error of its image, on this machine's adapter.

Reference pixels are triangles and discs sampled by float64 points. Nothing there uses gpusim's
view, coverage or paint: a sample is inside a triangle or it isn't, the nearest counts. Rows and
columns of samples are shifted against each other so that no edge runs along the lattice; the
shifts average to the pixel's centre.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.bench.image_cases import IMAGE_CASES, ImageCase
from gpusim.bench.solver import error_text, machine
from gpusim.files.atomic_files import write_text
from gpusim.gpu import Device, default_device
from gpusim.optics import render
from gpusim.surface import PaintFrame
from gpusim.surface.paint import Speckle

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
        self, renderer: str, seconds: float, windows: list[Float], wanted: list[Float], tell: Tell
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


def render_warm(case: ImageCase, device: Device) -> tuple[float, list[Float]]:
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


def unlit_reference(case: ImageCase, path: Path, tell: Tell) -> list[Float]:
    """The windows' pixels from float64 samples of triangles and discs; ``path`` keeps them."""
    if not path.is_file():
        tell(f"{case.name}: reference")
        np.savez(path, *reference_windows(case))
    return load_windows(path)


def load_windows(path: Path) -> list[Float]:
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


SAMPLES = 48
BLOCK = 32


def _grid(window: tuple[int, int, int, int], n: int) -> tuple[Float, Float]:
    """Image positions x, y of the samples of a window, (rows n, columns n) each."""
    r0, r1, c0, c1 = window
    shift = ((np.arange(n) * 13) % n + 0.5) / n
    j, i = np.mgrid[: (r1 - r0) * n, : (c1 - c0) * n]
    return c0 + (i + shift[j % n]) / n - 0.5, r0 + (j + shift[i % n]) / n - 0.5


def reference_windows(case: ImageCase, n: int = SAMPLES) -> list[Float]:
    """Mean albedo of every pixel of the case's windows, (rows, columns) float64 each."""
    camera = case.camera
    c = camera.to_camera(case.soup.corners)
    ahead = (c[:, :, 2] > 0.0).all(axis=1)
    c, albedo = c[ahead], case.soup.albedo[ahead]
    screen = np.stack([(c @ camera.K.T)[..., k] / c[..., 2] for k in (0, 1)], axis=-1)
    p, q, r = screen[:, 0], screen[:, 1], screen[:, 2]
    area = (q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]
    seen = area < 0.0  # front sides turn the other way where y points down
    screen, z, albedo = screen[seen], c[seen][..., 2], albedo[seen]
    return [_window(case, screen, z, albedo, window, n=n) for window in case.windows]


def _window(
    case: ImageCase,
    screen: Float,
    z: Float,
    albedo: Float,
    window: tuple[int, int, int, int],
    *,
    n: int,
) -> Float:
    r0, r1, c0, c1 = window
    x, y = _grid(window, n)
    value, nearest = np.zeros(x.shape), np.zeros(x.shape)
    low, high = screen.min(axis=1), screen.max(axis=1)
    near = (high > [c0 - 1, r0 - 1]).all(axis=1) & (low < [c1, r1]).all(axis=1)
    for k in np.flatnonzero(near):
        # samples lie up to one step after their place on the regular grid
        a0, b0 = ((low[k] - [c0 - 0.5, r0 - 0.5]) * n - 1.0).astype(int)
        a1, b1 = ((high[k] - [c0 - 0.5, r0 - 0.5]) * n + 2.0).astype(int)
        part = np.s_[max(0, b0) : max(0, b1), max(0, a0) : max(0, a1)]
        weights = _barycentric(screen[k], x[part], y[part])
        inside = (weights >= 0.0).all(axis=0)
        depth = np.tensordot(1.0 / z[k], weights, axes=1)
        inside &= depth > nearest[part]
        nearest[part][inside] = depth[inside]
        value[part][inside] = albedo[k]
    if case.speckle is not None:
        value = np.where(nearest > 0.0, _discs_at(case, case.speckle, x, y), 0.0)
    return np.asarray(value.reshape(r1 - r0, n, c1 - c0, n).mean(axis=(1, 3)))


def _barycentric(p: Float, x: Float, y: Float) -> Float:
    """(3, …) barycentric coordinates of points in the triangle p (3, 2)."""
    d = (p[1, 0] - p[0, 0]) * (p[2, 1] - p[0, 1]) - (p[1, 1] - p[0, 1]) * (p[2, 0] - p[0, 0])
    b1 = ((x - p[0, 0]) * (p[2, 1] - p[0, 1]) - (y - p[0, 1]) * (p[2, 0] - p[0, 0])) / d
    b2 = ((p[1, 0] - p[0, 0]) * (y - p[0, 1]) - (p[1, 1] - p[0, 1]) * (x - p[0, 0])) / d
    return np.stack([1.0 - b1 - b2, b1, b2])


def _discs_at(case: ImageCase, paint: Speckle, x: Float, y: Float) -> Float:
    """Albedo of the speckled plate where rays through image points meet it."""
    camera, plate = case.camera, case.surfaces[0].frames["plate"]
    assert isinstance(plate, PaintFrame)
    ray = np.stack([x, y, np.ones(x.shape)], axis=-1) @ np.linalg.inv(camera.K).T
    ray = ray @ camera.camera_from_world[:3, :3]
    normal = np.cross(plate.s_axis, plate.t_axis)
    along = ((plate.origin - camera.eye) @ normal) / (ray @ normal)
    hit = camera.eye + along[..., None] * ray - plate.origin
    s, t = hit @ plate.s_axis, hit @ plate.t_axis
    low, high = (np.array([f(s), f(t)]) for f in (np.min, np.max))
    centres, radii = paint.discs(low, high)
    covered = np.zeros(x.shape, bool)
    # a disc covers a few rows of samples: the plate is seen nearly upright
    slope_y = (t[-1].mean() - t[0].mean()) / (len(y) - 1)
    slope_x = (s[:, -1].mean() - s[:, 0].mean()) / (x.shape[1] - 1)
    tilt_y = np.abs(t[:, -1] - t[:, 0]).max() / abs(slope_y)
    tilt_x = np.abs(s[-1] - s[0]).max() / abs(slope_x)
    for (u, v), radius in zip(centres, radii, strict=True):
        i, di = (v - t[0].mean()) / slope_y, radius / abs(slope_y) + tilt_y + 2
        j, dj = (u - s[:, 0].mean()) / slope_x, radius / abs(slope_x) + tilt_x + 2
        part = np.s_[max(0, int(i - di)) : int(i + di) + 1, max(0, int(j - dj)) : int(j + dj) + 1]
        if i + di < 0 or j + dj < 0:
            continue
        covered[part] |= (s[part] - u) ** 2 + (t[part] - v) ** 2 <= radius * radius
    return np.where(covered, paint.dot, paint.ground)


@dataclass(frozen=True)
class Difference:
    """``rms`` of the grey range 0 … 1; shifts in px by least squares on gradients, per block."""

    rms: float
    shift_rms: float
    bias: float


def compare(images: list[Float], wanted: list[Float], white: float = 1.0) -> Difference:
    """Windows of an image against their references; ``white`` is the radiance of grey 1."""
    error = np.concatenate([(a - b).ravel() for a, b in zip(images, wanted, strict=True)]) / white
    shifts = []
    for image, want in zip(images, wanted, strict=True):
        for row in range(0, want.shape[0] - BLOCK + 1, BLOCK):
            for column in range(0, want.shape[1] - BLOCK + 1, BLOCK):
                part = np.s_[row : row + BLOCK, column : column + BLOCK]
                if np.ptp(want[part]) > 0.1 * white:
                    found = _shift(want[part], image[part])
                    if found is not None:
                        shifts.append(found)
    found_shifts = np.array(shifts) if shifts else np.full((1, 2), np.nan)
    return Difference(
        float(np.sqrt(np.mean(error**2))),
        float(np.sqrt(np.mean(found_shifts**2))),
        float(np.abs(found_shifts.mean(axis=0)).max()),
    )


def _shift(first: Float, second: Float) -> Float | None:
    """Small translation (x, y) px between two blocks; None where only one direction shows."""
    gy, gx = np.gradient(0.5 * (first + second))
    matrix = np.stack([gx.ravel(), gy.ravel()], axis=1)
    smallest, largest = np.linalg.eigvalsh(matrix.T @ matrix)
    if not smallest > 0.02 * largest:
        return None
    return np.asarray(np.linalg.lstsq(matrix, (first - second).ravel(), rcond=None)[0])


def write_images(cases: Sequence[ImageResult], folder: Path) -> Path:
    """``render.md`` in ``folder``."""
    lines = [
        "# Images: run time against error", "", machine(), "",
        "Warm seconds of a frame until the image lies on the device. Errors in windows around "
        "targets, against 48 x 48 float64 samples a pixel (unlit images): RMS of the grey range, "
        "least-squares shift of 32-px blocks, largest mean shift.", "",
    ]  # fmt: skip
    for case in cases:
        lines += [*image_table(case), ""]
    return write_text(folder / "render.md", "\n".join(lines) + "\n")


def image_table(case: ImageResult) -> list[str]:
    """Every renderer at one case."""
    light = "lit" if case.lit else "unlit"
    lines = [
        f"## {case.case}: {case.width} x {case.height} px, {case.triangles:,} triangles, {light}",
        "", "| renderer | s/frame | ns/px | image RMS | shift RMS px | bias px | time / gpusim |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    own, pixels = case.own(), case.width * case.height
    for p in case.points:
        ratio = f"{p.seconds / own.seconds:.1f}" if own else ""
        lines.append(
            f"| {p.renderer} | {p.seconds:.3f} | {1e9 * p.seconds / pixels:.0f} "
            f"| {error_text(p.rms)} | {error_text(p.shift_rms)} | {error_text(p.bias)} | {ratio} |"
        )
    return lines
