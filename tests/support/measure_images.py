"""Exact float64 test images: pixel values are closed-form area integrals, nothing is resampled."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter
from scipy.special import erf

FloatArray = npt.NDArray[np.float64]


def speckles(
    width: int,
    height: int,
    *,
    shift: tuple[float, float] = (0.0, 0.0),
    gradient: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0)),
    sigma: float = 1.5,
    density: float = 0.03,
    seed: int = 1,
) -> FloatArray:
    """A sum of Gaussians, each integrated over the pixels, moved by an affine field.

    x -> x + shift + gradient (x - centre), centre = ((width-1)/2, (height-1)/2). A moved Gaussian
    gets the covariance sigma^2 A A^T: with a gradient its pixel integral has no product form and
    comes from 6x6 Gauss-Legendre points per pixel (error < 1e-10 for sigma >= 1.2 px).
    """
    rng = np.random.default_rng(seed)
    margin = 12.0
    number = int(density * (width + 2 * margin) * (height + 2 * margin))
    x = rng.uniform(-margin, width - 1 + margin, number)
    y = rng.uniform(-margin, height - 1 + margin, number)
    amplitude = rng.uniform(25.0, 60.0, number)
    matrix = np.eye(2) + np.array(gradient)
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    moved = (np.column_stack([x, y]) - centre) @ matrix.T + centre + np.array(shift)
    if np.array_equal(matrix, np.eye(2)):
        by_x = _box_gauss(np.arange(width)[:, None] - moved[:, 0], sigma)
        by_y = _box_gauss(np.arange(height)[:, None] - moved[:, 1], sigma)
        return 40.0 + (by_y * amplitude) @ by_x.T
    inverse = np.linalg.inv(matrix @ matrix.T) / sigma**2
    nodes, weights = np.polynomial.legendre.leggauss(6)
    image = np.full((height, width), 40.0)
    for (px, py), a in zip(moved, amplitude, strict=True):
        x0, x1 = max(math.floor(px - 11), 0), min(math.ceil(px + 11), width - 1)
        y0, y1 = max(math.floor(py - 11), 0), min(math.ceil(py + 11), height - 1)
        if x1 < x0 or y1 < y0:
            continue
        dx = (np.arange(x0, x1 + 1)[:, None] + 0.5 * nodes - px).ravel()
        dy = (np.arange(y0, y1 + 1)[:, None] + 0.5 * nodes - py).ravel()
        q = (
            inverse[0, 0] * dx[None, :] ** 2
            + 2 * inverse[0, 1] * dx[None, :] * dy[:, None]
            + inverse[1, 1] * dy[:, None] ** 2
        )
        value = np.exp(-0.5 * q).reshape(y1 - y0 + 1, 6, x1 - x0 + 1, 6)
        image[y0 : y1 + 1, x0 : x1 + 1] += (
            a * np.einsum("rpcq,p,q->rc", value, weights, weights) / 4
        )
    return image


def _box_gauss(distance: FloatArray, sigma: float) -> FloatArray:
    """Mean of exp(-d^2 / 2 sigma^2) over a pixel of width 1."""
    q = sigma * math.sqrt(2.0)
    scale = sigma * math.sqrt(math.pi / 2.0)
    result: FloatArray = scale * (erf((distance + 0.5) / q) - erf((distance - 0.5) / q))
    return result


@dataclass(frozen=True)
class Marker:
    """A 2x2 checker of width x height px, turned by ``angle``; black and white grey values."""

    x: float
    y: float
    width: float
    height: float
    angle: float = 0.0
    white: float = 210.0
    black: float = 35.0

    def moved(self, dx: float, dy: float, turn: float) -> Marker:
        return Marker(
            self.x + dx,
            self.y + dy,
            self.width,
            self.height,
            self.angle + turn,
            self.white,
            self.black,
        )


def board(width: int, height: int, markers: list[Marker], background: float = 120.0) -> FloatArray:
    """Markers on a plain background, every pixel the exact area mean."""
    image = np.full((height, width), background)
    for marker in markers:
        cosine, sine = math.cos(marker.angle), math.sin(marker.angle)
        for i, j in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
            value = marker.white if i == j else marker.black
            corners = []
            for a, b in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)):
                lx, ly = a * marker.width / 2, b * marker.height / 2
                corners.append(
                    (marker.x + cosine * lx - sine * ly, marker.y + sine * lx + cosine * ly)
                )
            _add_polygon(image, corners, value - background)
    return image


def _add_polygon(image: FloatArray, corners: list[tuple[float, float]], value: float) -> None:
    """Add value times the exact area of the polygon in each pixel."""
    height, width = image.shape
    xs, ys = [c[0] for c in corners], [c[1] for c in corners]
    for row in range(max(math.floor(min(ys)), 0), min(math.ceil(max(ys)), height - 1) + 1):
        strip = _clip(_clip(corners, 1, row - 0.5, 1.0), 1, row + 0.5, -1.0)
        if len(strip) < 3:
            continue
        for column in range(max(math.floor(min(xs)), 0), min(math.ceil(max(xs)), width - 1) + 1):
            cell = _clip(_clip(strip, 0, column - 0.5, 1.0), 0, column + 0.5, -1.0)
            if len(cell) >= 3:
                image[row, column] += value * _area(cell)


def _clip(
    polygon: list[tuple[float, float]], axis: int, limit: float, sign: float
) -> list[tuple[float, float]]:
    """Keep the part of a convex polygon with sign * (coordinate - limit) >= 0."""
    result = []
    for k, point in enumerate(polygon):
        before = polygon[k - 1]
        d0, d1 = sign * (before[axis] - limit), sign * (point[axis] - limit)
        if (d0 >= 0) != (d1 >= 0):
            t = d0 / (d0 - d1)
            result.append(
                (before[0] + t * (point[0] - before[0]), before[1] + t * (point[1] - before[1]))
            )
        if d1 >= 0:
            result.append(point)
    return result


def _area(polygon: list[tuple[float, float]]) -> float:
    return 0.5 * abs(
        sum(
            polygon[k - 1][0] * point[1] - point[0] * polygon[k - 1][1]
            for k, point in enumerate(polygon)
        )
    )


def blurred_board(
    width: int, height: int, markers: list[Marker], sigma: float, background: float = 120.0
) -> FloatArray:
    """``board`` seen through a Gaussian lens blur, integrated over the pixels.

    The blur acts on exact areas of 5x5 parts of each pixel (blurring whole pixels isn't the same).
    """
    n = 5
    offset = (n - 1) / 2
    fine = [
        Marker(
            n * m.x + offset, n * m.y + offset, n * m.width, n * m.height, m.angle, m.white, m.black
        )
        for m in markers
    ]
    image = gaussian_filter(board(n * width, n * height, fine, background), n * sigma)
    result: FloatArray = image.reshape(height, n, width, n).mean(axis=(1, 3))
    return result


def discs(
    width: int,
    height: int,
    *,
    shift: tuple[float, float] = (0.0, 0.0),
    radius: float = 2.2,
    psf: float = 0.7,
    cover: float = 0.5,
    seed: int = 1,
) -> FloatArray:
    """Sharp black discs on white, seen through a Gaussian lens and integrated over the pixels.

    The lens blur acts on 8x8 parts of each pixel, whose own coverage is exact to a few percent of
    1/64 pixel at the rim: the image is good to 1e-4 of its contrast.
    """
    n, margin = 8, 8
    rng = np.random.default_rng(seed)
    number = int(cover * (width + 2 * margin) * (height + 2 * margin) / (math.pi * radius**2))
    x = rng.uniform(-margin, width + margin, number) + shift[0]
    y = rng.uniform(-margin, height + margin, number) + shift[1]
    pad = 6
    fine = np.zeros((n * (height + 2 * pad), n * (width + 2 * pad)))
    reach = math.ceil(n * radius) + 2
    offset = np.arange(-reach, reach + 1)
    for px, py in zip(n * (x + pad + 0.5) - 0.5, n * (y + pad + 0.5) - 0.5, strict=True):
        cx, cy = round(px), round(py)
        rows, columns = cy + offset, cx + offset
        inside_y = (rows >= 0) & (rows < fine.shape[0])
        inside_x = (columns >= 0) & (columns < fine.shape[1])
        distance = np.hypot(columns[None, :] - px, rows[:, None] - py)
        ink = np.clip(n * radius - distance + 0.5, 0.0, 1.0)
        part = np.ix_(rows[inside_y], columns[inside_x])
        fine[part] = np.maximum(fine[part], ink[np.ix_(inside_y, inside_x)])
    soft = gaussian_filter(fine, n * psf)
    means = soft.reshape(height + 2 * pad, n, width + 2 * pad, n).mean(axis=(1, 3))
    result: FloatArray = 220.0 - 180.0 * means[pad:-pad, pad:-pad]
    return result


class Waves:
    """A random pattern of plane waves: known everywhere, so that any motion of it is exact."""

    def __init__(self, seed: int = 1, number: int = 160) -> None:
        rng = np.random.default_rng(seed)
        size = rng.uniform(0.35, 1.25, number)  # rad/px: speckles of 3 to 5 px
        direction = rng.uniform(0, 2 * math.pi, number)
        self.kx, self.ky = size * np.cos(direction), size * np.sin(direction)
        self.phase = rng.uniform(0, 2 * math.pi, number)
        self.amplitude = 40.0 * math.sqrt(2.0 / number)

    def at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Grey values at positions of any equal shape: mean 128, standard deviation 40."""
        if x.ndim == 2 and (x == x[0]).all() and (y == y[:, :1]).all():
            # a lattice, of whose places rows and columns each have a factor
            across = np.exp(1j * (np.outer(self.kx, x[0]) + self.phase[:, None]))
            down = np.exp(1j * np.outer(y[:, 0], self.ky))
            return np.asarray(128.0 + self.amplitude * (down @ across).imag)
        total = np.full(x.shape, 128.0)
        for kx, ky, phase in zip(self.kx, self.ky, self.phase, strict=True):
            total += self.amplitude * np.sin(kx * x + ky * y + phase)
        return total

    def gradient_square(self) -> float:
        """Mean of (df/dx)^2."""
        return float(np.sum((self.amplitude * self.kx) ** 2) / 2)

    def moved(self, width: int, height: int, field: Callable[..., FloatArray]) -> FloatArray:
        """The image after each X went to X + u(X); field(x, y) = (2, ...), px.

        The pixel at x shows the X that came there: found by fixed-point steps to 1e-12 px.
        """
        y, x = np.indices((height, width), dtype=np.float64)
        place = np.stack([x, y])
        for _ in range(200):
            new = np.stack([x, y]) - field(*place)
            change = float(np.abs(new - place).max())
            place = new
            if change < 1e-12:
                return self.at(*place)
        raise AssertionError("the field folds")
