"""What is told of a flat plate seen square, and of what can be told apart."""

from __future__ import annotations

import numpy as np

from gpusim.optics.camera.pinhole import Camera
from gpusim.studies.budget.identifiability import PARAMETERS, alike, remarks, unseen_motion
from tests.support.shifted_plate import shifted_plate

SHIFT = (0.3, 0.0, 0.0)
ONE = {"camera": "left", "mm_per_px": 0.7}
PAIR = {"cameras": ["left", "right"], "calibration": "true"}


def test_flat_plate_seen_square_by_one_camera() -> None:
    motion, calibration = remarks(shifted_plate(SHIFT, ONE))
    assert "motion along the axis z" in motion and "isn't identifiable" in motion
    assert "limit 0.001" in motion and "5000 microstrain" in motion  # 1 mm of 200 mm
    assert "focal length and position along the axis; principal point across and position across" \
        in calibration  # fmt: skip
    assert remarks(shifted_plate(SHIFT, PAIR)) == []


def test_deep_targets_and_pairs_tell_all() -> None:
    """A plane has eight degrees of freedom in a picture, one less than a camera; a box has all."""
    lens = ((24.0, 16.0), 30.0, (600, 400))
    first = Camera.from_lens(*lens, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    x, y = (
        one.ravel() for one in np.meshgrid(np.linspace(-0.3, 0.3, 7), np.linspace(-0.2, 0.2, 7))
    )
    square, tilted, deep = (
        np.stack([x, y, z], axis=1) for z in (0.0 * x, 0.5 * x, 0.5 * np.cos(9 * x + 7 * y))
    )
    pairs = [{"focal length", "position along the axis"},
             {"principal point across", "position across"},
             {"principal point down", "position down"}]  # fmt: skip
    assert [set(one) for one in alike(first, square)[1]] == pairs
    least, ((*group,),) = alike(first, tilted)
    assert least < 1e-9 and set(group) < set(PARAMETERS)
    least, groups = alike(first, deep)
    assert least > 5e-3 and groups == []

    second = Camera.from_lens(*lens, (0.3, 0.0, 1.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    values, axes = unseen_motion([first], np.zeros(3))
    assert values[2] < 1e-6 * values[0] and abs(axes[2, 2]) > 1.0 - 1e-9
    values, _ = unseen_motion([first, second], np.zeros(3))
    # half the angle of 16.7 degrees between them: its tangent
    assert values[2] / values[0] > 0.1
