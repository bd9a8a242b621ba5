"""Plots drawn by ourselves: what is drawn lies where the axes say."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.export.images import write_colour_png
from gpusim.report.canvas import Canvas, text_size
from gpusim.report.chart import draw_chart
from gpusim.report.panel import Panel
from gpusim.report.space import flat, space_panel
from gpusim.report.ticks import decades, round_ticks

RED, BLUE = "#ff0000", "#0000ff"


def where(path: Path, colour: str) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels of a colour."""
    blue, green, red = np.moveaxis(cv2.imread(str(path)).astype(int), 2, 0)
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return np.nonzero((red == wanted[0]) & (green == wanted[1]) & (blue == wanted[2]))


def centres(path: Path, colour: str) -> np.ndarray:
    """Centres x, y of the marks of a colour, from left to right."""
    rows, columns = where(path, colour)
    mask = np.zeros((int(rows.max()) + 2, int(columns.max()) + 2), np.uint8)
    mask[rows, columns] = 1
    return np.array(sorted(cv2.connectedComponentsWithStats(mask)[3][1:].tolist()))


def test_marks_lie_where_the_axes_say(tmp_path: Path) -> None:
    x, y = np.array([0.0, 1.0, 3.0, 7.0]), np.array([-2.0, 5.0, 1.0, 3.0])
    panel = Panel("title", "x", "y", right=2.0, right_label="half")
    panel.marks(x, y, RED, "s", 6.0, inside=RED)
    draw_chart(tmp_path / "a.png", (5.0, 3.0), [[panel]])
    at = centres(tmp_path / "a.png", RED)
    assert cv2.imread(str(tmp_path / "a.png")).shape == (600, 1000, 3)
    # one affine map takes all of them there, upwards in y
    for values, pixels, sign in ((x, at[:, 0], 1.0), (y, at[:, 1], -1.0)):
        slope, first = np.polyfit(values, pixels, 1)
        assert sign * slope > 20.0
        assert np.abs(slope * values + first - pixels).max() <= 0.8


def test_equal_units_rows_downwards_and_shared_left_borders(tmp_path: Path) -> None:
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])
    above = Panel(equal=True, downwards=True)
    above.marks(*square.T, RED, "D", 6.0, inside=RED)
    wide = Panel("below", "x", "a label", y_range=(0.0, 123456.0))
    wide.rule(61728.0, BLUE, width=2.0)
    draw_chart(tmp_path / "a.png", (4.0, 5.0), [[above], [wide]], [2.0, 1.0])
    a, b, c = centres(tmp_path / "a.png", RED)[[0, 1, 2]]
    b, c = sorted((b, c), key=lambda at: at[1])
    assert abs((b[0] - a[0]) / 4.0 - (c[1] - b[1]) / 3.0) <= 0.5
    assert c[1] > b[1] + 50  # y grows down
    rows, columns = where(tmp_path / "a.png", BLUE)
    assert rows.min() > c[1] and np.ptp(columns) > 300
    assert columns.min() - text_size("61728")[0] > 0  # room for the numbers


def test_what_is_not_finite_or_outside_is_not_drawn(tmp_path: Path) -> None:
    panel = Panel(x_range=(0.0, 1.0), y_range=(0.0, 1.0))
    panel.line([0.2, np.nan, 0.6, 0.8], [0.5, 0.5, 0.5, 0.5], RED, 2.0)
    panel.line([-9e9, 9e9], [1e9, 1e9], BLUE, 2.0)
    panel.marks([2.0, np.nan], [0.5, 0.5], BLUE, "o", 9.0, inside=BLUE)
    draw_chart(tmp_path / "a.png", (4.0, 3.0), [[panel]])
    rows, columns = where(tmp_path / "a.png", RED)
    assert len(rows) and not len(where(tmp_path / "a.png", BLUE)[0])
    assert 100 < np.ptp(columns) < 200  # from 0.6 to 0.8 of some 700 px


def test_the_legend_goes_where_nothing_is(tmp_path: Path) -> None:
    panel = Panel()
    x = np.linspace(0.0, 1.0, 50)
    panel.line(x, x**2, RED, 2.0, label="a curve")  # the upper left corner is free
    draw_chart(tmp_path / "a.png", (5.0, 4.0), [[panel]])
    rows, columns = where(tmp_path / "a.png", RED)
    key = (rows < 200) & (columns < 300)
    assert key.sum() > 30 and np.ptp(rows[key]) < 12


def test_letters_are_whole_and_can_stand_upright() -> None:
    flat_one, upright = Canvas((3.0, 3.0)), Canvas((3.0, 3.0))
    flat_one.text(300.0, 300.0, "Hjg\u2212", across=0.5, down=0.5)
    upright.text(300.0, 300.0, "Hjg\u2212", across=0.5, down=0.5, upright=True)
    ink = [np.argwhere((c.image < 128).all(axis=2)) for c in (flat_one, upright)]
    size = [np.ptp(own, axis=0) for own in ink]
    assert abs(size[0][0] - size[1][1]) <= 1 and abs(size[0][1] - size[1][0]) <= 1
    width, height = text_size("Hjg\u2212")
    assert 0.7 * width < size[0][1] <= width and 0.8 * height < size[0][0] <= height
    assert np.abs(ink[0].mean(axis=0) - 300.0).max() < 12.0
    before = flat_one.image.copy()
    flat_one.text(-500.0, 40.0, "outside")
    assert (flat_one.image == before).all()


def test_round_numbers() -> None:
    assert round_ticks(-0.3, 10.2, 6).labels == ("0", "2", "4", "6", "8", "10")
    assert round_ticks(0.0, 0.011, 5).labels == ("0.0000", "0.0025", "0.0050", "0.0075", "0.0100")
    small = round_ticks(-3e-7, 3e-7, 4)
    assert small.power == -7 and small.labels == ("\u22122", "0", "2")
    assert small.on("error (mm)") == "error (mm) \u00d7 10⁻⁷"
    assert round_ticks(0.0, 3.9, 7, whole=True).places == (0.0, 1.0, 2.0, 3.0)
    assert decades(-7.2, 0.1, 4).labels == ("10⁻⁷", "10⁻⁵", "10⁻³", "10⁻¹")
    rng = np.random.default_rng(2)
    for _ in range(200):
        low, span = rng.normal() * 10 ** rng.uniform(-9, 9), 10 ** rng.uniform(-9, 9)
        high = low + max(span, 1e-6 * abs(low))
        ticks = round_ticks(low, high, 6)
        assert 1 <= len(ticks.places) <= 7 and len(ticks.labels) == len(ticks.places)
        assert low - 1e-6 * (high - low) <= min(ticks.places)
        assert max(ticks.places) <= high + 1e-6 * (high - low)


def test_space_keeps_lengths_along_the_page() -> None:
    x, y = flat(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    assert x[1] == x[0] and 1.5 < y[1] < 2.0  # up is up, seen from above
    assert x[2] > 0 and y[2] < 0 and x[3] > 0 and y[3] > 0  # x comes nearer, y goes away
    panel = space_panel(np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]), "mm")
    assert panel.bare and panel.equal and len(panel.data[0]) == 24


def test_colour_pictures_are_checked(tmp_path: Path) -> None:
    image = np.random.default_rng(4).integers(0, 255, (21, 34, 3), np.uint8)
    back = cv2.imread(str(write_colour_png(tmp_path / "a.png", image)))
    assert np.array_equal(back[:, :, ::-1], image)
    with pytest.raises(InputError, match=r"expected \(H, W, 3\) uint8"):
        write_colour_png(tmp_path / "b.png", image[:, :, 0])
