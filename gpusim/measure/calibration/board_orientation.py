"""Boards that look the same when they are turned: which way round each camera of a rig saw them.

A camera on its head, or one that happens to begin at another corner, gives such a board's corners
other places than its neighbours do. In a single view both readings fit. But cameras stand the same
way to each other in all views, and with a wrong reading they don't, as soon as the board is tilted
differently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpusim.measure.calibration.bundle_adjustment import compose, inverse, rotation
from gpusim.measure.images import FloatArray
from gpusim.measure.targets.boards import Sighting

__all__ = ["best_turns", "turned", "turned_pose"]

MIN_RATIO = 3.0  # times as far apart as with the best readings: the others are wrong
MIN_DISTANCE = 1e-9


def turned(sighting: Sighting, quarter: int) -> Sighting:
    """The sighting with its board turned by so many quarters about its middle."""
    assert sighting.turns is not None
    # a pose that first turns the board leaves its points where they were
    pose = _turn(sighting.turns.middle, -quarter)
    return replace(sighting, board=sighting.board @ rotation(pose).T + pose[3:])


def turned_pose(pose: FloatArray, sighting: Sighting, quarter: int) -> FloatArray:
    """The pose (6,) that goes with `turned`."""
    assert sighting.turns is not None
    return compose(_turn(sighting.turns.middle, quarter), pose)


def best_turns(
    first: Sequence[FloatArray], second: Sequence[FloatArray], sightings: Sequence[Sighting]
) -> list[int]:
    """By how many quarters each of the ``sightings`` of a second camera is to be turned.

    ``first``, ``second``: per view the board's pose (6,) for two cameras, from the board to the
    camera. No turn where the views don't tell.
    """
    symmetry = next((s.turns for s in sightings if s.turns is not None), None)
    if symmetry is None or len(first) < 2:
        return [0] * len(first)
    quarters = range(0, 4, 1 if symmetry.square else 2)
    between = np.array(
        [
            [
                _flat(compose(inverse(one), compose(_turn(symmetry.middle, q), two)))
                for q in quarters
            ]
            for one, two in zip(first, second, strict=True)
        ]
    )  # (V, turns, 12)
    size = float(np.median(np.linalg.norm(between[..., 9:], axis=-1)))
    between[..., 9:] /= max(size, 1e-30)
    views = len(between)
    # every reading of every view proposes how the cameras stand to each other
    proposed = between.reshape(-1, 12)
    apart = np.linalg.norm(between[None] - proposed[:, None, None], axis=-1)
    choice = apart.argmin(axis=2)  # (proposals, V)
    score = apart.min(axis=2).sum(axis=1)
    best = int(score.argmin())
    others = (choice != choice[best]).all(axis=1)
    if others.any() and not score[others].min() > MIN_RATIO * score[best] + MIN_DISTANCE * views:
        return [0] * views
    return [list(quarters)[k] for k in choice[best]]


def _turn(middle: tuple[float, float], quarter: int) -> FloatArray:
    """The pose (6,) that turns a board about its middle."""
    pose = np.zeros(6)
    pose[2] = 0.5 * np.pi * quarter
    place = np.array([*middle, 0.0])
    pose[3:] = place - rotation(pose) @ place
    return pose


def _flat(pose: FloatArray) -> FloatArray:
    return np.concatenate([rotation(pose).ravel(), pose[3:]])
