"""The samples of a study: what each changes in the base scene, and the key of its row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from gpusim._version import __version__
from gpusim.errors import InputError
from gpusim.graph.stage import digest
from gpusim.scene import Scene
from gpusim.scene.faults.key_paths import pick
from gpusim.scene.files import find_files
from gpusim.scene.shared_tables import SharedTables
from gpusim.studies.design import points
from gpusim.studies.expressions import Values, evaluated
from gpusim.studies.study_tables import Study

_BUDGET = "gpusim.studies.budget.budget_study"  # it makes samples itself


@dataclass(frozen=True)
class Sample:
    """One state of the base scene.

    number : its place in the study, from 0.
    repeat : which of the repeats of its point.
    values : what the parameters are, by their labels.
    overrides : what is changed in the scene, by dotted key; seeds and derived values included.
    key : SHA-256 of what its results depend on.
    refused : the constraint that it doesn't fulfil, or "".
    """

    number: int
    repeat: int
    values: Mapping[str, Any]
    overrides: Mapping[str, Any]
    key: str = field(repr=False)
    refused: str = ""

    def scene(self, study: Study, known: SharedTables | None = None) -> Scene:
        """The scene in this state, with the tables of others of the study that are ``known``.
        Raises SceneError for one that isn't right."""
        base = study.scene
        return Scene.from_document(
            base.document, source=f"{base.source}, sample {self.number}",
            overrides=self.overrides, folder=Path(base.source).parent, files=base.files,
            resolved=all(map(_is_numeric, self.overrides.values())), known=known,
        )  # fmt: skip


def samples_of(study: Study) -> Sequence[Sample]:
    """All samples of a study, point by point, the repeats of a point one after the other.

    Raises InputError for an expression that can't be evaluated, and as `points`.

    Examples
    --------
    >>> from gpusim.studies import load_study, samples_of
    >>> from pathlib import Path
    >>> _ = Path("study.toml").write_text('''scene = "bar.toml"
    ... repeats = 2
    ... [[parameter]]
    ... key = "camera.side.focal_mm"
    ... list = [49.0, 51.0]
    ... ''')
    >>> [one.overrides for one in samples_of(load_study("study.toml"))][1]
    {'camera.side.focal_mm': 49.0, 'sensor.seed': 1}
    """
    if study.tables.budget is not None:
        samples: Sequence[Sample] = import_module(_BUDGET).budget_samples(study)
        return samples
    tables, columns = study.tables, points(study)
    count = len(next(iter(columns.values()), [()]))
    arrays = {name: _array(values) for name, values in columns.items()}
    keys = {one.label: one.key for one in tables.parameter}
    changes = {keys.get(name, name): values for name, values in columns.items()}
    wrong = np.zeros(count, dtype=bool)
    for entry in tables.derived:
        changes[entry.key], infinite = _derived(entry.value, arrays, count, entry.key)
        wrong |= infinite
    refused = np.where(wrong, "a derived value is no finite number", "").astype(object)
    for text in (one.expression for one in tables.constraint):
        fulfilled = evaluated(text, arrays, f"constraint {text!r}")
        if fulfilled.dtype.kind != "b":
            raise InputError(
                f"constraint {text!r}: a number; expected a comparison, like a < 2 * b"
            )
        refused[~np.broadcast_to(fulfilled, count) & (refused == "")] = f"constraint {text}"
    seeds = {key: _seed(study, key, changes) for key in tables.seeds if tables.repeats > 1}
    head = digest([__version__, study.backend, study.scene.digest()])
    contents = _files(study, changes)
    found: list[Sample] = []
    for point in range(count):
        values = {name: own[point] for name, own in columns.items()}
        changed = {key: own[point] for key, own in changes.items()}
        named = [contents[one] for one in _texts([*changed.values()]) if one in contents]
        for repeat in range(tables.repeats):
            whole = changed | {key: first[point] + repeat for key, first in seeds.items()}
            key = digest([head, whole, named])
            found.append(Sample(len(found), repeat, values, whole, key, refused[point]))
    return found


def _is_numeric(value: Any) -> bool:
    """Whether there is nothing but numbers in it, so that it can't name a file."""
    return (
        all(map(_is_numeric, value))
        if isinstance(value, list | tuple)
        else not isinstance(value, str | dict)
    )


def _array(values: Sequence[Any]) -> Values:
    """A column for expressions: numbers, or whatever there is as objects."""
    if all(type(one) in (int, float) for one in values):
        return np.array(values, dtype=np.float64)
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array


def _derived(
    value: Any, columns: Mapping[str, Values], count: int, key: str
) -> tuple[list[Any], Values]:
    """A derived value at each point, and where it isn't finite. Whole numbers are given as such:
    a key may want one, and any that takes numbers takes them."""
    if isinstance(value, tuple | list):
        parts = [_derived(one, columns, count, key) for one in value]
        lists = [list(one) for one in zip(*(part for part, _ in parts), strict=True)]
        return lists, np.any([infinite for _, infinite in parts], axis=0)
    if not isinstance(value, str):
        whole = isinstance(value, float) and value.is_integer()
        return [int(value) if whole else value] * count, np.zeros(count, dtype=bool)
    found = evaluated(value, columns, f"derived {key}: {value!r}")
    if found.dtype.kind != "f":
        raise InputError(f"derived {key}: {value!r} is a comparison; expected a number")
    finite = np.isfinite(numbers := np.broadcast_to(found, count))
    plain = [int(one) if one.is_integer() else one for one in np.where(finite, numbers, 0).tolist()]
    return plain, ~finite


def _seed(study: Study, key: str, changes: Mapping[str, Sequence[Any]]) -> Sequence[int]:
    """What a key that counts up begins with, at each point."""
    count = len(next(iter(changes.values()), [()]))
    first = changes.get(key) or [pick(study.scene.document, key)] * count
    if not all(type(one) is int for one in first):
        got = f"{first[0]!r}" if first[0] is not None else "no such key"
        raise InputError(f"{study.source}: seeds: {key}; got {got}; expected a whole number there")
    return first


def _files(study: Study, changes: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
    """SHA-256 of the files that values name, with those that they name."""
    folder = Path(study.scene.source).parent
    texts = {one for values in changes.values() for one in _texts(values)}
    named = [text for text in texts if "." in text and (folder / text).is_file()]
    return {text: find_files({"body": [{"mesh": {"file": text}}]}, folder, {})[1] for text in named}


def _texts(value: Any) -> Iterator[str]:
    """The texts in a value, and in lists and tables of it."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | tuple | dict):
        for one in value.values() if isinstance(value, dict) else value:
            yield from _texts(one)
