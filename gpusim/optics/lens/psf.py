"""Point spread functions of lenses, and how they are sampled.

A renderer that integrates over square cells samples the scene with a box; a kernel that is sampled
at the same pitch then keeps the aliasing of the sharp image. So the image is rendered at ``n``
cells per pixel, weighted with the point spread function taken at the cells and with the pixel's
aperture, and summed. As a whole that is a kernel constant over each cell: what a step edge differs
by from the exact kernel is computed (`SampledKernel.edge_error`), and decides ``n``. It falls as
1 / n^2 only, whatever the transfer function does at the cells' own Nyquist frequency: the steps of
the kernel, not its samples, are what remains.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
import scipy

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.validation import Portion, Positive, checked, positive, require, unmasked, within

__all__ = [
    "Airy",
    "Convolved",
    "Disc",
    "Gaussian",
    "MeasuredPsf",
    "Psf",
    "SampledKernel",
    "edge_profile",
    "sample",
]


Pixels = Annotated[float, positive("a number above 0 px")]

SIGMAS = 5.0
AIRY_LOST = 0.04  # energy outside the sampled part of an Airy pattern, spread evenly over it
TERM_TOLERANCE = 5e-4  # of the transfer function, by terms left out
MIN_GAIN = 0.8
MAX_CELLS = 401  # along a side of a sampled kernel
FACTORS = (2, 3, 4, 5, 6, 8)


@runtime_checkable
class Psf(Protocol):
    """The image of a point: a density over the sensor of integral 1, coordinates in px.

    Hashable, so that a sampled kernel is made once.

    Examples
    --------
    >>> isinstance(gs.psf.Gaussian(0.5), gs.psf.Psf)
    True
    """

    def __hash__(self) -> int:
        """Equal ones have the same."""

    def transfer(self, fx: Float, fy: Float) -> Float:
        """Real optical transfer function at frequencies in cycles per pixel."""

    def cells(self, n: int) -> Float:
        """(2m + 1, 2m + 1) weights of sum 1 on a grid of pitch 1 / n px."""


@checked
@dataclass(frozen=True)
class Gaussian:
    """A round Gaussian of standard deviation ``sigma`` (px).

    Examples
    --------
    >>> float(gs.psf.Gaussian(sigma=0.5).transfer(0.0, 0.0))
    1.0
    """

    sigma: Pixels

    def transfer(self, fx: Float, fy: Float) -> Float:
        """exp(-2 pi^2 sigma^2 f^2)."""
        return np.asarray(np.exp(-2.0 * (np.pi * self.sigma) ** 2 * (fx**2 + fy**2)))

    def cells(self, n: int) -> Float:
        """Samples out to 5 sigma."""
        k = _grid(SIGMAS * self.sigma, n, "Gaussian")
        row = np.exp(-0.5 * (k / self.sigma) ** 2)
        return np.asarray(np.outer(row, row) / row.sum() ** 2)


@checked
@dataclass(frozen=True)
class Airy:
    """Diffraction at a round aperture: ``wavelength``, and ``pitch`` of a pixel, in one unit.

    Intensity (pi / 4 w^2) (2 J1(v) / v)^2 with w = wavelength x f_number and v = pi r / w (Goodman,
    Introduction to Fourier Optics, 6.2).

    Examples
    --------
    >>> print(f"{gs.psf.Airy(wavelength=0.55e-6, f_number=8.0, pitch=3.45e-6).width:.3f} px")
    1.275 px
    """

    wavelength: Positive
    f_number: Positive
    pitch: Positive

    @property
    def width(self) -> float:
        """wavelength x f_number in px; the cut-off is at its inverse."""
        return self.wavelength * self.f_number / self.pitch

    def transfer(self, fx: Float, fy: Float) -> Float:
        """(2 / pi) (acos v - v sqrt(1 - v^2)), v = f / cut-off; zero above the cut-off."""
        v = np.minimum(np.hypot(fx, fy) * self.width, 1.0)
        return np.asarray((2.0 / np.pi) * (np.arccos(v) - v * np.sqrt(1.0 - v * v)))

    def cells(self, n: int) -> Float:
        """Samples within the radius beyond which 4 % of the energy lie, which is spread over them.

        An Airy pattern's tail falls as r^-3: cut off and scaled up, it would raise the transfer
        function by its share at every frequency; spread evenly it changes only the lowest ones.
        """
        radius = 2.0 * self.width / (np.pi**2 * AIRY_LOST)
        k = _grid(radius, n, "Airy")
        r = np.hypot(k[:, None], k[None, :])
        v = np.maximum(np.pi * r / self.width, 1e-9)
        core = 0.25 * np.pi / self.width**2 * (2.0 * scipy.special.j1(v) / v) ** 2 / n**2
        inside = r <= radius
        core = np.where(inside, core, 0.0)
        return np.asarray(core + np.where(inside, (1.0 - core.sum()) / inside.sum(), 0.0))


@checked
@dataclass(frozen=True)
class Disc:
    """Defocus by geometrical optics: an even disc of ``radius`` px.

    Examples
    --------
    >>> gs.psf.Disc(radius=1.5).cells(1).shape
    (7, 7)
    """

    radius: Pixels

    def transfer(self, fx: Float, fy: Float) -> Float:
        """2 J1(u) / u, u = 2 pi radius f."""
        u = np.maximum(2.0 * np.pi * self.radius * np.hypot(fx, fy), 1e-9)
        return np.asarray(2.0 * scipy.special.j1(u) / u)

    def cells(self, n: int) -> Float:
        """The share of each cell that the disc covers.

        Covering cells widens the disc by a cell's own variance, 1 / 12 n^2 along each axis; the
        radius is taken smaller by as much, so that the second moment is the disc's.
        """
        smaller = np.sqrt(max(self.radius**2 - 1.0 / (3.0 * n * n), 0.25 * self.radius**2))
        k = _grid(self.radius + 1.0 / n, n, "Disc")
        sub = (np.arange(32) + 0.5) / 32.0 - 0.5
        fine = (k[:, None] + sub[None, :] / n).ravel()
        chord = np.sqrt(np.maximum(smaller**2 - fine**2, 0.0))
        # exact along x, 32 lines along y
        low, high = k - 0.5 / n, k + 0.5 / n
        share = np.minimum(chord[:, None], high) - np.maximum(-chord[:, None], low)
        share = np.maximum(share, 0.0).reshape(len(k), 32, len(k)).sum(axis=1)
        return np.asarray(share / share.sum())


@checked
@dataclass(frozen=True, eq=False)
class MeasuredPsf:
    """A measured kernel (rows, columns) of ``samples_per_px``, centred on its middle sample.

    It is scaled to sum 1. Between its samples it is interpolated by cubic B-splines.

    Examples
    --------
    >>> gs.psf.MeasuredPsf(np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0.0]])).samples_per_px
    1.0
    """

    kernel: Float
    samples_per_px: Positive = 1.0
    __repr__ = field_summary

    def __post_init__(self) -> None:
        kernel = np.asarray(self.kernel, np.float64)
        odd = kernel.ndim == 2 and all(side % 2 == 1 for side in kernel.shape)
        require(odd, "MeasuredPsf kernel", f"shape {kernel.shape}", "two odd numbers")
        if not np.isfinite(kernel).all() or not kernel.sum() > 0.0:
            raise InputError("MeasuredPsf kernel; got a sum of 0 or values that aren't finite")
        object.__setattr__(self, "kernel", kernel / kernel.sum())

    def transfer(self, fx: Float, fy: Float) -> Float:
        """Real part of the Fourier sum of the samples."""
        rows, columns = (
            (np.arange(side) - side // 2) / self.samples_per_px for side in self.kernel.shape
        )
        fx, fy = np.broadcast_arrays(np.asarray(fx, np.float64), np.asarray(fy, np.float64))
        along = np.exp(-2j * np.pi * fx[..., None] * columns)
        across = np.exp(-2j * np.pi * fy[..., None] * rows)
        return np.asarray(np.einsum("...r,rc,...c->...", across, self.kernel, along).real)

    def cells(self, n: int) -> Float:
        """The interpolated kernel at the cells."""
        half = max(self.kernel.shape) // 2 / self.samples_per_px
        k = _grid(half, n, "MeasuredPsf") * self.samples_per_px
        row, column = (np.meshgrid(k + side // 2, [0.0])[0][0] for side in self.kernel.shape)
        at = np.meshgrid(row, column, indexing="ij")
        values = scipy.ndimage.map_coordinates(self.kernel, at, order=3, mode="constant")
        return np.asarray(values / values.sum())


@dataclass(frozen=True)
class Convolved:
    """One point spread after another.

    Examples
    --------
    >>> both = gs.psf.Convolved(gs.psf.Gaussian(0.3), gs.psf.Gaussian(0.4))
    >>> bool(np.isclose(both.transfer(0.2, 0.0), gs.psf.Gaussian(0.5).transfer(0.2, 0.0)))
    True
    """

    first: Psf
    second: Psf

    def transfer(self, fx: Float, fy: Float) -> Float:
        """The product of both transfer functions."""
        return self.first.transfer(fx, fy) * self.second.transfer(fx, fy)

    def cells(self, n: int) -> Float:
        """The convolution of both sets of weights."""
        a, b = self.first.cells(n), self.second.cells(n)
        shape = [m + k - 1 for m, k in zip(a.shape, b.shape, strict=True)]
        # of real arrays, padded to a length that transforms fast: the sum of all shifts
        from scipy import fft  # not without a lens

        whole = [fft.next_fast_len(side, real=True) for side in shape]
        product = fft.rfft2(a, whole) * fft.rfft2(b, whole)
        return np.asarray(fft.irfft2(product, whole)[: shape[0], : shape[1]])


def _grid(radius: float, n: int, what: str) -> Float:
    """Cell positions in px from -m / n to m / n, m / n >= radius."""
    m = int(np.ceil(radius * n - 1e-9))
    expected = f"at most {MAX_CELLS // 2 / n:.4g} px at {n} cells a pixel"
    require(2 * m + 1 <= MAX_CELLS, f"{what}: its radius", f"{radius:.4g} px", expected)
    return np.arange(-m, m + 1) / n


@dataclass(frozen=True, eq=False)
class SampledKernel:
    """A point spread function and the pixel's aperture as weights of cells of 1 / ``n`` px.

    ``terms``: (along x, along y) weights, (2 halo + n,) each; the kernel is the sum of their outer
    products. The first weight belongs to the cell ``halo`` cells before the pixel's own.

    Examples
    --------
    >>> kernel = gs.psf.sample(gs.psf.Gaussian(0.7), n=2)
    >>> kernel.n, len(kernel.terms)
    (2, 1)
    """

    n: int
    halo: int
    terms: tuple[tuple[Float, Float], ...]
    edge_error: float
    __repr__ = field_summary

    @property
    def taps(self) -> int:
        """Cells along a side."""
        return 2 * self.halo + self.n


@checked
def sample(
    psf: Psf | None,
    *,
    fill_factor: Portion = 1.0,
    tolerance: float = 1e-3,
    n: Annotated[int, within(1, 16)] | None = None,
) -> SampledKernel:
    """Sample ``psf`` and a square pixel aperture of area ``fill_factor`` px^2.

    ``n``, unless given, is the smallest number of cells for which the RMS error of a full-contrast
    edge along the pixel rows, over two pixels on either side, is within ``tolerance``.

    Raises
    ------
    InputError
        Arguments out of range, or a kernel too large to be sampled.

    Examples
    --------
    >>> gs.psf.sample(gs.psf.Gaussian(0.7), tolerance=1e-3).n
    4
    """
    side = float(np.sqrt(fill_factor))
    if n is not None:
        return _sampled(psf, side, int(n))
    kernel = _sampled(psf, side, FACTORS[0])
    for factor in FACTORS[1:]:
        if kernel.edge_error <= tolerance:
            break
        finer = _sampled(psf, side, factor)
        if finer.edge_error > MIN_GAIN * kernel.edge_error:
            break  # what remains isn't the cells' doing (the even tail of an Airy pattern)
        kernel = finer
    return kernel


@lru_cache(maxsize=64)
def _sampled(psf: Psf | None, side: float, n: int) -> SampledKernel:
    cells = np.ones((1, 1)) if psf is None else psf.cells(n)
    low = np.arange(n) / n - 0.5
    box = np.minimum(low + 1.0 / n, 0.5 * side) - np.maximum(low, -0.5 * side)
    box = np.maximum(box, 0.0) / side
    u, scale, v = np.linalg.svd(cells)
    rest = cells.copy()
    count = 0
    while count == 0 or np.abs(np.fft.fft2(rest)).max() > TERM_TOLERANCE:
        rest -= scale[count] * np.outer(u[:, count], v[count])
        count += 1
    terms = tuple(
        (np.convolve(v[i] * np.sqrt(scale[i]), box), np.convolve(u[:, i] * np.sqrt(scale[i]), box))
        for i in range(count)
    )
    total = sum(x.sum() * y.sum() for x, y in terms)
    terms = tuple((x / total, y) for x, y in terms)
    halo = len(cells) // 2
    line = sum((x * y.sum() for x, y in terms), np.zeros(2 * halo + n))
    return SampledKernel(n, halo, terms, _edge_error(line, psf, side, n))


def _edge_error(line: Float, psf: Psf | None, side: float, n: int) -> float:
    """RMS difference of edge profiles within 2 px: cells of weight ``line`` against the exact."""
    ends = (np.arange(len(line) + 1) - 0.5 * len(line)) / n
    x = np.linspace(-2.0, 2.0, 129)
    got = np.interp(x, ends, np.concatenate([[0.0], np.cumsum(line)]))
    return float(np.sqrt(np.mean((got - edge_profile(psf, side, x)) ** 2)))


@unmasked()
def edge_profile(psf: Psf | None, side: float, x: Float) -> Float:
    """Image of a step edge at 0 along the rows, (n,) at distances ``x`` px.

    1/2 + integral of H(f) sin(2 pi f x) / (pi f), H = transfer x aperture of width ``side``.

    Examples
    --------
    >>> gs.psf.edge_profile(gs.psf.Gaussian(0.5), 1.0, np.array([-1.0, 0.0, 1.0])).round(3)
    array([0.041, 0.5  , 0.959])
    """
    if psf is None:
        return np.asarray(np.clip(x / side + 0.5, 0.0, 1.0))
    step = min(1.0 / 128.0, 0.25 / max(float(np.abs(x).max()), 1.0))
    f = (np.arange(int(24 / step)).astype(np.float64) + 0.5) * step
    H = psf.transfer(f, np.zeros_like(f)) * np.sinc(side * f)
    waves = np.sin(2.0 * np.pi * np.outer(x, f))
    return np.asarray(0.5 + step * (waves @ (H / (np.pi * f))))


def __dir__() -> list[str]:
    return sorted(__all__)
