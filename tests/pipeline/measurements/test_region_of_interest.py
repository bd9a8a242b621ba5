"""Which pixels are measured: paints, selections, polygons."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.path import Path

from gpusim.errors import InputError
from gpusim.pipeline.measurements.region_of_interest import inside_polygon, region_of_interest
from gpusim.scene.description import model as m
from tests.support.moved_block import moved_block


def still(points: np.ndarray) -> np.ndarray:
    return np.zeros_like(points)


def region(**keys: Any) -> m.RegionTable:
    return m.RegionTable.model_validate(keys)


def x_mm(region: m.RegionTable | None, **changes: object) -> np.ndarray:
    """The places along x, mm, of what the pixels see."""
    _, motion = moved_block(still, **changes)
    roi = region_of_interest("measure 'dic'", region, motion, "front")
    assert roi.mask.shape == (190, 317) and len(roi.points) == roi.mask.sum()
    image = roi.image(motion.position(roi.points, 0))
    assert np.array_equal(np.isfinite(image[..., 0]), roi.mask)
    return 1e3 * image[roi.mask][:, 0]


def test_speckle_is_measured_by_default_else_bodies() -> None:
    speckled = x_mm(None)
    assert 20.0 <= speckled.min() < 20.5 and speckled.max() > 59.5
    scene, _ = moved_block(still)
    plain = {**scene.document["body"][0], "paint": scene.document["body"][0]["paint"][:1]}
    assert x_mm(None, body=[plain]).min() < 0.5


def test_paint_selection_and_polygons_hold_together() -> None:
    grey = x_mm(region(paint="grey", where=dict(normal="-y")))
    assert grey.min() < 0.5 and 19.5 < grey.max() <= 20.0
    chosen = x_mm(region(where=dict(normal="-y", x_max_mm=30.0)))
    assert 29.5 < chosen.max() <= 30.0
    corners = [[21.0, 0.0, 1.0], [33.0, 0.0, 1.0], [33.0, 0.0, 30.0], [21.0, 0.0, 30.0]]
    inside = x_mm(region(polygon_mm=corners, paint="speckle"))
    assert 21.0 <= inside.min() < 21.4 and 32.6 < inside.max() <= 33.0
    assert x_mm(region(paint="white")).min() < -10.0


def test_a_region_without_pixels_is_refused() -> None:
    _, motion = moved_block(still)
    far = region(polygon_px=[[500.0, 5.0], [600.0, 5.0], [550.0, 50.0]])
    with pytest.raises(InputError, match=r"measure 'dic': roi; got no pixel of camera 'front'"):
        region_of_interest("measure 'dic'", far, motion, "front")
    with pytest.raises(InputError, match="x_max_mm"):
        nowhere = region(where=dict(x_max_mm=-3.0))
        region_of_interest("measure 'dic'", nowhere, motion, "front")
    behind = region(polygon_mm=[[0.0, -200.0, 0.0], [9.0, -200.0, 0.0], [9.0, 0.0, 9.0]])
    with pytest.raises(InputError, match="polygon_mm; got a corner behind camera 'front'"):
        region_of_interest("measure 'dic'", behind, motion, "front")


def test_polygons_are_those_of_the_plane() -> None:
    star = np.array([[5.2, 3.1], [48.7, 12.4], [20.3, 15.9], [51.1, 30.8], [-7.4, 25.5]])
    row, column = np.indices((33, 57)).reshape(2, -1)
    inside = Path(star).contains_points(np.stack([column, row], axis=1))
    assert 200 < inside.sum() < 1200
    assert np.array_equal(inside_polygon((33, 57), star).ravel(), inside)
