"""A plan as data: how a scene is run, its stages, and what they cost by kinds of work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gpusim.graph.graph import State
from gpusim.plan.machine_speed import Speed, Workload

START_SECONDS = 1.5
"""What Python and its libraries take before the first stage."""


@dataclass(frozen=True)
class RunOptions:
    """``backend`` "gpu" or "numpy". ``fresh`` ignores the results of earlier runs.

    ``skip=False`` switches every shortcut off: nothing is reused, what the loads make trivial is
    computed all the same, frames that show the same are rendered again, whole images are, not the
    parts alone that aren't background, and the renderer goes without its shortcuts. What is passed
    on of it stands here: `for_solver`, `for_renderer`.
    """

    backend: str
    fresh: bool = False
    skip: bool = True

    @property
    def no_reuse(self) -> str:
        """The option that forbids to reuse earlier results; "" if none does."""
        return "--no-skip" if not self.skip else "--fresh" if self.fresh else ""

    def for_solver(self) -> dict[str, Any]:
        """Keyword arguments of `gpusim.fem.solve`."""
        # a software adapter is the host's own processors: no detour through it
        return {"backend": "auto" if self.backend == "gpu" else self.backend}

    def for_renderer(self) -> dict[str, Any]:
        """Keyword arguments of `gpusim.optics.lens.exposure.photograph`."""
        return {"backend": self.backend, "shortcuts": self.skip}


@dataclass(frozen=True)
class PlannedStage:
    """One stage and what is done with it.

    ``detail`` says how much work it is; ``memory_bytes`` and ``seconds`` are estimates (0 unless
    run), of the latter ``compiling`` for shaders. Render stages, named
    ``render/<camera>/<frame>``, have ``camera`` and ``frame``; those of a calibration target,
    ``render/<camera>/calib-<pose>``, ``pose`` instead.
    """

    name: str
    state: State
    reason: str
    memory_bytes: int
    seconds: float
    key: str
    detail: str = ""
    camera: str | None = None
    frame: int | None = None
    pose: int | None = None
    compiling: float = 0.0

    @property
    def runs(self) -> bool:
        """Whether there is work to do."""
        return self.state == "run"

    @property
    def kind(self) -> str:
        """The kind of work: "mesh", "render", "target", …"""
        return "target" if self.pose is not None else self.name.split("/")[0]


@dataclass(frozen=True)
class Plan:
    """Every stage in the order of work, and what is doubtful about the scene.

    ``works``: the same by kinds of work, for `gpusim.plan.machine_speed`.
    """

    scene: str
    backend: str
    stages: tuple[PlannedStage, ...]
    warnings: tuple[str, ...] = ()
    works: tuple[Workload, ...] = ()

    def __getitem__(self, name: str) -> PlannedStage:
        """The stage of that name. Raises KeyError."""
        for stage in self.stages:
            if stage.name == name:
                return stage
        raise KeyError(name)

    @property
    def seconds(self) -> float:
        """Estimated time of everything that is run, from the start of the program on."""
        running = sum(stage.seconds for stage in self.stages)
        return START_SECONDS + running if running else 0.0

    @property
    def memory_bytes(self) -> int:
        """Estimated memory of the largest stage that is run."""
        return max((stage.memory_bytes for stage in self.stages), default=0)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        names = ("name", "state", "reason", "detail", "memory_bytes", "seconds", "key")
        return {
            "scene": self.scene,
            "backend": self.backend,
            "seconds": round(self.seconds, 2),
            "memory_bytes": self.memory_bytes,
            "stages": [{name: getattr(stage, name) for name in names} for stage in self.stages],
            "warnings": list(self.warnings),
        }


def works_of(stages: Sequence[PlannedStage], size: str) -> dict[str, Workload]:
    """What is run of each kind, by the seconds of the machine that costs were measured on; ``size``
    of the scene goes with all of it."""
    kinds: dict[str, list[PlannedStage]] = {}
    for stage in stages:
        if stage.runs:
            kinds.setdefault(stage.kind, []).append(stage)
    return {
        kind: Workload(
            kind,
            "; ".join([size, *(stage.detail for stage in own)]),
            sum(stage.seconds for stage in own),
            sum(stage.compiling for stage in own),
        )
        for kind, own in kinds.items()
    }


def timed(
    stages: Sequence[PlannedStage], works: Mapping[str, Workload], speed: Speed
) -> list[PlannedStage]:
    """The stages with the seconds that they take at a machine's speed."""
    share = {kind: speed.seconds(work) / work.seconds for kind, work in works.items()}
    return [
        replace(stage, seconds=stage.seconds * share[stage.kind],
                compiling=stage.compiling * share[stage.kind]) if stage.runs else stage
        for stage in stages
    ]  # fmt: skip
