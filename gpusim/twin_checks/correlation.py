"""The correlation of subsets against NumPy."""

from __future__ import annotations

import numpy as np

from gpusim.gpu import Device, compare, twin_check
from gpusim.measure.correlation.icgn import correlate, correlate_numpy
from gpusim.measure.correlation.image_pair import Pair, Subsets
from gpusim.measure.correlation.matching import Settings, Status
from gpusim.measure.correlation.warp import SHAPES
from gpusim.measure.images import FloatArray, SplineImage


@twin_check("measure/correlation/icgn")
def _icgn(device: Device) -> None:
    """Subsets of a smooth pattern that is stretched, turned and shifted; every shape."""
    row, column = np.indices((57, 83), dtype=np.float64)

    def pattern(x: FloatArray, y: FloatArray) -> FloatArray:
        result: FloatArray = (
            np.sin(0.61 * x + 0.2 * y) + np.sin(0.17 * x - 0.73 * y) + np.sin(0.4 * x + 0.5 * y)
        )
        return result

    reference = SplineImage.from_image(pattern(column, row))
    deformed = SplineImage.from_image(
        0.6 * pattern(0.99 * column - 0.02 * row + 0.7, 0.01 * column + 1.01 * row - 0.4) + 3.0
    )
    points = np.array([[20.3, 21.8], [41.0, 30.5], [60.7, 35.2], [4.0, 30.0], [41.0, 55.0]])
    subsets = Subsets(Pair(reference, deformed), points, np.zeros((5, 2, 6)))
    for shape in SHAPES:
        settings = Settings(np.ones((21, 21)), shape, min_zncc=0.0)
        got, want = correlate(subsets, settings, device), correlate_numpy(subsets, settings)
        compare(f"measure/correlation/icgn.{shape}.status", got.status, want.status, "exact")
        good = want.status == Status.OK
        compare(
            f"measure/correlation/icgn.{shape}.coefficients",
            got.coefficients[good],
            want.coefficients[good],
            atol=2e-5,  # px: float32 sums; a step more or less at the stopping threshold
            rtol=0.0,
        )
        compare(
            f"measure/correlation/icgn.{shape}.zncc",
            got.zncc[good],
            want.zncc[good],
            atol=2e-6,
            rtol=0.0,
        )
