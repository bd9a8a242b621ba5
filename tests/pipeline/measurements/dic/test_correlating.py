"""Where points are put in a region."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.pipeline.measurements.dic.correlating import points_within
from gpusim.scene.description import model as m


def spec(**keys: object) -> m.DicTable:
    table = {"name": "field", "type": "dic", "camera": "left", "subset_px": 11, "step_px": 7}
    return m.DicTable.model_validate(table | keys)


def test_points_are_on_a_grid_in_the_region_with_whole_subsets() -> None:
    row, column = np.indices((57, 83))
    mask = (row > 2) & (column + 2 * row < 120) & (column > 20)
    points = points_within("measure 'field'", mask, spec())
    x, y = points.astype(int).T
    assert len(points) > 30 and mask[y, x].all()
    for places, size in ((x, 83), (y, 57)):
        assert places.min() >= 5 and places.max() <= size - 6
        assert set(np.diff(np.unique(places))) == {7}
    # none is left out whose subset is half in the region
    grid = np.array([[a, b] for b in np.unique(y) for a in np.unique(x)])
    whole = [mask[b - 5 : b + 6, a - 5 : a + 6].mean() >= 0.5 for a, b in grid]
    assert (mask[grid[:, 1], grid[:, 0]] & whole).sum() == len(points) < mask[y, :].sum()


@pytest.mark.parametrize("mask", [np.zeros((30, 40), bool), np.ones((9, 40), bool)])
def test_a_region_without_room_is_refused(mask: np.ndarray) -> None:
    with pytest.raises(InputError, match="measure 'field': roi; got a region without room for a"):
        points_within("measure 'field'", mask, spec())
