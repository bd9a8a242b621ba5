"""What a study would make, before any work: distinct meshes, solutions and pictures.

To build every sample's scene would take as long as a small picture. So the stages of a few scenes
are compared: of one sample, and of that with one key changed. They tell what depends on which key,
and as many results are made of it as those keys have different values together.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Long
from gpusim.errors import Fault, InputError, SceneError
from gpusim.graph.graph import Graph, Task
from gpusim.plan.decision import Decision
from gpusim.plan.machine_speed import Speed
from gpusim.plan.plan import plan_of
from gpusim.plan.scene_stages import scene_stages
from gpusim.plan.stages import Plan, RunOptions
from gpusim.scene import Scene
from gpusim.scene import cost as cost_of
from gpusim.scene.faults.key_paths import put
from gpusim.studies.batch import targets
from gpusim.studies.samples import Sample
from gpusim.studies.study_tables import Study

_MOST_VALUES = 8
"""Of a list that are each tried; of longer ones the smallest and the largest."""
_STRUCTURE = "mesh", "model", "solve"
_COUNTED = {"mesh": "mesh", "solve": "solve", "picture": "render", "calib-picture": "render",
            "radiance": "radiance", "target": "radiance", "measure": "measure"}  # fmt: skip
_WORDS = {"mesh": "meshes", "solve": "solutions", "render": "pictures", "measure": "measurements"}
_NOWHERE = "unknown key", "no such item", "has no keys inside", "not a key path"
_PER_PIXEL = 2  # bytes that pictures and what is measured in them take, about


@dataclass(frozen=True)
class StudyPlan:
    """What would be made of the ``samples`` that are still to be made.

    ``distinct``: results by what people call them; ``structures``: a number for each sample, equal
    for those that share meshes and solutions; ``seconds`` on one worker, ``bytes`` on the disk,
    ``memory_bytes`` of each worker.
    """

    samples: int
    distinct: Mapping[str, int]
    structures: Long
    seconds: float
    bytes: int
    memory_bytes: int

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        names = ("samples", "seconds", "bytes", "memory_bytes")
        return {"distinct": dict(self.distinct)} | {name: getattr(self, name) for name in names}


def study_plan(study: Study, samples: Sequence[Sample]) -> StudyPlan:
    """Plan some samples of a study; not those that constraints refuse.

    Examples
    --------
    >>> from gpusim.studies import load_study, samples_of, study_plan
    >>> from pathlib import Path
    >>> _ = Path("study.toml").write_text('''scene = "bar.toml"
    ... repeats = 4
    ... [[parameter]]
    ... key = "camera.side.focal_mm"
    ... list = [49.0, 51.0]
    ... ''')
    >>> study = load_study("study.toml")
    >>> dict(study_plan(study, samples_of(study)).distinct)
    {'meshes': 1, 'solutions': 1, 'pictures': 16, 'measurements': 8}
    """
    samples = [sample for sample in samples if not sample.refused]
    return _Planning(study, samples).plan()


class _Planning:
    """Of ``samples``, none of them refused by a constraint."""

    def __init__(self, study: Study, samples: Sequence[Sample]) -> None:
        self.study, self.samples = study, samples
        self.options = RunOptions(study.backend)

    def plan(self) -> StudyPlan:
        if self._first is None:
            return StudyPlan(0, {}, np.zeros(len(self.samples), dtype=int), 0.0, 0, 0)
        graph, plan = self._decided
        share, made = Counter[str](), Counter[str]()
        counts: dict[frozenset[str], int] = {}
        for task in graph.tasks.values():
            kind = _COUNTED.get(task.stage.name.split("/")[0])
            if not task.runs or kind is None:
                continue
            keys = frozenset(key for key in self._codes if self._touches(key, task))
            if keys not in counts:
                counts[keys] = len(np.unique(self._projected(keys)))
            share[kind] += 1
            made[kind] += counts[keys]
        seconds: dict[str, float] = defaultdict(float)
        for stage in plan.stages:
            kind = "radiance" if stage.kind in ("render", "target") else stage.kind
            seconds[kind] += stage.seconds - stage.compiling
        again = max(map(cost_of.exposing_seconds, self._first.cameras), default=0.0)
        spent = again * (made["render"] - made["radiance"])
        spent += sum(stage.compiling for stage in plan.stages)  # once
        spent += sum(seconds[kind] / share[kind] * made[kind] for kind in share)
        structure = {
            key for key in self._codes for task in graph.tasks.values()
            if task.stage.public(task.record).split("/")[0] in _STRUCTURE
            and self._touches(key, task)
        }  # fmt: skip
        pixels = sum(columns * rows for columns, rows in
                     (one.resolution for one in self._first.cameras))  # fmt: skip
        stays = self.study.tables.keep == "results"
        per_camera = made["render"] / max(len(self._first.cameras), 1)
        return StudyPlan(
            len(self.samples),
            {word: made[kind] for kind, word in _WORDS.items()},
            self._projected(structure), spent,
            int(_PER_PIXEL * per_camera * pixels) * stays, plan.memory_bytes,
        )  # fmt: skip

    @cached_property
    def _base(self) -> Sample | None:
        """A sample whose scene is right."""
        return next((one for one in self.samples if self._scene(one) is not None), None)

    @cached_property
    def _first(self) -> Scene | None:
        return None if self._base is None else self._base.scene(self.study)

    def _scene(self, sample: Sample) -> Scene | None:
        try:
            return sample.scene(self.study)
        except SceneError:
            return None

    @cached_property
    def _decided(self) -> tuple[Graph, Plan]:
        """The graph of one sample, as far as samples need it, and its plan."""
        assert self._first is not None
        graph, stages = Graph(), scene_stages(self._first, self.options)
        graph.add(stages.stages)
        graph.decide(None, {}, targets=targets(self.study, self._first))
        decision = Decision({"": self._first}, {"": stages}, graph, {}, None, self.options)
        return graph, plan_of(self._first, decision, Speed.read(self.study.backend))

    @cached_property
    def _codes(self) -> dict[str, Long]:
        """By key that differs between samples, a number for each of its values."""
        found = {}
        for key in self.samples[0].overrides if self.samples else ():
            numbers: dict[str, int] = {}
            texts = [json.dumps(one.overrides[key]) for one in self.samples]
            codes = [numbers.setdefault(text, len(numbers)) for text in texts]
            if len(numbers) > 1:
                found[key] = np.array(codes)
        return found

    def _projected(self, keys: set[str] | frozenset[str]) -> Long:
        """A number for each sample, equal where all of some keys are."""
        found = np.zeros(len(self.samples), dtype=np.int64)
        for key in sorted(keys):
            _, found = np.unique(
                found * (self._codes[key].max() + 1) + self._codes[key], return_inverse=True
            )
        return found

    def _touches(self, key: str, task: Task) -> bool:
        """Whether a record of a stage depends on a key."""
        other = self._changed[key]
        if other is None:  # nobody knows
            return True
        mine, others = self._decided[0].records[""], other.records[""]
        name = task.stage.name
        if name not in others or len(others[name]) != len(mine[name]):
            return True
        return others[name][task.record] != mine[name][task.record]

    @cached_property
    def _changed(self) -> dict[str, Graph | None]:
        """By key, the graph of the one sample with that key as some other sample has it."""
        assert self._base is not None
        found: dict[str, Graph | None] = {}
        for key, codes in self._codes.items():
            found[key] = None
            own = codes[self.samples.index(self._base)]
            for place in np.flatnonzero(codes != own)[[0, -1]]:
                value = self.samples[place].overrides[key]
                changed = {**self._base.overrides, key: value}
                scene = self._scene(replace(self._base, overrides=changed))
                if scene is not None:
                    found[key] = graph = Graph()
                    graph.add(scene_stages(scene, self.options).stages)
                    break
        return found


def check_samples(study: Study, samples: Sequence[Sample]) -> None:
    """Look at the samples in which a key is smallest and largest, and at every value of short
    lists. Raises SceneError for keys that there aren't, and for values that a key never takes; what
    is wrong in a sample for other reasons is its own affair."""
    _check_keys(study, samples)
    faults: dict[str, Fault] = {}
    for key, first, last in _extremes([one for one in samples if not one.refused]):
        found = [*_faults(study, first)]
        if found and (first is last or any(_faults(study, last))):
            for fault in found:
                if fault.problem.startswith(_NOWHERE) or _is_alone(study, first, key, fault):
                    faults.setdefault(fault.key, fault)
    if faults:
        raise SceneError(study.source, list(faults.values()))


def _check_keys(study: Study, samples: Sequence[Sample]) -> None:
    """Raises InputError for a key that overwrites what an earlier one has put."""
    document, places = study.scene.document, dict[tuple[str | int, ...], str]()
    for key, value in samples[0].overrides.items() if samples else ():
        place = put(document, key, value)
        if isinstance(place, Fault):  # `check_samples` says so
            continue
        for earlier, name in places.items():
            if earlier[: len(place)] == place:
                raise InputError(f"{study.source}: {key} overwrites {name}; expected each key once")
        places[place] = key


def _faults(study: Study, sample: Sample) -> Sequence[Fault]:
    try:
        sample.scene(study)
    except SceneError as error:
        return error.faults
    return ()


def _extremes(samples: Sequence[Sample]) -> Iterator[tuple[str, Sample, Sample]]:
    """Keys, and the first and the last sample with a value that is to be looked at for its sake."""
    for key in samples[0].overrides if samples else ():
        first: dict[str, Sample] = {}
        last: dict[str, Sample] = {}
        for sample in samples:
            text = json.dumps(sample.overrides[key])
            first.setdefault(text, sample)
            last[text] = sample
        chosen = list(first)
        if len(first) > _MOST_VALUES:
            kinds: dict[type, list[Any]] = {}
            for sample in first.values():
                kinds.setdefault(type(sample.overrides[key]), []).append(sample.overrides[key])
            chosen = [
                json.dumps(pick(own, key=lambda value: value if is_number else json.dumps(value)))
                for kind, own in kinds.items()
                for is_number in (kind in (int, float),) for pick in (min, max)
            ]  # fmt: skip
        yield from ((key, first[text], last[text]) for text in chosen)


def _is_alone(study: Study, sample: Sample, key: str, fault: Fault) -> bool:
    """Whether a fault of a sample is one of a key's value, whatever others are."""
    place = put(study.scene.document, key, sample.overrides[key])
    if isinstance(place, Fault):
        return True
    path = ".".join(map(str, place))
    if not f"{fault.key}.".startswith(f"{path}."):
        return False
    alone = _faults(study, replace(sample, overrides={key: sample.overrides[key]}))
    return any(f"{one.key}.".startswith(f"{path}.") for one in alone)
