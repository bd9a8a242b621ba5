"""Undistortion of every pixel by a table of cubics, as good as exact and cheap to evaluate.

The image is cut into square tiles. In each, the way from a pixel to its ideal position is a cubic
fitted to the exact inverse at 4 x 4 Chebyshev nodes; tiles are halved until it is right to
5e-5 px everywhere. Because the table belongs to the camera and not to triangles, no triangle has
to be split for it. The shader's form is shaders/lib/raster/undistortion_table.wgsl.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gpusim.arrays.array_types import Float, Long, Single
from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera

SIZES = (128, 64, 32, 16, 8, 4, 2, 1)
FINE = 5e-5
"""px to which the table shall agree with the exact inverse."""

COARSE = 1e-3
"""px above which even the smallest tile is refused."""

PROBES = 400
POWERS = np.array([(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)])
"""Powers of (u, v) of the ten coefficients."""


@dataclass(frozen=True, eq=False)
class DistortionMap:
    """``coefficients`` (rows, columns, 2, 10) per tile of ``size`` px, in the order of `POWERS`.

    They give the shift from a pixel to its ideal position at (u, v) px from the tile's ``middle``
    (2,) behind its origin. Tiles start at multiples of ``size``, but none later than ``last`` (2,).
    ``stretch``: the most that a pixel grows when undistorted. ``bend``: largest second derivative
    of the shift, per px. ``error``: px, the largest difference to the exact inverse found.
    """

    size: int
    last: Long
    middle: Float
    coefficients: Float
    stretch: float
    bend: float
    error: float

    def evaluate(self, pixel: Long, at: Float) -> tuple[Float, Float]:
        """Shift (n, 2) of positions pixel + ``at``, (n, 2) each, and Jacobian (n, 2, 2).

        ``pixel`` says which tile holds; Jacobian [:, :, k] is the change per column or row.
        """
        tile = pixel // self.size
        c = self.coefficients[tile[:, 1], tile[:, 0]]
        w = pixel - np.minimum(tile * self.size, self.last) - self.middle + at
        shift, jacobian = _cubic(c, w)
        return shift, jacobian + np.eye(2)

    def ideal(self, at: Float) -> tuple[Float, Float]:
        """Ideal positions (n, 2) of image positions ``at`` (n, 2), and their change (n, 2, 2).

        Change [:, :, k] is what a column or a row of the image is in pixels of the ideal image.
        Beside the image the outermost tile's cubic goes on.
        """
        most = np.array(self.coefficients.shape[1::-1]) * self.size - 1
        pixel = np.clip(np.rint(at).astype(np.int64), 0, most)
        shift, change = self.evaluate(pixel, at - pixel)
        return at + shift, change

    def texels(self) -> Single:
        """(5 per tile, 4) float32 as the shader reads them: two coefficients, x and y of each."""
        c = self.coefficients.reshape(-1, 2, 10)
        return np.swapaxes(c, 1, 2).reshape(-1, 4).astype(np.float32)

    def tiles(self) -> dict[str, object]:
        """The shader's uniform."""
        return {
            "last": self.last.astype(np.float64),
            "middle": self.middle,
            "size": self.size,
            "columns": self.coefficients.shape[1],
        }


def _cubic(c: Float, w: Float) -> tuple[Float, Float]:
    """Value (n, 2) and derivatives (n, 2, 2) of cubics (n, 2, 10) at w (n, 2)."""
    u, v = w[:, :1], w[:, 1:]
    value = c[..., 0] + u * (
        c[..., 1]
        + u * (c[..., 3] + u * c[..., 6] + v * c[..., 7])
        + v * (c[..., 4] + v * c[..., 8])
    )
    value += v * (c[..., 2] + v * (c[..., 5] + v * c[..., 9]))
    per_column = c[..., 1] + u * (2.0 * c[..., 3] + 3.0 * u * c[..., 6] + 2.0 * v * c[..., 7])
    per_column += v * (c[..., 4] + v * c[..., 8])
    per_row = c[..., 2] + v * (2.0 * c[..., 5] + 3.0 * v * c[..., 9] + 2.0 * u * c[..., 8])
    per_row += u * (c[..., 4] + u * c[..., 7])
    return value, np.stack([per_column, per_row], axis=-1)


def distortion_map(camera: Camera) -> DistortionMap | None:
    """The table of a camera, kept for the next call; None for a lens without distortion."""
    if camera.lens is None:
        return None
    return _cached(
        camera.width, camera.height, camera.distorting_K.tobytes(),
        camera.lens.coefficients.tobytes(), camera.name,
    )  # fmt: skip


def undistorted(camera: Camera, at: Float) -> tuple[Float, Float]:
    """Ideal positions (n, 2) of image positions ``at`` (n, 2), and the change (n, 2, 2).

    Change [:, :, k]: a side of a pixel's sensitive square in pixels of the ideal image.
    """
    bends, side = distortion_map(camera), camera.pixel_side
    if bends is None:
        return at, np.broadcast_to(side * np.eye(2), (len(at), 2, 2))
    ideal, change = bends.ideal(at)
    return ideal, side * change


@lru_cache(maxsize=16)
def _cached(width: int, height: int, K: bytes, coefficients: bytes, name: str) -> DistortionMap:
    matrix = np.frombuffer(K, np.float64).reshape(3, 3)
    camera = Camera(width, height, matrix, np.frombuffer(coefficients, np.float64), name=name)
    for size in SIZES:
        grid = _Tiles(camera, size)
        # few tiles tell whether the size will do; the last word is that of all of them
        if size > SIZES[-1] and not grid.error(grid.some(), grid.fit(grid.some())) <= FINE:
            continue
        table = grid.table()
        if table.error <= FINE or size == SIZES[-1]:
            break
    if not table.error <= COARSE:
        values = np.frombuffer(coefficients).tolist()
        raise InputError(
            f"Camera {name!r} distortion; got {values}, which bends so strongly that tiles of "
            f"{size} px are off by {table.error:.2g} px; expected a lens that stays clear of "
            "folding inside the image"
        )
    return table


class _Tiles:
    """Tiles of one size over a camera's image."""

    def __init__(self, camera: Camera, size: int) -> None:
        self.camera, self.size = camera, size
        self.columns, self.rows = -(-camera.width // size), -(-camera.height // size)
        shape = np.array([camera.width, camera.height])
        self.last = np.maximum(shape - size, 0)
        self.half = 0.5 * np.minimum(size, shape)
        self.middle = self.half - 0.5
        node = np.cos((2.0 * np.arange(4) + 1.0) * np.pi / 8.0)
        self.node = np.stack(np.meshgrid(node, node), axis=-1).reshape(-1, 2)
        powers = np.prod(self.node[:, None] ** POWERS, axis=-1)
        self.solve = np.linalg.pinv(powers) / np.prod(self.half**POWERS, axis=-1)[:, None]

    def some(self) -> Long:
        """At most PROBES tile numbers, evenly over the image with its corners."""
        n = int(np.sqrt(PROBES))
        x = np.unique(np.linspace(0, self.columns - 1, n).astype(np.int64))
        y = np.unique(np.linspace(0, self.rows - 1, n).astype(np.int64))
        return (y[:, None] * self.columns + x).reshape(-1)

    def centre(self, tile: Long) -> Float:
        """Middle (n, 2) of tiles, px."""
        index = np.stack([tile % self.columns, tile // self.columns], axis=1)
        result: Float = np.minimum(index * self.size, self.last) + self.middle
        return result

    def fit(self, tile: Long) -> Float:
        """Coefficients (n, 2, 10) of tiles."""
        at = self.centre(tile)[:, None] + self.half * self.node
        shift = self.camera.undistort(at) - at
        result: Float = np.swapaxes(self.solve @ shift, 1, 2)
        return result

    def error(self, tile: Long, coefficients: Float) -> float:
        """Largest difference (px) to the exact inverse at the corners, sides and in the middle."""
        worst = 0.0
        for sides in np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), -1).reshape(-1, 2):
            w = np.broadcast_to(self.half * sides, (len(tile), 2))
            at = self.centre(tile) + w
            off = np.abs(at + _cubic(coefficients, w)[0] - self.camera.undistort(at)).max()
            worst = max(worst, float(off) if np.isfinite(off) else np.inf)
        return worst

    def table(self) -> DistortionMap:
        """All tiles; the error is looked for in some of them, and in those that bend most."""
        tile = np.arange(self.rows * self.columns)
        c = self.fit(tile)
        rest = np.abs(c[..., 6:]).max(axis=(1, 2))
        probed = np.unique(np.r_[self.some(), np.argsort(-rest)[:PROBES]])
        slope = np.abs(c[..., 1:3] + np.eye(2)).sum(axis=2).max()
        bend = 2.0 * np.abs(c[..., 3:6]).sum(axis=2).max()
        return DistortionMap(
            self.size,
            self.last,
            self.middle,
            c.reshape(self.rows, self.columns, 2, 10),
            float(slope + 0.5 * self.size * bend),
            float(bend),
            self.error(probed, c[probed]),
        )
