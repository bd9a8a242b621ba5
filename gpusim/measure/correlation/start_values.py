"""Where correlation starts: from subsets found to the nearest pixel, or large motion of features.

A subset is searched by normalised cross-correlation over a square. Or SIFT keypoints of both images
are matched, and affine motions that many matches agree on are taken one after the other (RANSAC):
so hundreds of pixels, any rotation and several bodies moving differently are found without a
search.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Float, Single
from gpusim.measure.images import Image
from gpusim.parallel.threads import shared

LOWEST = 0.7  # score over the best one that a peak as good may have between two pixels
EQUAL_PEAK = 0.03  # less correlation than the best peak: as good
MAX_SIFT_SIDE = 2_000_000  # px: larger images are looked at in a smaller copy
FEATURES = 5000
RATIO = 0.8  # best over second-best descriptor distance (Lowe 2004)
MODELS = 6
MIN_MATCHES = 10  # matches that make a motion
INLIER_PX = 0.008  # of the image diagonal: how far matches of one motion may differ from it
NEIGHBOURS = 5
TOGETHER = 16  # points that a thread searches one after the other


def search_template(
    template: Float, image: Image, centre: tuple[int, int], search_px: int
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


def _nearest_peak(score: Float, centre: tuple[int, int]) -> tuple[int, int]:
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
    points: Float,
    guess: Float,
    half: int,
    search_px: int,
) -> tuple[Float, Float]:
    """Displacements (M, 2) to whole pixels near ``guess`` (M, 2), and their scores (M,).

    Points whose subset leaves the reference image score -1 and keep their guess.
    """
    displacement = guess.copy()
    score = np.full(points.shape[0], -1.0)
    height, width = reference.shape

    def search(first: int) -> None:
        for i in range(first, min(first + TOGETHER, len(points))):
            column, row = np.rint(points[i]).astype(int).tolist()
            if not (half <= column < width - half and half <= row < height - half):
                continue
            template = reference[row - half : row + half + 1, column - half : column + half + 1]
            target = (column + round(float(guess[i, 0])), row + round(float(guess[i, 1])))
            best = search_template(template.astype(np.float64), deformed, target, search_px)
            displacement[i] = best[0] - column, best[1] - row
            score[i] = best[2]

    shared(search, range(0, len(points), TOGETHER))
    return displacement, score


@dataclass(frozen=True)
class Motion:
    """Matches that move together.

    points, displacement : (K, 2) float64, px.
    matrix : (2, 2) float64, displacement gradient of the affine motion through them.
    offset : (2,) float64, its displacement at the origin, px.
    """

    points: Float
    displacement: Float
    matrix: Float
    offset: Float

    def at(self, points: Float) -> tuple[Float, Float]:
        """Displacements (M, 2) at ``points`` and the distance (M,) to the nearest match, px.

        The affine motion, corrected by what the nearest matches differ from it (median).
        """
        number = min(NEIGHBOURS, len(self.points))
        apart, near = scipy.spatial.cKDTree(self.points).query(points, k=number)
        rest = self.displacement - self.points @ self.matrix.T - self.offset
        correction = np.median(rest[np.asarray(near).reshape(len(points), -1)], axis=1)
        distance = np.asarray(apart, dtype=np.float64).reshape(len(points), -1)[:, 0]
        return points @ self.matrix.T + self.offset + correction, distance


def feature_motions(reference: Image, deformed: Image) -> list[Motion]:
    """The affine motions seen in two images, those with most matches first."""
    return common_motions(*feature_matches(reference, deformed), float(np.hypot(*reference.shape)))


def common_motions(points: Float, moved: Float, diagonal: float) -> list[Motion]:
    """The affine motions that many of the matches (K, 2), (K, 2) agree on.

    ``diagonal`` of the image, px: matches of one motion may differ from it by 0.8 % of that.
    """
    motions: list[Motion] = []
    threshold = max(2.0, INLIER_PX * diagonal)
    for _ in range(MODELS):
        if len(points) < MIN_MATCHES:
            break
        affine, inlier_mask = cv2.estimateAffine2D(
            points, moved, method=cv2.RANSAC, ransacReprojThreshold=threshold, maxIters=4000
        )
        if affine is None or inlier_mask is None:
            break
        inliers = np.asarray(inlier_mask).ravel().astype(bool)
        matrix = np.asarray(affine, dtype=np.float64)
        stretch = np.linalg.svd(matrix[:, :2], compute_uv=False)
        if inliers.sum() < MIN_MATCHES:
            break
        if 0.3 < stretch[1] and stretch[0] < 3.0 and np.linalg.det(matrix[:, :2]) > 0:
            motions.append(
                Motion(
                    points[inliers],
                    (moved - points)[inliers],
                    matrix[:, :2] - np.eye(2),
                    matrix[:, 2],
                )
            )
        points, moved = points[~inliers], moved[~inliers]
    return motions


def feature_matches(reference: Image, deformed: Image) -> tuple[Float, Float]:
    """Positions (K, 2) of matched features in both images, px; each the other's best match."""
    first, second = _keypoints(reference), _keypoints(deformed)
    none = np.zeros((0, 2))
    if len(first[0]) < MIN_MATCHES or len(second[0]) < MIN_MATCHES:
        return none, none
    # descriptors are whole numbers below 256: float32 holds squares of their distances exactly
    square = first[1] @ second[1].T
    square *= -2.0
    square += np.sum(second[1] ** 2, axis=1)
    square += np.sum(first[1] ** 2, axis=1)[:, None]
    row, nearest, back = np.arange(len(square)), square.argmin(axis=1), square.argmin(axis=0)
    least = square[row, nearest]
    square[row, nearest] = np.inf
    clear = np.sqrt(least) < np.float64(RATIO) * np.sqrt(square.min(axis=1))
    i = row[clear & (back[nearest] == row)]
    return first[0][i], second[0][nearest[i]]


def global_shift(reference: Image, deformed: Image) -> Float:
    """The translation (2,) that most of the picture made, to whole pixels (phase correlation)."""
    height = max(reference.shape[0], deformed.shape[0])
    width = max(reference.shape[1], deformed.shape[1])
    parts = []
    for image in (reference, deformed):
        small = _eight_bit(image).astype(np.float32)
        small -= small.mean()
        wide = np.zeros((height, width), dtype=np.float32)
        window = np.outer(np.hanning(small.shape[0]), np.hanning(small.shape[1]))
        wide[: small.shape[0], : small.shape[1]] = small * window
        parts.append(wide)
    shift, _ = cv2.phaseCorrelate(parts[0], parts[1])
    return np.rint(np.asarray(shift, dtype=np.float64))


def _keypoints(image: Image) -> tuple[Float, Single]:
    """Positions (K, 2) and descriptors (K, 128)."""
    scale = min(1.0, float(np.sqrt(MAX_SIFT_SIDE / image.size)))
    grey = _eight_bit(image)
    if scale < 1.0:
        small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        grey = np.asarray(small, dtype=np.uint8)
    points, descriptors = cv2.SIFT.create(nfeatures=FEATURES).detectAndCompute(grey, None)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), dtype=np.float32)
    place = np.array([p.pt for p in points], dtype=np.float64)
    ratio = np.array([image.shape[1] / grey.shape[1], image.shape[0] / grey.shape[0]])
    return (place + 0.5) * ratio - 0.5, np.asarray(descriptors, dtype=np.float32)


def _eight_bit(image: Image) -> npt.NDArray[np.uint8]:
    """Stretch the grey values to 8 bits, leaving out half a percent at both ends."""
    step = max(1, image.size // 200_000)
    low, high = np.quantile(image.ravel()[::step].astype(np.float64), [0.005, 0.995])
    span = float(high - low) or 1.0
    grey = np.clip((image.astype(np.float32) - low) * (255.0 / span), 0, 255)
    return np.asarray(grey.astype(np.uint8))
