"""What is done with each result of a run, before any work: its graph, against what lies there."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from gpusim.files.output_folder import inside
from gpusim.graph.folder import INNER, Folder
from gpusim.graph.graph import Graph, State, Task
from gpusim.graph.store import Store
from gpusim.plan.scene_stages import PUBLIC, SceneStages, scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene


@dataclass(frozen=True)
class PublicStage:
    """A stage as people know it: ``tasks`` of one place, and what is done with them."""

    name: str
    state: State
    reason: str
    tasks: tuple[Task, ...] = ()

    @property
    def runs(self) -> bool:
        """Whether there is work to do."""
        return self.state == "run"


@dataclass(frozen=True, eq=False)
class Decision:
    """The graph of some ``scenes``, decided: by place, a folder's name in the output folder ("":
    itself)."""

    scenes: Mapping[str, Scene]
    stages: Mapping[str, SceneStages]
    graph: Graph
    folders: Mapping[str, Folder]
    store: Store | None
    options: RunOptions

    def public(self, place: str) -> list[PublicStage]:
        """The stages of a scene in the order in which data passes."""
        tasks: dict[str, list[Task]] = {}
        for keys in self.graph.records[place].values():
            for record, key in enumerate(keys):
                task = self.graph.tasks[key]
                name = task.stage.public(record)
                # a value that several records share belongs to the first
                if name and (place, record) == task.first_in(place):
                    tasks.setdefault(name, []).append(task)
        found = [_public(name, place, own) for name, own in tasks.items()]
        found += [
            PublicStage(kind, "skipped", reason)
            for kind, reason in self.stages[place].skipped.items()
        ]
        return sorted(found, key=lambda stage: PUBLIC.index(stage.name.split("/")[0]))


def states_of(scene: Scene) -> dict[str, Scene]:
    """The scenes that a run of ``scene`` makes, by place: its variants, or itself."""
    if not scene.variants:
        return {"": scene}
    return {f"variants/{one.name}": scene.variant(one.name) for one in scene.variants}


def decide(
    scenes: Mapping[str, Scene],
    out: Path | None,
    options: RunOptions,
    store: Path | None = None,
    verify: bool = False,
    targets: Collection[str] | None = None,
) -> Decision:
    """Plan a run of ``scenes`` into places of ``out`` (None: nothing can be reused).

    ``store``: the folder of results that runs share; without it ``out`` has its own. ``verify``:
    results are looked at byte by byte, not by size and time of change. ``targets``: stages that are
    wanted, by default all.
    """
    graph = Graph()
    stages = {place: scene_stages(scene, options) for place, scene in scenes.items()}
    for place, own in stages.items():
        graph.add(own.stages, place)
    folders, kept = {}, None
    if out is not None:
        folders = {place: Folder(inside(out, place) if place else out) for place in scenes}
        kept = Store(store if store is not None else inside(out, INNER))
    graph.decide(kept, folders, no_reuse=options.no_reuse, verify=verify, targets=targets)
    return Decision(scenes, stages, graph, folders, kept, options)


def _public(name: str, place: str, tasks: list[Task]) -> PublicStage:
    """What becomes of a stage's tasks, taken together."""
    running = [task for task in tasks if task.runs]
    own = [task for task in running if task.places[0][0] == place]
    own.sort(key=lambda task: not task.stage.keeps)  # a file's reason says more
    if own:
        return PublicStage(name, "run", own[0].reason, tuple(tasks))
    if running:
        maker = running[0].places[0][0].rsplit("/", 1)[-1] or "the scene itself"
        return PublicStage(name, "reused", f"made for {maker}", tuple(tasks))
    kept = next((task for task in tasks if task.stage.keeps), tasks[0])
    return PublicStage(name, kept.state, kept.reason, tuple(tasks))
