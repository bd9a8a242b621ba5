"""Markers that all look alike on a bending member."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import Status, find_markers, locate_markers, track
from tests.support.measure_images import Marker, board

COUNT = 9
SPACING = 280.0


def member(size: float = 19.0) -> tuple[list[Marker], list[Marker]]:
    """Markers along a cantilever whose end turns by 4 degrees and moves by more than 100 px."""
    rng = np.random.default_rng(4)
    length = SPACING * (COUNT - 1)
    before, after = [], []
    for i in range(COUNT):
        t = i / (COUNT - 1)
        slope = 0.07 * (2 * t - t * t)
        drop = 0.07 * length * (t * t - t**3 / 3)
        marker = Marker(40 + SPACING * i + rng.uniform(), 40 + rng.uniform(), size, size)
        before.append(marker)
        after.append(marker.moved(-0.03 * drop, drop, float(np.arctan(slope))))
    return before, after


def centres(markers: list[Marker]) -> np.ndarray:
    return np.array([[m.x, m.y] for m in markers])


def images(background: float = 120.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    before, after = member()
    first, second = (board(2330, 200, m, background) for m in (before, after))
    return first, second, centres(before), centres(after) - centres(before)


@pytest.mark.parametrize("shape", ["rigid", "affine"])
def test_chain_follows_rotation_and_large_motion(shape: str) -> None:
    first, second, points, truth = images()
    assert truth[-1, 1] >= 100
    subset = 17 if shape == "rigid" else 25
    result = track(
        first, second, points, subset=subset, groups=[list(range(COUNT))], shape=shape, search_px=8
    )
    assert result.ok.all()
    error = np.abs(result.displacement - truth)
    assert error.max() <= (0.02 if shape == "rigid" else 0.01)  # measured: 0.012, 0.005
    assert result.backward.max() <= 0.01
    assert result.source.tolist() == [-1, 0, 1, 2, 3, 4, 5, 6, 7]
    turn = 0.5 * (result.gradient[:, 1, 0] - result.gradient[:, 0, 1])
    assert np.abs(np.degrees(turn[-1]) - 4.0).max() <= 0.1


def test_refinement_by_the_cross_reaches_a_thousandth() -> None:
    first, second, points, truth = images()
    tracked = track(first, second, points, subset=17, groups=[list(range(COUNT))])
    start = locate_markers(first, points, (16, 22), 4.0)
    end = locate_markers(second, points + tracked.displacement, (16, 22), 4.0)
    assert start.ok.all() and end.ok.all()
    assert np.abs(end.points - start.points - truth).max() <= 0.003


def test_chain_grows_by_itself_and_static_markers_stay() -> None:
    before, after = member()
    wall = [Marker(300.4 + 500 * i, 165.7, 19, 19) for i in range(4)]
    first, second = board(2330, 200, before + wall), board(2330, 200, after + wall)
    points = centres(before + wall)
    result = track(
        np.rint(first).astype(np.uint8), np.rint(second).astype(np.uint8), points, subset=17
    )
    assert result.ok.all()
    assert np.abs(result.displacement - (centres(after + wall) - points)).max() <= 0.02
    assert np.abs(result.displacement[COUNT:]).max() <= 1e-9


def test_a_poor_match_is_caught_on_the_way_back() -> None:
    """A quarter of the marker is covered: it correlates, but a tenth of a pixel off."""
    first = board(120, 84, [Marker(40.2, 40.4, 19, 19)])
    second = board(120, 84, [Marker(42.7, 41.1, 19, 19, 0.05)])
    second[41:60, 41:60] = 120.0
    free = track(first, second, [[40.2, 40.4]], subset=17, backward_px=1e3)
    assert free.ok.all() and free.zncc[0] >= 0.8
    assert np.abs(free.displacement - [2.5, 0.7]).max() >= 0.09
    checked = track(first, second, [[40.2, 40.4]], subset=17)
    assert checked.status.tolist() == [Status.BACKWARD]
    assert checked.backward[0] > 0.05
    assert np.isnan(checked.displacement).all() and np.isnan(checked.sigma).all()


def test_two_markers_in_one_place_are_ambiguous() -> None:
    """One marker is hidden; its look-alike neighbour is in reach and matches perfectly."""
    first = board(200, 84, [Marker(40.2, 40.4, 19, 19), Marker(66.3, 40.1, 19, 19)])
    second = board(200, 84, [Marker(66.9, 40.9, 19, 19)])
    points = [[40.2, 40.4], [66.3, 40.1]]
    wide = track(first, second, points, subset=17, search_px=30, groups=[[0], [1]])
    assert wide.status.tolist() == [Status.AMBIGUOUS] * 2
    assert np.isnan(wide.displacement).all()
    narrow = track(first, second, points, subset=17, search_px=8, groups=[[0], [1]])
    assert narrow.ok.tolist() == [False, True]
    assert np.abs(narrow.displacement[1] - [0.6, 0.8]).max() <= 0.02


def test_lost_and_untried_markers_carry_no_number() -> None:
    first, second, points, _ = images()
    second[:, 1000:] = 120.0  # the outer part is hidden
    result = track(first, second, points, subset=17, groups=[[0, 1, 2, 3, 4, 5]], search_px=8)
    assert result.ok.tolist() == [True] * 4 + [False] * 5
    assert (result.status[6:] == Status.NO_GUESS).all()
    assert np.isnan(result.displacement[4:]).all() and np.isnan(result.sigma[4:]).all()


def test_background_that_stays_must_be_kept_out_of_the_subset() -> None:
    """A strongly patterned wall: a subset inside the marker or a mask, not a wide one."""
    before, after = member()
    rng = np.random.default_rng(11)
    wall = np.kron(rng.uniform(20, 220, (50, 583)), np.ones((4, 4)))[:200, :2330]
    inside = [board(2330, 200, m, background=-1e4) > 0 for m in (before, after)]
    first, second = (
        np.where(near, board(2330, 200, m), wall)
        for near, m in zip(inside, (before, after), strict=True)
    )
    truth = centres(after) - centres(before)
    chain = [list(range(COUNT))]
    narrow = track(first, second, centres(before), subset=13, groups=chain, search_px=8)
    assert narrow.ok.all()
    assert np.abs(narrow.displacement - truth).max() <= 0.05
    masked = track(
        first,
        second,
        centres(before),
        subset=23,
        groups=chain,
        mask=inside[0],
        search_px=8,
        blur_px=0.5,
    )
    assert masked.ok.all()
    assert np.abs(masked.displacement - truth).max() <= 0.1


def test_the_whole_chain_from_finding_to_following() -> None:
    first, second, _, truth = images()
    found = find_markers(first, (16, 22))
    order = np.argsort(found.points[:, 0])
    result = track(first, second, found.points[order], subset=17, groups=[list(range(COUNT))])
    assert np.abs(result.displacement - truth).max() <= 0.02


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"groups": [[0, 1], [1]]}, "groups"),
        ({"groups": [[0, 9]]}, "groups"),
        ({"search_px": 0}, "search_px"),
        ({"backward_px": float("nan")}, "backward_px"),
        ({"subset": 16}, "subset"),
    ],
)
def test_wrong_arguments_name_themselves(change: dict[str, object], words: str) -> None:
    image = board(83, 57, [Marker(40, 28, 19, 19)])
    with pytest.raises(InputError, match=words):
        track(image, image, [[40.0, 28.0], [41.0, 28.0]], **{"subset": 17, **change})
