"""Where a subset went, to the nearest pixel: normalised cross-correlation over a search square."""

from __future__ import annotations

import cv2
import numpy as np

from gpusim.measure.images import FloatArray, Image

__all__ = ["integer_search", "search_template"]

LOWEST = 0.7  # score over the best one that a peak as good may have between two pixels
EQUAL_PEAK = 0.03  # less correlation than the best peak: as good


def search_template(
    template: FloatArray, image: Image, centre: tuple[int, int], search_px: int
) -> tuple[int, int, float]:
    """Find ``template`` (S, S), S odd, in ``image`` around the pixel ``centre`` = (x, y).

    Of places that fit alike, as those of a grid do, the one nearest to ``centre`` is taken.
    Returns the pixel (x, y) on which the template's centre fits best and the correlation
    coefficient there; -1 where the search square holds no place for the template or no texture.
    """
    half = template.shape[0] // 2
    height, width = image.shape
    x0, x1 = max(centre[0] - search_px - half, 0), min(centre[0] + search_px + half, width - 1)
    y0, y1 = max(centre[1] - search_px - half, 0), min(centre[1] + search_px + half, height - 1)
    if x1 - x0 < 2 * half or y1 - y0 < 2 * half:
        return centre[0], centre[1], -1.0
    area = image[y0 : y1 + 1, x0 : x1 + 1].astype(np.float64)
    span = float(np.ptp(area))
    spread = float(np.ptp(template))
    if not (span > 0 and spread > 0):
        return centre[0], centre[1], -1.0
    # grey range 1 around 0: the float32 sums of matchTemplate then keep 16-bit contrast
    score = cv2.matchTemplate(
        ((area - area.mean()) / span).astype(np.float32),
        ((template - template.mean()) / spread).astype(np.float32),
        cv2.TM_CCOEFF_NORMED,
    )
    score = np.where(np.isfinite(score) & (np.abs(score) <= 1.001), score, -1.0)
    row, column = _nearest_peak(score, (centre[1] - y0 - half, centre[0] - x0 - half))
    return x0 + half + int(column), y0 + half + int(row), float(score[row, column])


def _nearest_peak(score: FloatArray, centre: tuple[int, int]) -> tuple[int, int]:
    """Row and column of the best score, or of a peak as good that is nearer to ``centre``.

    Peaks are compared by the heights of parabolas through them: between two pixels they look lower.
    """
    best = np.unravel_index(int(np.argmax(score)), score.shape)
    top = float(score[best])
    highest = cv2.dilate(score, np.ones((3, 3), dtype=np.uint8))
    rows, columns = np.nonzero((score >= highest) & (score > LOWEST * top))
    if top <= 0 or rows.size < 2:
        return int(best[0]), int(best[1])
    height = score[rows, columns].astype(np.float64)
    wide = np.pad(score.astype(np.float64), 1, mode="edge")
    middle = height.copy()
    for down, across in ((1, 0), (0, 1)):
        before = wide[rows + 1 - down, columns + 1 - across]
        after = wide[rows + 1 + down, columns + 1 + across]
        bend = 2.0 * middle - before - after
        height += np.where(bend > 0, (after - before) ** 2 / (8.0 * np.maximum(bend, 1e-12)), 0.0)
    alike = height >= height.max() - EQUAL_PEAK
    away = np.hypot(rows - centre[0], columns - centre[1])
    chosen = int(np.argmin(np.where(alike, away, np.inf)))
    return int(rows[chosen]), int(columns[chosen])


def integer_search(
    reference: Image,
    deformed: Image,
    points: FloatArray,
    guess: FloatArray,
    half: int,
    search_px: int,
) -> tuple[FloatArray, FloatArray]:
    """Displacements (M, 2) to whole pixels near ``guess`` (M, 2), and their scores (M,).

    Points whose subset leaves the reference image score -1 and keep their guess.
    """
    displacement = guess.copy()
    score = np.full(points.shape[0], -1.0)
    height, width = reference.shape
    for i, (x, y) in enumerate(points):
        column, row = round(float(x)), round(float(y))
        if not (half <= column < width - half and half <= row < height - half):
            continue
        template = reference[row - half : row + half + 1, column - half : column + half + 1]
        target = (column + round(float(guess[i, 0])), row + round(float(guess[i, 1])))
        found = search_template(template.astype(np.float64), deformed, target, search_px)
        displacement[i] = found[0] - column, found[1] - row
        score[i] = found[2]
    return displacement, score
