"""Subsets across the edge of a moving body: no number, or one that belongs to a body."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import DicResult, Status, dic
from tests.support.measure_images import Waves

WIDTH, HEIGHT, EDGE, HALF = 161, 103, 80.0, 12
MOTION = np.array([2.3, -1.1])
ROI = (0, 4, WIDTH - 6, HEIGHT - 1)  # what stays in the image


def pictures(textured: bool, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A body right of EDGE moves over a background that stays; its edge is 3 px soft."""
    y, x = np.indices((HEIGHT, WIDTH), dtype=np.float64)
    back = Waves(51).at(x, y) if textured else np.full(x.shape, 30.0)
    rng = np.random.default_rng(2)
    images = []
    for u, v in ((0.0, 0.0), MOTION):
        own = 0.5 + 0.5 * np.tanh((x - u - EDGE) / 1.5)
        image = own * Waves(1).at(x - u, y - v) + (1.0 - own) * back
        images.append(image + noise * rng.normal(size=x.shape))
    return images[0], images[1]


def errors(result: DicResult) -> np.ndarray:
    """Distance from the motion of the body or of the background, whichever is nearer, px."""
    away = [np.abs(result.displacement - motion).max(axis=1) for motion in (MOTION, np.zeros(2))]
    return np.minimum(*away)[result.ok]


@pytest.mark.parametrize("noise", [0.0, 4.0])
def test_a_subset_that_sees_two_motions_is_incoherent(noise: float) -> None:
    first, second = pictures(True, noise)
    result = dic(first, second, subset=2 * HALF + 1, step=5, roi=ROI)
    blind = dic(first, second, subset=2 * HALF + 1, step=5, roi=ROI, apart_px=np.inf)
    x = result.points[:, 0]
    alone = np.abs(x - EDGE) > HALF + 4
    assert blind.ok.mean() >= 0.95
    assert (errors(blind) > 0.2).mean() >= 0.08
    assert result.ok[alone].all()
    assert (errors(result) > 0.2).mean() <= 0.005
    assert (result.status[np.abs(x - EDGE) < 6] == Status.INCOHERENT).mean() >= 0.95


def test_a_point_beside_the_texture_is_not_extrapolated() -> None:
    first, second = np.clip(np.rint(pictures(False)), 0, 255).astype(np.uint8)
    result = dic(first, second, subset=2 * HALF + 1, step=3, roi=ROI)
    x = result.points[:, 0]
    assert (result.status[x + HALF < EDGE] == Status.NO_TEXTURE).all()
    assert result.ok[x > EDGE].mean() >= 0.95
    assert np.abs(result.displacement[result.ok] - MOTION).max() <= 0.1


def test_the_limit_is_checked() -> None:
    image = Waves().at(*np.indices((41, 57), dtype=np.float64))
    with pytest.raises(InputError, match="apart_px"):
        dic(image, image, subset=15, apart_px=float("nan"))
