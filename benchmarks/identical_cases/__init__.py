"""The cases of `benchmarks.identical`: each is a small function that returns named arrays.

Only public names of gpusim and `benchmarks.faces` are used, so that modules can be moved and
renamed behind them. Scenes are small and without symmetry; every case makes its own objects, so
that it gives the same alone as after others.

`images`, `colors`, `mechanics`, `measuring`, `runs`; what they give, `arrays`.
"""

from benchmarks.identical_cases import colors, images, measuring, mechanics, runs
from benchmarks.identical_cases.arrays import Case

__all__ = ["CASES"]

CASES: dict[str, Case] = {
    **images.CASES, **colors.CASES, **mechanics.CASES, **measuring.CASES, **runs.CASES,
}  # fmt: skip
"""By name; a name's first part is its group."""
