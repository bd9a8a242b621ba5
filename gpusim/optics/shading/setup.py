"""A view set up for shading: per-triangle coefficients, pattern tables and lamps, in float64.

The records that the device reads are made here, and the functions with which the NumPy twins
evaluate the same coefficients at pixels.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.camera.undistortion_table import distortion_map
from gpusim.optics.geometry.view import View
from gpusim.optics.light.lights import Light
from gpusim.optics.paint.bitmap import BITMAP, PIECES, BitmapTable, pieces_needed
from gpusim.optics.paint.checker_lines import matte_boards, within_fields
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.optics.paint.relief_normals import Bumps, bump_of
from gpusim.optics.shading.coefficients import (
    BLOCK,
    CoefficientCache,
    Coefficients,
    PerTriangle,
    coefficients,
)
from gpusim.optics.shading.lighting import Lighting
from gpusim.optics.shading.spectrum import (
    SpectralBand,
    indexed,
    is_coloured_scene,
    regions_in_band,
    spectral_bands,
)
from gpusim.surface.color import Color, in_band
from gpusim.surface.surface import Surface

__all__ = ["GRAZING", "TRIANGLE", "Setup", "footprint"]

Array = npt.NDArray[np.float64]
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
"""Which of a record's words are which of `Setup.planes`."""

REAL = slice(0, 14), slice(16, 22)  # words that may be beyond float32

GRAZING = 4
"""Added to the number of a group of triangles whose speckle is cut pixel by pixel."""


@dataclass(frozen=True, eq=False)
class Setup:
    """Per-triangle shading coefficients of a view, float64.

    ``planes`` (T, 6, 3): s, t, w and the three normal components as affine functions of (dx, dy,
    1), the offset from ``anchor`` (T, 2); ``cell`` (T, 2): the pattern cell that s and t are
    relative to; ``mean_inverse`` (T,): 1 / depth that w is relative to.

    ``bands``: of the spectrum, one where all is grey. Where something has a colour, ``table`` has
    numbers of colours in ``palette`` (n, 4), and ``lighting`` and ``background`` are the bands'
    mean (`gpusim.optics.shading.spectrum`).
    """

    view: View
    table: FeatureGrid
    bitmaps: BitmapTable
    lighting: Lighting
    background: float
    lit: bool
    bands: tuple[SpectralBand, ...]
    palette: npt.NDArray[np.float32] | None
    _found: CoefficientCache

    @staticmethod
    def build(
        view: View,
        lights: Sequence[Light] | None,
        background: Color,
        surfaces: Sequence[Surface] = (),
        device: Device | None = None,
    ) -> Setup:
        """Set up every triangle of ``view``; ``lights`` None shows the albedo itself.

        ``surfaces`` cast shadows and hide surroundings, which ``device`` looks at.
        """
        colored = is_coloured_scene([one.paint for one in view.paints], lights, background)
        regions = regions_in_band(view.paints, 0) if colored else view.paints
        table = FeatureGrid.build(regions, view.extent)
        bitmaps = BitmapTable.build(regions, table.paints)
        grey = [light.grey for light in lights] if colored and lights else lights
        lighting = Lighting.build(view, grey, surfaces, device)
        lit = lights is not None
        found = CoefficientCache(view, table, bitmaps, lit)
        behind = np.mean(background)
        own = SpectralBand(table, bitmaps, lighting, float(behind))
        bands: tuple[SpectralBand, ...] = (own,)
        palette = None
        if colored:
            bands = spectral_bands(own, view.paints, lights, background)
            table, palette = indexed(bands)
            bitmaps = replace(bitmaps, bands=tuple(band.bitmaps for band in bands))
        return Setup(view, table, bitmaps, lighting, own.background, lit, bands, palette, found)

    def program(self, name: str) -> str:
        """The name of a shader file that is compiled for as many bands as there are."""
        return name if self.palette is None else f"{name}@rgb"

    @cached_property
    def _near_and_albedo(self) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float32]]:
        view = self.view
        boards = matte_boards(view.paints, self.lighting.gloss)
        near = self.table.near_features(view, boards)
        albedo = np.take(self.table.paints["ground"], view.paint, mode="clip")
        for number in boards:
            within_fields(view, number, self.table.fields(number), near, albedo)
        return near, albedo

    @property
    def near_feature(self) -> npt.NDArray[np.bool_]:
        """(T,): whether a pixel in it can reach a feature of its pattern, or shows a bitmap."""
        return self._near_and_albedo[0]

    @property
    def albedo(self) -> npt.NDArray[np.float32]:
        """(T,): of what isn't near a feature."""
        return self._near_and_albedo[1]

    def _coefficients(self) -> Iterator[Coefficients]:
        return coefficients(self.view, self.table, self.bitmaps, self.lit)

    def of(self, triangles: npt.NDArray[np.int64]) -> PerTriangle:
        """The coefficients of some triangles (n,)."""
        return self._found.of(triangles)

    @property
    def planes(self) -> Array:
        """(T, 6, 3): s, t, w and the three normal components, affine in (dx, dy, 1)."""
        return self._found.all.planes

    @property
    def anchor(self) -> Array:
        """(T, 2): whole px of the ideal image."""
        return self._found.all.anchor

    @property
    def cell(self) -> npt.NDArray[np.int64]:
        """(T, 2): pattern cells."""
        return self._found.all.cell

    @property
    def mean_inverse(self) -> Array:
        """(T,): 1 / depth."""
        return self._found.all.mean_inverse

    def records(self) -> npt.NDArray[np.void]:
        """The triangles as the shader reads them."""
        result = np.zeros(max(self.view.count, 1), TRIANGLE)
        words = result.view(np.float32).reshape(len(result), -1)
        for first, block in self.record_blocks():
            words[first : first + len(block)] = block
        return result

    def record_blocks(self) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
        """The same block by block: the first triangle's number and words (n, 28), used again."""
        words = np.empty((BLOCK, TRIANGLE.itemsize // 4), np.float32)
        whole, rough, metallic, _ = self.traits().T
        block = np.zeros((words.shape[1], BLOCK), np.float32)
        for found in self._coefficients():
            part, paint = found.part, self.view.paint[found.part]
            columns = block[:, : len(paint)]
            for word, (row, k) in WORDS.items():
                if row < 3 or self.lit:
                    columns[word] = found.planes[row, k]
            columns[7], columns[11] = found.mean_inverse, self.albedo[part]
            columns[14:16].view(np.int32)[:] = found.anchor
            columns[22:24].view(np.int32)[:] = found.cell
            columns[24] = paint
            columns[25] = self.near_feature[part] * whole[paint]
            columns[26], columns[27] = rough[paint], metallic[paint]
            for words_of in REAL:
                bad = ~np.isfinite(columns[words_of])
                if bad.any():
                    self._refuse(int(np.argmax(bad.any(axis=0))), columns, part.start)
            np.copyto(words[: len(paint)], columns.T)
            yield part.start, words[: len(paint)]

    def traits(self) -> Array:
        """Per paint (n, 4): what "near a feature" counts, 2 where a pattern is one material with
        its ground; GGX alpha, 1 if matte; metallic; 0."""
        gloss, paints = self.lighting.gloss, self.table.paints
        result = np.zeros((len(paints), 4))
        result[:, 0], result[:, 1] = np.where(paints["featured"] > 1, 2.0, 1.0), 1.0
        if gloss is not None:
            result[:, 1], result[:, 2] = np.where(gloss.glossy, gloss.alpha, 1.0), gloss.metallic
        return result

    def _refuse(self, triangle: int, columns: npt.NDArray[np.float32], first: int) -> None:
        word = int(np.r_[REAL][np.argmin(np.isfinite(columns[np.r_[REAL], triangle]))])
        name = [n for n, (_, at, *_) in (TRIANGLE.fields or {}).items() if at <= 4 * word][-1]
        word //= 4
        raise InputError(
            f"render: triangle {first + triangle}, {name}: beyond float32; got "
            f"{columns[4 * word : 4 * word + 4, triangle].tolist()}; expected coordinates whose "
            "ratios to the distance stay below 1e38: choose another unit of length"
        )

    def rays(self) -> Array:
        """(3, 3): columns x, y, 1 of the world-space ray of unit depth through a pixel."""
        camera = self.view.camera
        result: Array = camera.camera_from_world[:3, :3].T @ camera.ray_matrix()
        return result

    @cached_property
    def _pattern_traits(self) -> tuple[bool, bool]:
        """Whether squares may be smaller than a pixel, and whether every disc is far larger."""
        fine, large = False, True
        for region, record in zip(self.view.paints, self.table.paints, strict=False):
            if record["featured"] == 1:
                features = in_band(region.paint, 0).features(region.low, region.high)
                assert features is not None
                patches = features.kind == 0
                # the footprint's extent along the axes of a turned patch
                angle = features.angle[patches]
                spread = 2.0 * region.reach * (np.abs(np.cos(angle)) + np.abs(np.sin(angle)))
                radius = features.size[features.kind == 1, 0]
                # region.reach bounds the half diagonal of every footprint from above
                large &= bool(radius.min(initial=np.inf) > 3.0 * region.reach)
                fine |= bool((spread > features.size[patches].min(axis=1)).any())
        return fine, large

    @cached_property
    def _bitmap_variant(self) -> int:
        """2 where a pixel may span so many texels that they are taken all at once, else 1."""
        rows = np.flatnonzero(self.groups == BITMAP)
        widest = 0.0
        for corner in range(3):
            at = self.view.screen[rows, corner]
            _, ex, ey, _ = footprint(self, rows, at[:, 0], at[:, 1])
            widest = max(widest, pieces_needed(ex, ey))
        # footprints change little more between the corners of a triangle
        return 2 if 1.2 * widest > PIECES else 1

    @cached_property
    def groups(self) -> npt.NDArray[np.uint32]:
        """(T,) what a triangle's pixels may meet: 0 one albedo, else its paint's ``featured``.

        That plus `GRAZING` where speckle has larger footprints than its table was made for.
        """
        groups = np.take(
            self.table.paints["featured"].astype(np.uint32), self.view.paint, mode="clip"
        )
        groups *= self.near_feature
        for number, region in enumerate(self.view.paints):
            if region.grazing:
                larger = self.view.footprint > region.reach
                groups[(self.view.paint == number) & larger] += np.uint32(GRAZING)
        return groups

    def groups_present(self) -> list[int]:
        """The different `groups` there are."""
        most = int(self.groups.max(initial=0))
        return [group for group in range(most + 1) if (self.groups == group).any()]

    @cached_property
    def bumps(self) -> Bumps | None:
        """The fine relief of the triangles, if some of them have any and light shows it."""
        if not self.lit or all(bump_of(region) is None for region in self.view.paints):
            return None
        return Bumps.build(self.view, self.anchor, self.mean_inverse)

    @cached_property
    def bumpy(self) -> npt.NDArray[np.bool_]:
        """(T,) whether a triangle has a fine relief."""
        return np.zeros(self.view.count, bool) if self.bumps is None else self.bumps.member

    @property
    def printed(self) -> npt.NDArray[np.bool_]:
        """(T,) whether a triangle is near a feature of a print without a relief."""
        result: npt.NDArray[np.bool_] = (self.groups == 1) & ~self.bumpy
        return result

    @cached_property
    def shiny(self) -> npt.NDArray[np.bool_]:
        """(T,) whether a triangle's paint is glossy and lit."""
        gloss = self.lighting.gloss
        if gloss is None or not self.lit:
            return np.zeros(self.view.count, bool)
        result: npt.NDArray[np.bool_] = gloss.glossy[self.view.paint]
        return result

    def light_constants(self, glossy: bool, bumpy: bool) -> dict[str, float]:
        """Override constants of how triangles are lit; whether some of them are ``glossy`` or
        ``bumpy``."""
        return {
            "distorted": float(self.view.camera.lens is not None),
            "aperture": self.view.camera.pixel_side,
            "bumpy": float(bumpy),
            **self.lighting.constants(glossy),
        }

    def constants(self, groups: Collection[int], glossy: bool, bumpy: bool) -> dict[str, float]:
        """Override constants that leave out of a shader what ``groups`` of triangles don't have.

        ``glossy`` and ``bumpy``: whether some of them have glossy paint, or a relief.
        """
        kept = set(groups)
        kinds = self.table.kinds() if 1 in groups else set()
        fine, large = self._pattern_traits if 1 in groups else (False, False)
        return {
            "lit": float(self.lit),
            "patterned": float(any(groups)),
            "speckle": float(bool({2, 2 + GRAZING} & kept) + 2 * bool({3, 3 + GRAZING} & kept)),
            "grazing": float(bool({2 + GRAZING, 3 + GRAZING} & kept)),
            **self.light_constants(glossy, bumpy),
            "checkers": float(0 in kinds),
            "discs": float((2 if large else 1) if 1 in kinds else 0),
            "sectors": float(2 in kinds),
            "fine": float(fine),
            "bitmaps": float(self._bitmap_variant if BITMAP in groups else 0),
        }

    def undistorted(self, at: Array) -> tuple[Array, Array]:
        """Ideal positions (n, 2) of image positions ``at`` (n, 2), and the change (n, 2, 2).

        Change [:, :, k]: a side of a pixel's sensitive square in pixels of the ideal image.
        """
        bends, side = distortion_map(self.view.camera), self.view.camera.pixel_side
        if bends is None:
            return at, np.broadcast_to(side * np.eye(2), (len(at), 2, 2))
        ideal, change = bends.ideal(at)
        return ideal, side * change


def footprint(
    setup: Setup, triangle: npt.NDArray[np.int64], x: Array, y: Array
) -> tuple[Array, Array, Array, Array]:
    """Paint position (n, 2) at pixel positions, its change along the sides of a pixel's sensitive
    square, each (n, 2), and the relative change (n, 2) of 1 / z along these.
    """
    ideal, change = setup.undistorted(np.stack([x, y], axis=1))
    own = setup.of(triangle)
    d, planes = ideal - own.anchor, own.planes
    values = planes[:, :3, 0] * d[:, :1] + planes[:, :3, 1] * d[:, 1:] + planes[:, :3, 2]
    w = values[:, 2:3]
    st = values[:, :2] / w
    ex = (planes[:, :2, 0] - st * planes[:, 2:3, 0]) / w
    ey = (planes[:, :2, 1] - st * planes[:, 2:3, 1]) / w
    turned = np.stack([ex, ey], axis=2) @ change
    q = np.einsum("ni,nik->nk", planes[:, 2, :2] / w, change)
    return st, turned[:, :, 0], turned[:, :, 1], q
