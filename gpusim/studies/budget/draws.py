"""What the keys of a budget's sources are in each draw.

Numbers are scrambled Sobol points (Owen, J. Complexity 1998, 14(4), 466): distributions are filled
evenly, and numbers of different sources hardly correlate by chance. Draw n of all sources
together has the values that draw n of each source has, so that it isn't chance which makes the
difference between the sum of their squares and what they do together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm, qmc

from gpusim.arrays.array_types import Float
from gpusim.scene import Scene
from gpusim.scene.faults.key_paths import pick
from gpusim.studies.budget_tables import BudgetSourceTable, BudgetTable
from gpusim.studies.budget.sources import Sources
from gpusim.validation import require

Overrides = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Drawn:
    """A source ``name`` as it was drawn N times: ``overrides`` of the scene, ``values`` (N, P) of
    its ``parameters``, NaN for what is no quantity."""

    name: str
    parameters: tuple[str, ...]
    values: Float
    overrides: Sequence[Overrides]
    degrees_of_freedom: float | None


def draw(scene: Scene, sources: Sources, tables: BudgetTable) -> list[Drawn]:
    """All sources, each drawn ``tables.draws`` times. Raises InputError for a key that the scene
    hasn't got, or that can't be drawn like that."""
    sizes = _sizes(scene, sources)
    needed = sum(
        1 if own.together or own.choices else sum(len(one) for one in nominal.values())
        for group in sizes.values() for own, nominal in group if not own.seeds
    )  # fmt: skip
    count = tables.draws
    points = qmc.Sobol(max(needed, 1), rng=tables.seed).random_base2((count - 1).bit_length())
    evenly = iter(points[:count].T)
    found = []
    for name, group in sizes.items():
        changes: dict[str, Sequence[Any]] = {}
        columns: dict[str, Float] = {}
        for own, nominal in group:
            for key, values, labels in _drawn(own, nominal, evenly, count):
                columns |= labels
                changes[key] = values
        rows = [dict(zip(changes, row, strict=True)) for row in zip(*changes.values(), strict=True)]
        freedom = [one.degrees_of_freedom for one, _ in group if one.degrees_of_freedom]
        found.append(Drawn(name, tuple(columns), np.column_stack([*columns.values()]), rows,
                           min(freedom, default=None)))  # fmt: skip
    return found


def undrawn(scene: Scene, sources: Sources) -> Overrides:
    """What all keys of the sources are where they aren't drawn. Raises as `draw`."""
    found: Overrides = {}
    for group in _sizes(scene, sources).values():
        for own, nominal in group:
            found |= own.set
            for key, items in nominal.items():
                found.setdefault(key, items if _is_list(own, key, items) else items[0])
    return found


def together(drawn: Sequence[Drawn]) -> list[Overrides]:
    """The draws of all sources at once."""
    every = zip(*(one.overrides for one in drawn), strict=True)
    return [{key: value for own in row for key, value in own.items()} for row in every]


def _sizes(
    scene: Scene, sources: Sources
) -> dict[str, list[tuple[BudgetSourceTable, dict[str, list[Any]]]]]:
    """By source its tables, each with what its keys are in the scene."""
    document = scene.document
    return {
        name: [(own, _nominal(own, document)) for own in group] for name, group in sources.items()
    }


def _is_list(own: BudgetSourceTable, key: str, items: Sequence[Any]) -> bool:
    return isinstance(own.set.get(key), list | tuple) or len(items) > 1


def _nominal(own: BudgetSourceTable, document: Mapping[str, Any]) -> dict[str, list[Any]]:
    """What the keys are in the scene, as lists."""
    found = {}
    for key in own.keys:
        value = own.set.get(key, pick(document, key))
        items = list(value) if isinstance(value, list | tuple) else [value]
        expected = "a key of the scene with a number or a list of numbers"
        if own.seeds:
            expected = "a key of the scene with a seed"
        kinds = (int,) if own.seeds else (int, float)
        fits = bool(items) and (own.choices is not None or all(type(one) in kinds for one in items))
        require(fits, f"budget source {own.name!r}: {key}", repr(value), expected)
        fits = own.percent is None or all(items)
        require(fits, f"budget source {own.name!r}: {key}", f"percent of {value}", "normal")
        found[key] = items
    return found


def _drawn(
    own: BudgetSourceTable, nominal: Mapping[str, list[Any]], evenly: Iterator[Float], count: int
) -> Iterator[tuple[str, Sequence[Any], dict[str, Float]]]:
    """Key, its values in each draw, and columns of numbers by their labels."""
    nothing = np.full(count, np.nan)
    common = next(evenly) if own.choices or own.together and not own.seeds else None
    for key, items in nominal.items():
        if own.seeds:
            yield key, [items[0] + 1 + number for number in range(count)], {key: nothing}
        elif own.choices is not None:
            assert common is not None
            picked = [own.choices[int(one)] for one in common * len(own.choices)]
            numbers = all(type(one) in (int, float) for one in own.choices)
            yield key, picked, {key: np.array(picked, np.float64) if numbers else nothing}
        else:
            shares = [next(evenly) if common is None else common for _ in items]
            offs = [_off(own, one, item) for one, item in zip(shares, items, strict=True)]
            rows = np.column_stack(offs) + np.array(items, dtype=np.float64)
            is_list = _is_list(own, key, items)
            labels = [f"{key}.{k}" for k in range(len(items))] if is_list else [key]
            yield (key, rows.tolist() if is_list else rows[:, 0].tolist(),
                   dict(zip(labels, rows.T, strict=True)))  # fmt: skip


def _off(own: BudgetSourceTable, share: Float, nominal: float) -> Float:
    """By how much a number is off where so large a ``share`` (N,) of its distribution is less."""
    if own.half_width is not None:
        return np.asarray(own.half_width * (2.0 * share - 1.0))
    sigma = own.normal if own.percent is None else abs(nominal) * own.percent / 100.0
    return np.asarray(sigma * norm.ppf(share))
