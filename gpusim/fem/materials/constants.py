"""Constants of a material: one clear error for what isn't one number in its range."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpusim.validation import Rule, is_number, require

ANY = Rule("a number", lambda value: True)
POSITIVE = Rule("a number > 0", lambda value: value > 0.0)
FROM_ZERO = Rule("a number >= 0", lambda value: value >= 0.0)
POISSON = Rule("a number in (-1, 0.5)", lambda value: -1.0 < value < 0.5)


def constant(value: Any, what: str, rule: Rule = ANY) -> float:
    """A finite number for which ``rule`` holds. Raises InputError naming ``what`` for anything
    else, an array of one number included."""
    require(is_number(value), what, repr(value), rule.expected)
    try:
        number = float(value)
    except OverflowError:  # a whole number of more than 308 digits
        number = np.inf
    fits = bool(np.isfinite(number)) and rule.fits(number)
    require(fits, f"{what} out of range", number, rule.expected)
    return number
