"""The highest of values over windows of cells."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.optics.windows import Windows


@pytest.mark.parametrize("shape", [(37, 90), (1, 64), (5, 1), (64, 64)])
def test_highest_of_windows(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(6)
    rows, columns = shape
    values = np.where(rng.random(shape) < 0.2, -np.inf, rng.normal(size=shape))
    first = np.stack([rng.integers(0, columns, 800), rng.integers(0, rows, 800)])
    last = first + rng.integers(-1, 60, (2, 800))
    last = np.minimum(last, [[columns - 1], [rows - 1]])
    want = [
        values[y : v + 1, x : u + 1].max(initial=-np.inf)
        for (x, y), (u, v) in zip(first.T, last.T, strict=True)
    ]
    windows = Windows(values)
    assert (windows.highest(first, last) == want).all()
    assert np.isfinite(want).sum() > 50 and (last < first).any()
    # one value changed is seen by the windows that it was the highest of
    at = np.unravel_index(int(np.argmax(values)), shape)
    values[at] = -5.0
    assert (Windows(values).highest(first, last) != want).any()
