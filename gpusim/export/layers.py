"""The truth layers: what each one holds, and how it is stored as a chunked HDF5 dataset.

Layers are stored on the pixel grid of a frame, at the pixel *centre* and unfiltered. "Eulerian"
means: the value belongs to the material point that this pixel of this frame sees. (Nodal fields in
the same file are "Lagrangian": indexed by node.)

Chunks are shuffled and deflated here, in parallel threads, and handed to HDF5 ready-made: its own
filter pipeline runs on one core and would take longer than rendering the frame.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import islice

import h5py
import numpy as np
import numpy.typing as npt

from gpusim.validation import require


@dataclass(frozen=True)
class Layer:
    """One truth layer. ``components`` is 1 for (H, W), C for (H, W, C); ``fill`` marks no data."""

    name: str
    components: int
    dtype: str
    unit: str
    frame: str
    text: str
    convention: str = "Eulerian"

    @property
    def fill(self) -> float:
        """NaN for floating point, -1 for integers."""
        return float("nan") if np.dtype(self.dtype).kind == "f" else -1


_ROWS = (
    ("reference", 3, "float64", "m", "world",
     "X: where the material point seen by this pixel was in the reference configuration"),
    ("displacement", 3, "float32", "m", "world",
     "u = x - X of the material point seen by this pixel"),
    ("depth", 1, "float32", "m", "camera",
     "planar depth: z along the optical axis, not the length of the ray"),
    ("flow", 2, "float32", "px", "image (x right, y down)",
     "from this pixel to where its material point is in the reference (undeformed) frame"),
    ("forward_flow", 2, "float32", "px", "image (x right, y down)",
     "from this pixel of frame 0 to where its material point is in this frame", "Lagrangian"),
    ("normal", 3, "float32", "1", "world",
     "unit outward normal of the deformed surface"),
    ("region", 1, "int32", "1", "index",
     "paint region: index into the attribute 'regions' of the file; -1 background"),
    ("element", 1, "int32", "1", "index",
     "finite element that owns the surface seen by this pixel; -1 background or rigid prop"),
    ("visibility", 1, "int8", "1", "index",
     "1 if this material point is also seen in the reference frame, 0 if not, -1 background"),
    ("cameras", 1, "int32", "1", "bits",
     "bit k: camera k of the file's attribute 'cameras' sees this material point in this"
     " frame too; -1 background"),
)  # fmt: skip
LAYERS = {row[0]: Layer(*row) for row in _ROWS}

CHUNK = 256  # pixels per side
_LEVEL = 1
_WORKERS = min(8, os.cpu_count() or 1)

Index = tuple[int, int]
Tile = npt.NDArray[np.generic]


class ChunkedLayer:
    """A dataset (H, W) or (H, W, C) of which only the chunks that hold data are stored."""

    def __init__(self, group: h5py.Group, layer: Layer, shape: tuple[int, int]) -> None:
        tail = () if layer.components == 1 else (layer.components,)
        self._what = f"layer {layer.name!r}"
        self._dtype = np.dtype(layer.dtype)
        self._fill = np.array(layer.fill, self._dtype)
        self._shape = shape
        self._tail = tail
        self._more = "".join(f", {n}" for n in tail)
        # HDF5 takes no chunk that is larger than the dataset
        self._chunk = (min(CHUNK, shape[0]), min(CHUNK, shape[1]), *tail)
        self._stored: set[Index] = set()
        self._data = group.create_dataset(
            layer.name,
            shape=shape + tail,
            dtype=self._dtype,
            chunks=self._chunk,
            fillvalue=self._fill,
            compression="gzip",
            compression_opts=_LEVEL,
            shuffle=True,
        )
        self._data.attrs.update(
            unit=layer.unit, frame=layer.frame, convention=layer.convention, description=layer.text
        )

    def write_block(self, row0: int, col0: int, values: npt.NDArray[np.generic]) -> None:
        """Write a rectangle (h, w) or (h, w, C) at (``row0``, ``col0``)."""
        fits = values.ndim == 2 + len(self._tail) and values.shape[2:] == self._tail
        require(fits, self._what, f"block of shape {values.shape}", f"(h, w{self._more})")
        rows, cols = np.indices(values.shape[:2]).reshape(2, -1)
        self.write_sparse(rows + row0, cols + col0, values.reshape(-1, *self._tail))

    def write_sparse(
        self,
        rows: npt.NDArray[np.integer],
        cols: npt.NDArray[np.integer],
        values: npt.NDArray[np.generic],
    ) -> None:
        """Write single pixels; ``rows``, ``cols`` (M,), ``values`` (M,) or (M, C)."""
        count, (height, width) = rows.shape, self._shape
        fits = rows.ndim == 1 and cols.shape == count and values.shape == count + self._tail
        got = f"rows {rows.shape}, cols {cols.shape}, values {values.shape}"
        require(fits, self._what, got, f"(M,), (M,), (M{self._more})")
        whole = rows.dtype.kind in "iu" and cols.dtype.kind in "iu"
        require(whole, self._what, f"{rows.dtype}, {cols.dtype}", "integer pixels")
        if len(rows) == 0:
            return
        top, low, left, right = rows.min(), rows.max(), cols.min(), cols.max()
        inside = 0 <= top and low < height and 0 <= left and right < width
        got = f"rows {top}..{low}, columns {left}..{right}"
        require(inside, self._what, got, f"inside {height} x {width}")
        if (rows[1:] < rows[:-1]).any():  # else as `numpy.nonzero` has them: no sorting
            order = np.argsort(rows, kind="stable")  # stable: the last value of a pixel wins
            rows, cols, values = rows[order], cols[order], values[order]
        self._store(rows, cols, self._cast(values))

    def _cast(self, values: npt.NDArray[np.generic]) -> Tile:
        """Convert to the layer's dtype; refuse what would change: overflow, fractions as ids."""
        if values.dtype == self._dtype:
            return values
        require(values.dtype.kind in "iufb", self._what, values.dtype, "numbers")
        with np.errstate(over="ignore", invalid="ignore"):
            cast = values.astype(self._dtype)
        if self._dtype.kind == "f":
            faithful = np.array_equal(np.isfinite(cast), np.isfinite(values))
        else:
            faithful = np.array_equal(cast, values)
        what = f"{self._what}: values that {self._dtype} can't hold"
        require(faithful, what, values.dtype, f"{self._dtype}")
        return cast

    def _tiles(
        self, rows: npt.NDArray[np.integer], cols: npt.NDArray[np.integer], values: Tile
    ) -> Iterator[tuple[Index, Tile]]:
        """Pixels in the order of their rows, a row of chunks at a time."""
        across = -(-self._shape[1] // CHUNK)
        for chunk_row in range(int(rows[0]) // CHUNK, int(rows[-1]) // CHUNK + 1):
            r0 = chunk_row * CHUNK
            first, stop = np.searchsorted(rows, [r0, r0 + CHUNK])
            chunk_col = cols[first:stop] // CHUNK
            touched = np.flatnonzero(np.bincount(chunk_col, minlength=across))
            tiles = np.full((len(touched), *self._chunk), self._fill, self._dtype)
            for tile, column in zip(tiles, touched.tolist(), strict=True):
                if (chunk_row, column) in self._stored:
                    tile[...] = self._tile((chunk_row, column))
            place = np.zeros(across, np.int64)
            place[touched] = np.arange(len(touched))
            # one linear index: faster than three
            at = place[chunk_col] * self._chunk[0] + (rows[first:stop] - r0)
            at = at * self._chunk[1] + cols[first:stop] % CHUNK
            tiles.reshape(-1, *self._tail)[at] = values[first:stop]
            for tile, column in zip(tiles, touched.tolist(), strict=True):
                if (chunk_row, column) in self._stored or not self._is_fill(tile):
                    yield (chunk_row, column), tile

    def _is_fill(self, part: Tile) -> bool:
        if self._dtype.kind == "f":
            return bool(np.isnan(part).all())
        return bool((part == self._fill).all())

    def _tile(self, index: Index) -> Tile:
        """Return a whole chunk as it is now; the frame's border is padded."""
        tile = np.full(self._chunk, self._fill, self._dtype)
        if index in self._stored:
            r0, c0 = index[0] * CHUNK, index[1] * CHUNK
            now = self._data[r0 : r0 + CHUNK, c0 : c0 + CHUNK]
            tile[: now.shape[0], : now.shape[1]] = now
        return tile

    def _store(
        self, rows: npt.NDArray[np.integer], cols: npt.NDArray[np.integer], values: Tile
    ) -> None:
        tiles = self._tiles(rows, cols, values)
        while batch := list(islice(tiles, 8 * _WORKERS)):  # bounds the memory held at a time
            packed = _pool().map(_packed, [tile for _, tile in batch])
            for (index, _), data in zip(batch, packed, strict=True):
                offset = (index[0] * CHUNK, index[1] * CHUNK, *(0 for _ in self._tail))
                self._data.id.write_direct_chunk(offset, data)
                self._stored.add(index)


@cache
def _pool() -> ThreadPoolExecutor:
    """Threads that pack, kept: a frame's layers are some hundred small batches."""
    return ThreadPoolExecutor(_WORKERS, thread_name_prefix="gpusim.truth")


def _packed(tile: Tile) -> bytes:
    """Apply HDF5's shuffle filter (all first bytes, then all second bytes, …) and deflate."""
    planes = np.ascontiguousarray(tile.reshape(-1).view(np.uint8).reshape(-1, tile.itemsize).T)
    return zlib.compress(planes.data, _LEVEL)
