"""Boards that look the same when turned, seen by rigs with a camera on its head."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpusim.errors import GpusimError
from gpusim.measure import Chessboard, Sighting, calibrate
from tests.support.target_images import PointRig, seen_poses, stereo_rig


def rig_on_its_head() -> PointRig:
    rig = stereo_rig()
    second = rig.pose[1].copy()
    second[:3] = Rotation.from_euler("z", 180, degrees=True).as_matrix() @ second[:3]
    return replace(rig, pose=(rig.pose[0], second))


def as_found(board: Chessboard, sighting: Sighting, quarter: int) -> Sighting:
    """A board that begins at another corner: the first one in the picture, as detectors give it."""
    across, down = board.corners
    grid = sighting.board.reshape(down, across, 3)
    image = sighting.image.reshape(down, across, 2)
    return replace(sighting, board=grid.reshape(-1, 3), turns=board.turns,
                   image=np.rot90(image, quarter).reshape(-1, 2))  # fmt: skip


@pytest.mark.parametrize(("board", "quarter"), [
    (Chessboard(8, 6, 40.0), 2), (Chessboard(8, 8, 40.0), 2), (Chessboard(7, 7, 40.0), 3)
])  # fmt: skip
def test_a_camera_on_its_head(board: Chessboard, quarter: int) -> None:
    rig = rig_on_its_head()
    seen = rig.sightings(board, seen_poses(8, 3), 0.02, 5)
    second = [as_found(board, s, quarter if v != 3 else 0) for v, s in enumerate(seen["camera-1"])]
    first = [replace(s, turns=board.turns) for s in seen["camera-0"]]
    found = calibrate({"camera-0": first, "camera-1": second})
    length, sigma = found.baseline()
    assert abs(length - np.linalg.norm(rig.pose[1][:3, 3])) <= 4 * sigma and sigma <= 0.2
    assert found.rms <= 0.035 and found.outliers == 0
    unturned = {k: [replace(s, turns=None) for s in v]
                for k, v in (("a", first), ("b", second))}  # fmt: skip
    with suppress(GpusimError):  # either not settled, or with views left out and wrong
        wrong = calibrate(unturned)
        assert abs(wrong.baseline()[0] - length) >= 1.0
    assert board.turns is not None and Chessboard(9, 6, 40.0).turns is None
