"""Round limits of colour scales, and numbers for people."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.visualization.color_scale import format_value, scale_of


@pytest.mark.parametrize(
    ("values", "signed", "limits", "map_name"),
    [
        (np.linspace(0.3, 37.0, 400), False, (0.0, 40.0), "viridis"),
        (np.linspace(812.0, 858.0, 400), False, (810.0, 860.0), "viridis"),
        (np.linspace(-3.1, 0.4, 400), True, (-4.0, 4.0), "coolwarm"),
        (np.linspace(1.3, 9.4, 400), True, (0.0, 10.0), "viridis"),
        (np.linspace(-9.4, -1.3, 400), True, (-10.0, 0.0), "viridis"),
        (np.zeros(40), False, (0.0, 1.0), "viridis"),
        (np.full(40, 7.0), False, (0.0, 8.0), "viridis"),
    ],
)
def test_limits_are_round(
    values: np.ndarray, signed: bool, limits: tuple[float, float], map_name: str
) -> None:
    scale = scale_of([values, values[:3]], signed)
    assert scale.limits == pytest.approx(limits) and scale.colormap == map_name
    assert scale.ticks[0] == scale.low and scale.ticks[-1] == scale.high
    assert not scale.below and not scale.above


def test_a_few_values_beyond_do_not_stretch_the_colours() -> None:
    values = np.concatenate([np.linspace(0.0, 50.0, 5000), [4000.0]])
    scale = scale_of([values])
    assert scale.limits == (0.0, 50.0) and scale.above and not scale.below


def test_limits_that_are_asked_for() -> None:
    """Ticks lie within; values beyond are told of; colours diverge where zero is in the middle."""
    values = [np.linspace(-8.0, 37.0, 400)]
    scale = scale_of(values, True, (-3.0, 21.0))
    assert scale.limits == (-3.0, 21.0) and scale.ticks == (0.0, 5.0, 10.0, 15.0, 20.0)
    assert scale.below and scale.above and scale.colormap == "viridis"
    scale = scale_of(values, True, (-40.0, 40.0))
    assert scale.colormap == "coolwarm" and not scale.below and not scale.above
    assert scale_of([np.full(3, np.nan)], True, (1.0, 2.0)).limits == (1.0, 2.0)


def test_numbers_for_people() -> None:
    assert [format_value(v, 0.25) for v in (0.0, 0.25, -0.5)] == ["0", "0.25", "−0.5"]  # noqa: RUF001
    assert [format_value(v, 20.0) for v in (0.0, 40.0)] == ["0", "40"]
    assert format_value(3e-5, 1e-5) == "3×10⁻⁵" and format_value(2e6, 1e6) == "2×10⁶"  # noqa: RUF001
