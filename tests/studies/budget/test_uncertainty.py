"""The mathematics of budgets: against the GUM's own example, and linear models in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.studies.budget import SourceDraws, UncertaintyBudget, rounded, write_budget

LENGTH = (("length", "nm"),)


def standardised(count: int, seed: int) -> Float:
    """Numbers with mean 0 and standard deviation 1, to rounding."""
    values = np.random.default_rng(seed).normal(size=count)
    values -= values.mean()
    return np.asarray(values / values.std(ddof=1))


def sources(sizes: dict[str, tuple[float, float]], draws: int = 400) -> tuple[SourceDraws, ...]:
    """By their standard uncertainties and degrees of freedom."""
    found = []
    for seed, (name, (size, freedom)) in enumerate(sizes.items()):
        values = standardised(draws, seed)[:, None]
        found.append(SourceDraws(name, (name,), values, size * values, freedom))
    return tuple(found)


def test_end_gauge_of_the_guide() -> None:
    """JCGM 100:2008, annex H.1: 32 nm with 16 degrees of freedom, 93 nm at 99 %."""
    known = sources({
        "standard": (25.0, 18), "repeated": (5.8, 24), "random effects": (3.9, 5),
        "systematic effects": (6.7, 8), "expansion": (2.9, 50), "temperatures": (16.6, 2),
    })  # fmt: skip
    joint = np.sum([one.errors for one in known], axis=0)
    budget = UncertaintyBudget(LENGTH, np.zeros(1), known, joint, coverage=0.99)
    assert round(float(budget.combined[0])) == 32
    assert int(budget.freedom[0]) == 16  # k of 16 is 2.92; ours of 16.7 is smaller
    assert budget.expanded[0] == pytest.approx(2.92 * 31.67, rel=0.01)
    told = budget.advice(0)
    assert "mend standard first" in told and "from 32 to 19 nm" in told


def test_linear_model_in_closed_form() -> None:
    """Sensitivities, correlations, shares, and two quantities that hang together."""
    first, second = standardised(500, 1), standardised(500, 2)
    second -= first * np.mean(first * second) / np.mean(first**2)  # not correlated by chance
    values = np.column_stack([0.5 * first, 2.0 * second])
    slopes = np.array([[4.0, -1.0], [0.25, 3.0]])
    noise = standardised(500, 3)[:, None] * [1.0, 0.0]
    own = SourceDraws("lens", ("f", "c"), values, values @ slopes + 7.0)
    other = SourceDraws("noise", ("seed",), np.full((500, 1), np.nan), noise + 7.0)
    quantities = ("tip", "mm"), ("strain", "um/m")
    joint = own.errors + other.errors - 7.0
    budget = UncertaintyBudget(quantities, np.full(2, 7.0), (own, other), joint)
    np.testing.assert_allclose(own.sensitivity, slopes, rtol=1e-9)
    np.testing.assert_allclose(budget.uncertainties[1], [1.0, 0.0], atol=1e-12)
    # u1 = sqrt((4 0.5)^2 + (0.25 2)^2), and 2 of 2.06 come by f
    assert own.uncertainty[0] == pytest.approx(np.hypot(2.0, 0.5), rel=1e-3)
    assert own.correlation[0, 0] == pytest.approx(2.0 / np.hypot(2.0, 0.5), rel=1e-3)
    np.testing.assert_allclose(budget.shares.sum(axis=0), 1.0)
    assert budget.shares[1, 1] == 0.0 and np.isnan(other.sensitivity).all()
    np.testing.assert_allclose(budget.biases, 0.0, atol=1e-12)
    np.testing.assert_allclose(budget.joint_uncertainty, budget.combined, rtol=1e-9)
    covariance = slopes.T @ np.diag([0.25, 4.0]) @ slopes + np.diag([1.0, 0.0])
    expected = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert budget.correlation[0, 1] == pytest.approx(expected, abs=0.05)


def test_sources_that_act_on_each_other_are_told() -> None:
    """The product of two errors is nothing alone and all there is together."""
    a, b = standardised(300, 1), standardised(300, 2)
    alone = [SourceDraws(n, (n,), v[:, None], 1e-3 * v[:, None]) for n, v in (("a", a), ("b", b))]
    joint = (a * b)[:, None]
    budget = UncertaintyBudget((("x", "mm"),), np.zeros(1), tuple(alone), joint)
    assert "act on each other" in budget.advice(0)
    shifted = UncertaintyBudget((("x", "mm"),), np.zeros(1), tuple(alone), joint + 5.0)
    assert "correct results by it" in shifted.advice(0)


def test_what_chance_does_is_not_taken_for_more() -> None:
    """Noise that is another one where all are drawn together: half of such budgets are off by more
    than 5 %, by as much as each says of itself."""
    rng, ratios, chances, claims = np.random.default_rng(4), [], [], 0
    for _ in range(40):
        lens, noise, other = rng.normal(size=(3, 64, 1))
        alone = tuple(
            SourceDraws(name, (name,), one, one)
            for name, one in (("lens", 0.5 * lens), ("noise", noise))
        )
        budget = UncertaintyBudget(LENGTH, np.zeros(1), alone, 0.5 * lens + other)
        ratios.append(budget.joint_uncertainty[0] / budget.combined[0])
        chances.append(budget.ratio_uncertainty[0])
        claims += "act on each other" in budget.advice(0)
    assert np.std(ratios) == pytest.approx(np.mean(chances), rel=0.3) and np.std(ratios) > 0.08
    assert np.mean(np.abs(np.array(ratios) - 1.0) > 0.05) > 0.3 and claims <= 5


def test_nothing_varies_and_too_few_draws() -> None:
    still = SourceDraws("noise", ("seed",), np.full((5, 1), np.nan), np.zeros((5, 1)))
    budget = UncertaintyBudget(LENGTH, np.zeros(1), (still,), np.zeros((5, 1)))
    assert budget.advice(0) == "length: none of the sources changes it."
    assert budget.expanded[0] == 0.0
    lost = SourceDraws("noise", ("seed",), np.full((5, 1), np.nan), np.full((5, 1), np.nan))
    with pytest.raises(InputError, match=r"draws of noise; got \[0\]; expected as many draws"):
        UncertaintyBudget(LENGTH, np.zeros(1), (lost,), np.zeros((5, 1)))


def test_two_digits() -> None:
    assert [rounded(one) for one in (0.0996, 99.6, 0.0)] == ["0.10", "100", "0"]
    assert rounded(-0.00001, 0.02) == "0.000" and rounded(float("nan")) == "nan"


def test_the_page(tmp_path: Path) -> None:
    known = sources({"<noise>": (3.0, 10), "light": (1.0, 10)})
    joint = known[0].errors + known[1].errors
    budget = UncertaintyBudget(LENGTH, np.zeros(1), known, joint, remarks=("a remark",))
    page = write_budget("a gauge", budget, tmp_path).read_text()
    assert "&lt;noise&gt;" in page and "a remark" in page and "data:image/png" in page
    assert '"share": 0.9' in (tmp_path / "report.json").read_text()
