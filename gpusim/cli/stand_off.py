"""Whether the lengths of a stereo rig look like millimetres: what it measured from how far off."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gpusim.measure import CalibratedCamera, StereoResult

__all__ = ["stand_off_warnings"]

NEAREST, FURTHEST = 5.0, 1e6  # mm: a microscope's object is further, a bridge nearer
LEAST_BASELINE = 0.5  # mm


def stand_off_warnings(
    calibration: Path, cameras: Sequence[CalibratedCamera], results: Sequence[StereoResult]
) -> list[str]:
    """One line if the rig's cameras or what they saw are implausibly near or far; else none.

    Lengths of the ``cameras`` and ``results`` are mm, by the unit of the file ``calibration``.
    """
    depths = [result.shape[result.ok, 2] for result in results]
    depth = float(np.median(np.concatenate(depths))) if any(map(len, depths)) else np.nan
    baseline = float(np.linalg.norm(cameras[1].camera_from_rig[:3, 3]))
    plausible = baseline >= LEAST_BASELINE and not (depth < NEAREST or depth > FURTHEST)
    if plausible:
        return []
    away = f"what they see is {depth:.3g} mm away" if np.isfinite(depth) else "nothing was measured"
    return [
        f"{calibration}: its cameras are {baseline:.3g} mm apart and {away}: the unit of its "
        "lengths looks wrong; say it with --calibration-unit"
    ]
