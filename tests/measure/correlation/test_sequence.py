"""Series of images: references that follow a motion too large for one."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import Status, dic, dic_sequence
from tests.support.measure_images import speckles

SIZE = {"width": 171, "height": 131, "sigma": 1.8, "density": 0.025}
CENTRE = np.array([85.0, 65.0])


def gradient(step: int) -> np.ndarray:
    """Stretched by 18 % a step along x, thinner along y, and turned."""
    stretch = np.diag([1 + 0.18 * step, 1 - 0.05 * step])
    turn = np.deg2rad(9.0 * step)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return rotation @ stretch - np.eye(2)


def image(step: int) -> np.ndarray:
    matrix = gradient(step)
    nested = ((matrix[0, 0], matrix[0, 1]), (matrix[1, 0], matrix[1, 1]))
    return speckles(**SIZE, gradient=nested)


POINTS = np.array([[x, y] for y in (50.0, 58.0, 66.0, 74.0) for x in range(61, 112, 8)])


def test_a_reference_that_follows_sees_what_one_alone_loses() -> None:
    images = [image(step) for step in range(6)]
    options = {"subset": 21, "points": POINTS, "min_zncc": 0.9}
    seen: list[int] = []
    results = dic_sequence(
        images[0],
        iter(images[1:]),
        update="auto",
        update_zncc=0.97,
        progress=lambda number, _: seen.append(number),
        **options,
    )
    assert seen == [0, 1, 2, 3, 4]
    for step, result in enumerate(results, start=1):
        truth = (POINTS - CENTRE) @ gradient(step).T
        assert result.ok.mean() >= 0.95
        assert np.array_equal(result.points, POINTS)
        assert np.abs(result.displacement - truth)[result.ok].max() <= 0.05
        assert np.abs(result.gradient - gradient(step))[result.ok].max() <= 0.02
    # the last one measured at once, without knowing where: not with that correlation
    alone = dic(images[0], images[-1], search_px=10, **options)
    assert not alone.ok.mean() >= 0.5
    # uncertainties add up over the updates
    assert np.nanmedian(results[-1].sigma) > np.nanmedian(results[0].sigma)


def test_without_updates_each_image_is_measured_as_if_alone() -> None:
    images = [image(0), speckles(**SIZE, shift=(3.3, 0.4)), speckles(**SIZE, shift=(6.1, 1.7))]
    results = dic_sequence(images[0], images[1:], subset=21, step=14)
    for picture, result in zip(images[1:], results, strict=True):
        alone = dic(images[0], picture, subset=21, step=14)
        assert np.array_equal(result.status, alone.status)
        assert np.abs(result.displacement - alone.displacement)[alone.ok].max() <= 2e-4


def test_a_point_lost_at_an_update_stays_lost_with_its_reason() -> None:
    size = {"width": 117, "height": 93}
    images = [speckles(**size, shift=(1.5 * k, 0.0)) for k in range(4)]
    for picture in images[1:2]:
        picture[34:60, 43:76] = 77.0
    points = [[30.0, 20.0], [57.0, 46.0], [80.0, 75.0]]
    results = dic_sequence(images[0], images[1:], update="always", subset=21, points=points)
    for k, result in enumerate(results, start=1):
        assert result.ok.tolist() == [True, False, True]
        assert result.status[1] == results[0].status[1] != Status.OK
        assert np.isnan(result.displacement[1]).all()
        assert np.abs(result.displacement[[0, 2]] - [1.5 * k, 0.0]).max() <= 2e-3


def test_a_mask_moves_with_what_it_masks() -> None:
    """The lower half stays still; masked out, it doesn't pull at the upper half as that moves."""
    size = {"width": 157, "height": 91}
    rows = np.arange(91)[:, None]
    upper = np.broadcast_to(rows < 46, (91, 157))
    still = speckles(**size, seed=9)
    images = [np.where(upper, speckles(**size, shift=(4.0 * k, 0.0)), still) for k in range(4)]
    points = [[x, 39.0] for x in (40.0, 60.0, 80.0)]
    options = {"subset": 21, "points": points, "shape": "translation", "mask": upper.copy()}
    results = dic_sequence(images[0], images[1:], update="always", **options)
    assert np.abs(results[-1].displacement - [12.0, 0.0]).max() <= 5e-3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"update": "sometimes"}, "update"),
        ({"update_zncc": float("nan")}, "update_zncc"),
        ({"subset": 20}, "subset"),
    ],
)
def test_wrong_arguments_name_themselves(change: dict[str, object], words: str) -> None:
    picture = speckles(57, 33)
    with pytest.raises(InputError, match=words):
        dic_sequence(picture, [picture], **{"subset": 15, **change})
