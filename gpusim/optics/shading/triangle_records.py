"""Triangles as the shader reads them: the coefficients and traits of each in float32."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Single
from gpusim.errors import InputError
from gpusim.optics.light.microfacet_material import Gloss
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.optics.shading.coefficients import BLOCK, coefficients
from gpusim.optics.shading.setup import Setup

TRIANGLE = np.dtype(
    [("n0", "<f4", 4), ("nx", "<f4", 4), ("ny", "<f4", 4), ("w", "<f4", 2), ("anchor", "<i4", 2),
     ("st", "<f4", 4), ("t", "<f4", 2), ("cell", "<i4", 2), ("more", "<f4", 4)]
)  # fmt: skip
"""Texels of four words: the first four are all that plain matte paint needs."""

WORDS = {
    0: (3, 2), 1: (4, 2), 2: (5, 2), 3: (2, 2), 4: (3, 0), 5: (4, 0), 6: (5, 0), 8: (3, 1),
    9: (4, 1), 10: (5, 1), 12: (2, 0), 13: (2, 1), 16: (0, 2), 17: (0, 0), 18: (0, 1), 19: (1, 2),
    20: (1, 0), 21: (1, 1),
}  # fmt: skip
"""Which of a record's words are which of ``planes``."""

REAL = slice(0, 14), slice(16, 22)  # words that may be beyond float32


def triangle_records(setup: Setup) -> npt.NDArray[np.void]:
    """All triangles of a view."""
    result = np.zeros(max(setup.view.count, 1), TRIANGLE)
    words = result.view(np.float32).reshape(len(result), -1)
    for first, block in record_blocks(setup):
        words[first : first + len(block)] = block
    return result


def record_blocks(setup: Setup) -> Iterator[tuple[int, Single]]:
    """The same block by block: the first triangle's number and words (n, 28), used again."""
    words = np.empty((BLOCK, TRIANGLE.itemsize // 4), np.float32)
    whole, rough, metallic, _ = paint_traits(setup.table, setup.lighting.gloss).T
    block = np.zeros((words.shape[1], BLOCK), np.float32)
    traits = setup.traits
    for chunk in coefficients(setup.view, setup.table, setup.bitmaps, setup.lit):
        part, paint = chunk.part, setup.view.paint[chunk.part]
        columns = block[:, : len(paint)]
        for word, (row, k) in WORDS.items():
            if row < 3 or setup.lit:
                columns[word] = chunk.planes[row, k]
        columns[7], columns[11] = chunk.mean_inverse, traits.albedo[part]
        columns[14:16].view(np.int32)[:] = chunk.anchor
        columns[22:24].view(np.int32)[:] = chunk.cell
        columns[24] = paint
        columns[25] = traits.near_feature[part] * whole[paint]
        columns[26], columns[27] = rough[paint], metallic[paint]
        for words_of in REAL:
            bad = ~np.isfinite(columns[words_of])
            if bad.any():
                _refuse(int(np.argmax(bad.any(axis=0))), columns, part.start)
        np.copyto(words[: len(paint)], columns.T)
        yield part.start, words[: len(paint)]


def paint_traits(table: FeatureGrid, gloss: Gloss | None) -> Float:
    """Per paint (n, 4): what "near a feature" counts, 2 where a pattern is one material with
    its ground; GGX alpha, 1 if matte; metallic; 0."""
    paints = table.paints
    result = np.zeros((len(paints), 4))
    result[:, 0], result[:, 1] = np.where(paints["featured"] > 1, 2.0, 1.0), 1.0
    if gloss is not None:
        result[:, 1], result[:, 2] = np.where(gloss.glossy, gloss.alpha, 1.0), gloss.metallic
    return result


def _refuse(triangle: int, columns: Single, first: int) -> None:
    word = int(np.r_[REAL][np.argmin(np.isfinite(columns[np.r_[REAL], triangle]))])
    name = [n for n, (_, at, *_) in (TRIANGLE.fields or {}).items() if at <= 4 * word][-1]
    word //= 4
    raise InputError(
        f"render: triangle {first + triangle}, {name}: beyond float32; got "
        f"{columns[4 * word : 4 * word + 4, triangle].tolist()}; expected coordinates whose "
        "ratios to the distance stay below 1e38: choose another unit of length"
    )
