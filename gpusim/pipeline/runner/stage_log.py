"""What became of a run's stages: told while they are worked off, and afterwards in reports."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from threading import Lock

from gpusim.graph.graph import Task
from gpusim.plan.decision import Decision
from gpusim.plan.plan import Plan
from gpusim.report import Stage

_BEFORE = ("mesh", "model", "surface")
Progress = Callable[[str, float, str], None]


def silent(stage: str, done: float, text: str) -> None:
    """No progress."""


def public_name(place: str, stage: str) -> str:
    """What a stage of a variant is called in the whole: ``<variant>/<stage>``."""
    return f"{place.removeprefix('variants/')}/{stage}" if place else stage


class StageLog:
    """The public stages of a ``decision``. ``progress`` is called by one thread at a time."""

    def __init__(self, decision: Decision, plan: Plan, progress: Progress) -> None:
        self._progress, self._lock = progress, Lock()
        self._public = {place: decision.public(place) for place in decision.scenes}
        self.describe(plan)
        self._left: Counter[tuple[str, str]] = Counter()
        self._names: dict[str, tuple[str, str]] = {}
        self._measured: dict[str, list[str]] = {}
        for place, stages in self._public.items():
            for stage in stages:
                for task in stage.tasks:
                    if task.runs and task.places[0][0] == place and task.key not in self._names:
                        self._names[task.key] = place, stage.name
                        self._left[place, stage.name] += 1

    def describe(self, plan: Plan) -> None:
        """Take the words that are told while a stage works from a plan."""
        self._details = {stage.name: stage.detail for stage in plan.stages}

    def begin(self, place: str) -> None:
        """Tell what isn't run: each stage, of several states how many."""
        others = [stage for stage in self._public[place] if not stage.runs]
        if len(self._public) == 1:
            for stage in others:
                self.tell(stage.name, 1.0, f"{stage.state}: {stage.reason}")
        elif others:
            counts = Counter(stage.state for stage in others).items()
            words = ", ".join(f"{count} {state}" for state, count in counts)
            self.tell(place.removeprefix("variants/") or "scene", 1.0, f"of its stages {words}")

    def observe(self, task: Task, done: float, words: str) -> None:
        """Hear how far a task is."""
        if task.key not in self._names:
            return
        place, stage = self._names[task.key]
        name = public_name(place, stage)
        if done >= 1.0:
            with self._lock:
                self._left[place, stage] -= 1
                whole = not self._left[place, stage]
                if stage == "measure":  # what became of each of them
                    told = self._measured.setdefault(place, [])
                    told.append(words)
                    words = "; ".join(filter(None, told))
            if not whole:
                return
        elif not words:
            words = self._details.get(name, "")
        self.tell(name, done, words)

    def tell(self, name: str, done: float, words: str) -> None:
        """Pass it on."""
        with self._lock:
            self._progress(name, done, words)

    def stages(self, place: str, failed: Task | None = None, why: str = "") -> tuple[Stage, ...]:
        """The stages of a scene that came to their end; of a run that a task ended, with the
        reason ``why``."""
        told = []
        for stage in self._public[place]:
            own = place, stage.name
            seconds = sum(task.seconds for task in stage.tasks if self._names.get(task.key) == own)
            if failed is not None and failed in stage.tasks:
                told.append(Stage(stage.name, "failed", why, seconds))
            elif not stage.runs or not self._left[place, stage.name]:
                told.append(Stage(stage.name, stage.state, stage.reason, seconds))
        if why and not any(stage.state == "failed" for stage in told):  # one that nobody sees
            told.append(
                Stage("report" if failed is None else failed.stage.name, "failed", why, 0.0)
            )
        # as they are worked off: surfaces come before anything is solved
        return tuple(sorted(told, key=lambda stage: stage.name not in _BEFORE))
