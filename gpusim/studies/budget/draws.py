"""What the keys of a budget's sources are in each draw.

Numbers are scrambled Sobol points (Owen, J. Complexity 1998, 14(4), 466): distributions are filled
evenly, and numbers of different sources hardly correlate by chance. Draw n of all sources together
has the values that draw n of each source has, so that it isn't chance which makes the difference
between the sum of their squares and what they do together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm, qmc

from gpusim.arrays.array_types import Float
from gpusim.scene import Scene
from gpusim.scene.faults.key_paths import pick
from gpusim.studies.budget.sources import Sources
from gpusim.studies.budget_tables import BudgetSourceTable, BudgetTable
from gpusim.validation import require

_ITEMS = 16  # of a list that a key holds, at most
Overrides = dict[str, Any]


@dataclass(frozen=True, eq=False)
class SourceValues:
    """A source ``name`` as it was drawn N times: ``overrides`` of the scene, ``nominal`` where it
    isn't drawn, ``values`` (N, P) of its ``parameters``, NaN for what is no quantity."""

    name: str
    parameters: tuple[str, ...]
    values: Float
    nominal: Overrides
    overrides: Sequence[Overrides]
    degrees_of_freedom: float | None


def draw(scene: Scene, sources: Sources, tables: BudgetTable) -> list[SourceValues]:
    """All sources, each drawn ``tables.draws`` times. Raises InputError for a key that the scene
    hasn't got, or that can't be drawn like that."""
    document, count = scene.document, tables.draws
    items = _ITEMS * sum(len(own.keys) for group in sources.values() for own in group)
    points = qmc.Sobol(max(items, 1), rng=tables.seed).random_base2((count - 1).bit_length())
    evenly, found, owners = iter(points[:count].T), [], dict[str, str]()
    for name, group in sources.items():
        nominal: Overrides = {}
        changes: dict[str, list[Any]] = {}
        columns: dict[str, Float] = {}
        for own in group:
            nominal |= own.set
            common = next(evenly) if own.together or own.choices else None
            for key in own.keys:
                got, where = f"a key of {owners.get(key)!r}, too", f"budget source {name!r}: {key}"
                require(key not in owners, where, got, "each key in one source")
                owners[key] = name
                nominal.setdefault(key, pick(document, key))
                changes[key], numbers = _drawn(own, key, nominal[key], evenly, common, count)
                columns |= numbers
        rows = [dict(zip(changes, row, strict=True)) for row in zip(*changes.values(), strict=True)]
        freedom = [one.degrees_of_freedom for one in group if one.degrees_of_freedom]
        values = np.column_stack([*columns.values()])
        found.append(
            SourceValues(name, tuple(columns), values, nominal, rows, min(freedom, default=None))
        )
    return found


def _drawn(
    own: BudgetSourceTable, key: str, nominal: Any, evenly: Iterator[Float], common: Float | None,
    count: int,
) -> tuple[list[Any], dict[str, Float]]:  # fmt: skip
    """Values of a key, and its numbers (N,) by their names; ``common``: what all keys of the source
    are drawn by."""
    is_list = isinstance(nominal, list | tuple)
    items = list(nominal) if is_list else [nominal]
    kinds = (int,) if own.seeds else (int, float)
    what = "seed" if own.seeds else "number or a list of numbers"
    expected = f"a key of the scene with a {what}"
    where = f"budget source {own.name!r}: {key}"
    fits = own.choices or (items and all(type(one) in kinds for one in items))
    require(bool(fits), where, repr(nominal), expected)
    require(own.percent is None or all(items), where, f"percent of {nominal}", "normal")
    if own.seeds:
        return [nominal + 1 + number for number in range(count)], {key: np.full(count, np.nan)}
    if own.choices is not None and common is not None:
        picked = [own.choices[int(one)] for one in common * len(own.choices)]
        known = all(type(one) in (int, float) for one in picked)
        return picked, {key: np.array(picked if known else [np.nan] * count, dtype=np.float64)}
    numbers = {}
    for k, item in enumerate(items):
        share = next(evenly) if common is None else common
        if own.half_width is not None:
            off = own.half_width * (2.0 * share - 1.0)
        else:
            off = norm.ppf(share) * (own.normal or abs(item) * (own.percent or 0.0) / 100.0)
        numbers[f"{key}.{k}" if is_list else key] = item + off
    rows = np.column_stack([*numbers.values()])
    return (rows if is_list else rows[:, 0]).tolist(), numbers


def together(drawn: Sequence[SourceValues]) -> list[Overrides]:
    """The draws of all sources at once."""
    every = zip(*(one.overrides for one in drawn), strict=True)
    return [{key: value for own in row for key, value in own.items()} for row in every]
