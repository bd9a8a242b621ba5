"""Expressions: what they are worth, and that nothing else is ever evaluated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.studies.expressions import evaluated

COLUMNS = {"a": np.array([1.0, 2.5, -3.0]), "b.c": np.array([2.0, 0.5, 4.0]),
           "word": np.array(["x", "y", "z"], dtype=object)}  # fmt: skip


@pytest.mark.parametrize(
    "text",
    ["1 + 2 * a", "-a ** 2 / b_c", "sqrt(abs(a)) + exp(b_c) - log(b_c)", "min(a, b_c, 1)",
     "max(a, 0) + round(a)", "sin(pi * a) + cos(a) * tan(b_c)", "2 ** -b_c", "+a - (b_c - 1)"],
)  # fmt: skip
def test_values_are_those_of_python(text: str) -> None:
    known = {
        name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "pi")
    }
    rows = zip(COLUMNS["a"].tolist(), COLUMNS["b.c"].tolist(), strict=True)
    truth = [
        eval(text, {**known, "abs": abs, "min": min, "max": max, "round": round, "a": a, "b_c": b})
        for a, b in rows
    ]
    np.testing.assert_allclose(evaluated(text.replace("b_c", "b.c"), COLUMNS, "here"), truth)


def test_comparisons_are_joined() -> None:
    found = evaluated("0 < a < 2 * b.c and not a == 1 or a < -2", COLUMNS, "here")
    assert found.tolist() == [False, False, True]


@pytest.mark.parametrize("text", ["{} != 5", "not {} > 5", "not (a > 9 or {} == 5)", "{} >= 0"])
def test_what_has_no_value_passes_no_comparison(text: str) -> None:
    found = evaluated(text.format("sqrt(a)"), COLUMNS, "here")
    assert found.tolist() == [True, True, False]


def test_what_has_no_value_is_not_finite() -> None:
    assert not np.isfinite(evaluated("1 / (a - 1) + log(a)", COLUMNS, "here"))[[0, 2]].any()


@pytest.mark.parametrize(
    "text",
    ["__import__('os').system('true')", "a.__class__", "().__class__", "[a for a in (1, 2)]",
     "lambda: 1", "open('x')", "f'{a}'", "'text'", "True", "a if a else 1", "sqrt(x=1)", "a @ a",
     "sqrt", "1j", "a = 1", "import os", "", "(" * 400, "a[0]", "word + 1", "sqrt()", "min()",
     "log(a, a)", "9" * 400, "a // 2", "a; a"],
)  # fmt: skip
def test_anything_else_is_one_clear_error(text: str) -> None:
    with pytest.raises(InputError, match="here") as caught:
        evaluated(text, COLUMNS, "here")
    assert "\n" not in str(caught.value)


def test_unknown_name_has_its_nearest() -> None:
    with pytest.raises(InputError, match=r"unknown name; got sqr; .*did you mean sqrt"):
        evaluated("2 * sqr", COLUMNS, "here")
