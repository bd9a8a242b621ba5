"""Maps of fields: values that can be read, and what their colours span."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gpusim.export.field_catalogue import FieldMap
from gpusim.export.images import read_image
from gpusim.report.field_maps import _range, _readable, draw_map, draw_panels

GRID = np.stack(np.meshgrid(np.arange(20.0, 60.0, 4.0), np.arange(10.0, 30.0, 4.0)), -1)
POINTS = GRID.reshape(-1, 2)


@pytest.mark.parametrize(
    ("values", "title", "want"),
    [
        ([2e-4, -1e-5], "exx, hencky", "exx, hencky (10$^{-4}$)"),
        ([0.02, np.nan, 0.01], "u (px, to the right)", "u (px, to the right)"),
        ([3.4e6, 1.0], "Z (mm, from the left camera)", "Z (10$^{6}$ mm, from the left camera)"),
        ([np.nan, np.nan], "sigma (px)", "sigma (px)"),
        ([0.0, 0.0], "sigma (px)", "sigma (px)"),
    ],
)
def test_powers_of_ten_stand_in_the_title(values: list[float], title: str, want: str) -> None:
    shown = _readable(FieldMap(np.array(values), title))
    assert shown.title == want
    power = float(want.split("{")[1].split("}")[0]) if "{" in want else 0.0
    assert np.allclose(shown.values, np.array(values) / 10.0**power, rtol=1e-12, equal_nan=True)


def test_the_power_of_ten_is_that_of_a_scale_which_maps_share() -> None:
    shown = _readable(FieldMap(np.array([2e-7, 1e-7]), "true", scale=(-3e-5, 4e-5)))
    assert shown.title == "true (10$^{-5}$)" and shown.scale == pytest.approx((-3.0, 4.0))
    assert shown.values == pytest.approx([0.02, 0.01])


def test_colours_span_nearly_all_values_the_scale_or_both_sides_of_zero() -> None:
    values = np.linspace(0.2, 1.0, len(POINTS))
    values[:2] = [np.nan, 900.0]  # a rough border

    def ends(one: FieldMap) -> tuple[str, float, float]:
        axes = Figure().subplots()
        draw_map(axes, None, POINTS, one)
        (drawn,) = axes.images
        return drawn.cmap.name, drawn.norm.vmin, drawn.norm.vmax

    low, high = np.nanquantile(values, [0.01, 0.99])
    assert ends(FieldMap(values, "u")) == ("viridis", pytest.approx(low), pytest.approx(high))
    assert ends(FieldMap(values, "u", scale=(-1.0, 3.0))) == ("viridis", -1.0, 3.0)
    about_zero = ends(FieldMap(values - 0.9, "u", centred=True, scale=(-0.5, 0.2)))
    assert about_zero == ("RdBu_r", -0.5, 0.5)
    assert ends(FieldMap(values, "u", centred=True, scale=(0.1, 0.2))) == ("viridis", 0.1, 0.2)
    assert _range(np.full(7, 3.0)) == (1.5, 4.5)
    assert _range(np.zeros(7)) == _range(np.full(7, np.nan)) == (-0.5, 0.5)


def test_panels_show_the_part_around_the_points(tmp_path: Path) -> None:
    image = np.full((160, 200), 100.0)
    values = np.full(len(POINTS), 1.0)
    maps = [FieldMap(values, "a"), FieldMap(values, "b")]
    seen = []

    def last(axes: object) -> None:
        seen.append(axes)

    draw_panels(image, POINTS, maps, 2, tmp_path / "maps.png", last)
    (axes,) = seen
    left, right, low, high = axes.axis()  # type: ignore[attr-defined]
    assert 0.0 < left < 20.0 and 56.0 < right < 60.0 and 0.0 < high < 10.0 and 26.0 < low < 30.0
    height, width = read_image(tmp_path / "maps.png").shape[:2]
    assert width == pytest.approx(2 * 3.1 * 200, abs=2) and 0.4 < height / width < 0.7


def test_few_points_are_shown_with_what_is_around_them(tmp_path: Path) -> None:
    """A tenth of the picture's longer side, not the pixel below a point alone."""
    image, column = np.full((160, 200), 100.0), [[90.0, 40.0], [90.0, 120.0]]
    for points, size in (([[90.0, 70.0]], (20.0, 20.0)), (column, (20.0, 88.0))):
        seen: list[Axes] = []
        values = FieldMap(np.ones(len(points)), "a")
        draw_panels(image, np.array(points), [values], 2, tmp_path / "maps.png", seen.append)
        left, right, low, high = seen[0].axis()
        assert (right - left, low - high) == pytest.approx(size) and left + right == 180.0
