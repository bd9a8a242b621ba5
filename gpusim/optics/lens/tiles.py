"""Pictures in tiles: as many cells, finer than pixels, as are rendered at once."""

from __future__ import annotations

from dataclasses import dataclass

from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.lens.psf import SampledKernel
from gpusim.optics.rendering.frame_plan import BAND_BYTES
from gpusim.optics.rendering.renderer import MAX_SIDE

TILE_CELLS = 1 << 24


@dataclass(frozen=True)
class Tile:
    """Pixels of a picture whose cells are rendered at once."""

    column0: int
    columns: int
    row0: int
    rows: int

    def cells(self, camera: Camera, kernel: SampledKernel) -> Camera:
        """The camera whose pixels are the tile's cells, halo included."""
        n, halo = kernel.n, kernel.halo
        return camera.reframed(
            n * self.columns + 2 * halo,
            n * self.rows + 2 * halo,
            corner=(self.column0 - halo / n, self.row0 - halo / n),
            scale=(n, n),
        )


def largest_tile(camera: Camera, kernel: SampledKernel) -> tuple[int, int]:
    """Columns and rows of the largest tile whose cells can be rendered at once."""
    n, halo = kernel.n, kernel.halo
    across = -(-(n * camera.width + 2 * halo) // MAX_SIDE)
    columns = -(-camera.width // across)
    if not (MAX_SIDE - 2 * halo) // n >= 1:
        raise InputError(f"photograph: the lens blurs over {2 * halo // n} px; expected less")
    columns = min(columns, (MAX_SIDE - 2 * halo) // n)
    wide = n * columns + 2 * halo
    most = min(TILE_CELLS // wide, MAX_SIDE)
    rows = max(1, (most - 2 * halo) // n)
    return columns, min(rows, camera.height, max(16, BAND_BYTES // (4 * camera.width)))
