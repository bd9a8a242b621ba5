"""Paint: what patterns are made of, and what is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.identical_cases.images import PAINTS
from gpusim.errors import InputError
from gpusim.optics.geometry.pixel_footprint import RegionPaint
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.surface import paint
from gpusim.surface.paint import Checker, Dots, Features, Markers, Plain

LOW, HIGH = np.array([0.0, 0.0]), np.array([1.0, 0.7])


@pytest.mark.parametrize(
    ("make", "parts"),
    [
        (lambda: Plain(1.2), ("Plain albedo", "1.2", "0 to 1")),
        (lambda: Plain(float("nan")), ("Plain albedo", "nan", "0 to 1")),
        (lambda: Plain("grey"), ("Plain albedo", "grey", "0 to 1")),
        (lambda: Checker([0.1, 0.2]), ("Checker size", "[0.1, 0.2]", "above 0")),
        (lambda: Checker(0.1, columns="8"), ("Checker columns", "8", "at least 1")),
        (lambda: Checker(0.1, origin=("a", 0.0)), ("Checker origin", "a", "two finite")),
        (lambda: Checker(0.0), ("Checker size", "0.0", "above 0")),
        (lambda: Checker(float("inf")), ("Checker size", "inf", "above 0")),
        (lambda: Checker(0.1, dark=-0.1), ("Checker dark", "-0.1", "0 to 1")),
        (lambda: Checker(0.1, columns=0), ("Checker columns", "0", "at least 1")),
        (lambda: Checker(0.1, rows=-3), ("Checker rows", "-3", "at least 1")),
        (
            lambda: Checker(0.1, origin=(np.nan, 0.0)),
            ("Checker origin", "nan", "two finite numbers"),
        ),
        (lambda: Dots(0.0, 0.1), ("Dots diameter", "0.0", "above 0")),
        (lambda: Dots(0.2, 0.1), ("Dots diameter", "0.2", "at most the pitch")),
        (lambda: Dots(0.1, 0.2, columns=0), ("Dots columns", "0", "at least 1")),
        (lambda: Dots(0.1, 0.2, ground=2.0), ("Dots ground", "2.0", "0 to 1")),
        (lambda: Dots(0.1, 0.2, origin=(0.0, np.inf)), ("Dots origin", "inf", "two finite")),
        (lambda: Markers(np.zeros((2, 3)), 0.1), ("Markers centres", "(2, 3)", "(M, 2)")),
        (lambda: Markers(np.full((1, 2), np.nan), 0.1), ("Markers centres", "finite (M, 2)")),
        (lambda: Markers(np.zeros((1, 2)), -1.0), ("Markers size", "-1.0", "above 0")),
        (lambda: Markers(np.zeros((1, 2)), 0.1, light=1.5), ("Markers light", "1.5", "0 to 1")),
        (lambda: Markers(np.zeros((1, 2)), 0.1, angle=np.nan), ("Markers angle", "nan", "finite")),
    ],
)
def test_faults_say_what_got_and_expected(
    make: Callable[[], object], parts: tuple[str, ...]
) -> None:
    with pytest.raises(InputError) as caught:
        make()
    for part in parts:
        assert part in str(caught.value)


def test_every_paint_is_among_the_cases_of_identical() -> None:
    """`python -m benchmarks.identical` hashes pictures of all of them."""
    made = {type(make()).__name__ for make in PAINTS.values()}
    assert made == set(paint.__all__) - {"Bump", "Features", "Paint"}


def test_plain_has_no_features() -> None:
    assert Plain(0.3).features(LOW, HIGH) is None
    assert Plain(0.3).ground == 0.3


def test_checker_unlimited_covers_the_region_and_keeps_its_colours() -> None:
    """The square at the origin is even (dark) wherever the region starts."""
    for low in (np.array([0.0, 0.0]), np.array([-3.21, 7.7]), np.array([0.35, -0.15])):
        features = Checker(0.1, origin=(0.02, 0.03)).features(low, low + np.array([1.0, 0.7]))
        assert features is not None and len(features) == 1
        first, last = features.bounds()
        assert (first[0] < low).all() and (last[0] > low + np.array([1.0, 0.7])).all()
        squares = (np.array([0.02, 0.03]) - features.position[0]) / 0.1
        assert np.abs(squares - np.rint(squares)).max() < 1e-9
        assert np.rint(squares).sum() % 2 == 0


def test_checker_limited_starts_at_its_origin() -> None:
    features = Checker(0.1, 4, 3, (0.2, 0.5)).features(LOW, HIGH)
    assert features is not None
    np.testing.assert_allclose(features.position, [[0.2, 0.5]])
    np.testing.assert_array_equal(features.squares, [[4, 3]])


def test_dots_on_a_grid() -> None:
    features = Dots(0.03, 0.1, 3, 2, (0.2, 0.4)).features(LOW, HIGH)
    assert features is not None and (features.kind == 1).all()
    want = {(x, y) for x in (0.2, 0.3, 0.4) for y in (0.4, 0.5)}
    assert {(round(x, 12), round(y, 12)) for x, y in features.position} == want
    many = Dots(0.03, 0.1, origin=(0.02, 0.01)).features(LOW, HIGH)
    assert many is not None
    low, high = many.bounds()
    assert (low.min(axis=0) <= LOW).all() and (high.max(axis=0) >= HIGH).all()


def test_more_dots_than_memory_holds_are_refused() -> None:
    for dots in (Dots(1e-6, 2e-6), Dots(1e-6, 2e-6, 10**4, 10**4)):
        with pytest.raises(InputError, match=r"Dots pitch; got 2e-06.*at most 4194304"):
            dots.features(LOW, HIGH)


def test_marker_patches_are_centred_whatever_their_angle() -> None:
    centres = np.array([[0.2, 0.3], [0.7, 0.1]])
    for angle in (0.0, 0.3, np.pi / 4, 2.0):
        features = Markers(centres, 0.08, angle=angle).features(LOW, HIGH)
        assert features is not None
        low, high = features.bounds()
        np.testing.assert_allclose(0.5 * (low + high), centres, atol=1e-14)
        span = 0.08 * (abs(np.cos(angle)) + abs(np.sin(angle)))
        np.testing.assert_allclose(high - low, span, atol=1e-14)


def table(paint: Checker | Dots | Markers) -> FeatureGrid:
    return FeatureGrid.build([RegionPaint(paint, LOW, HIGH, 1e-3)])


def test_overlapping_features_are_refused() -> None:
    with pytest.raises(InputError, match=r"features \d and \d overlap; got .* keep apart"):
        table(Markers(np.array([[0.2, 0.3], [0.9, 0.3], [0.26, 0.31]]), 0.08))
    table(Markers(np.array([[0.2, 0.3], [0.28, 0.3]]), 0.08))  # side by side: they touch
    table(Dots(0.1, 0.1))  # discs that touch


def test_boards_under_fine_meshes_have_small_cells() -> None:
    region = RegionPaint(Checker(0.01), np.zeros(2), np.ones(2), 1e-4)
    assert FeatureGrid.build([region]).paints["cell"][0] == 1.0
    # triangles of 50 and of 1000 px, which are 0.01 and 0.2 long
    assert FeatureGrid.build([region], 50.0).paints["cell"][0] == 2.0**-5
    assert FeatureGrid.build([region], 1000.0).paints["cell"][0] == 0.5
    # no more of them than a table may have
    many = FeatureGrid.build([RegionPaint(Checker(1e-3), np.zeros(2), np.ones(2), 1e-5)], 50.0)
    assert many.paints["cell"][0] == 2.0**-5


class Scattered:
    """A paint of discs at given places, as a user might write one."""

    ground = 0.5

    def __init__(self, places: list[tuple[float, float, float]]) -> None:
        self.places = np.array(places)

    def features(self, low: np.ndarray, high: np.ndarray) -> Features:
        n = len(self.places)
        return Features(
            np.ones(n, np.int32), self.places[:, :2], np.zeros(n),
            np.repeat(self.places[:, 2:], 2, axis=1), np.ones((n, 2)), np.full((n, 2), 0.1),
        )  # fmt: skip


def test_discs_overlap_by_their_circles_not_their_boxes() -> None:
    apart = [(0.2, 0.2, 0.1), (0.35, 0.35, 0.1)]
    FeatureGrid.build([RegionPaint(Scattered(apart), LOW, HIGH, 1e-3)])
    close = [(0.2, 0.2, 0.1), (0.33, 0.33, 0.1)]
    with pytest.raises(InputError, match="overlap"):
        FeatureGrid.build([RegionPaint(Scattered(close), LOW, HIGH, 1e-3)])


def test_turned_markers_overlap_by_their_squares_not_their_boxes() -> None:
    """Two squares on their corners, side by side along a diagonal: their boxes overlap."""
    step = 0.09 * np.sqrt(0.5)
    centres = np.array([[0.2, 0.2], [0.2 + step, 0.2 + step]])
    table(Markers(centres, 0.08, angle=np.pi / 4))
    with pytest.raises(InputError, match="overlap"):
        table(Markers(np.array([[0.2, 0.2], [0.25, 0.25]]), 0.08, angle=np.pi / 4))
