"""Tasks by key, and what is to be done with each: a run's plan, or that of many runs.

A task is a record of a stage. Its key is a hash of gpusim's version, of the stage's name, of the
parts of the scene that its function gets, of the record's row, and of the keys of its needs.
Records of equal key, in whatever scene, are one task. A record that is kept is reused if the store
has the result of its key; values in memory (mesh, model, surface) are made only if a task that runs
needs them. So a new camera renders again and doesn't solve again, and a new load leaves the
unloaded frame alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Literal

from gpusim._version import __version__
from gpusim.graph.folder import Folder
from gpusim.graph.stage import Stage, digest, plain_text
from gpusim.graph.store import Store

State = Literal["run", "skipped", "reused"]
_REPORT = "report"
"""Who needs what is kept and shown nowhere else."""


@dataclass(eq=False, slots=True)
class Task:
    """A record to be made, or found.

    ``needs``: keys of tasks by stage. ``places``: (folder, record) that show it, the first one
    makes it. ``order``: what shares values in memory is worked off side by side: the first
    scene that has them, then the stage's position, the first record that has them, the record, the
    scene. ``seconds``: what it
    took.
    """

    stage: Stage
    record: int
    key: str
    needs: dict[str, list[str]]
    order: tuple[int, int, int, int, int]
    places: list[tuple[str, int]] = field(default_factory=list)
    state: State = "skipped"
    reason: str = ""
    seconds: float = 0.0

    def first_in(self, folder: str) -> tuple[str, int]:
        """The first place in a folder that shows it."""
        return next(place for place in self.places if place[0] == folder)

    @property
    def runs(self) -> bool:
        """Whether there is work to do."""
        return self.state == "run"


class Graph:
    """The tasks of one scene or of many, needs before those who need them.

    ``parts``: by folder and stage, digests of what it depends on.
    """

    def __init__(self) -> None:
        self.tasks: dict[str, Task] = {}
        self.parts: dict[str, dict[str, dict[str, str]]] = {}
        self.records: dict[str, dict[str, list[str]]] = {}
        """By folder and stage, the keys of its records."""
        self._clusters: dict[str, int] = {}
        self._causes: dict[tuple[str, str], set[str]] = {}

    def add(self, stages: Iterable[Stage], folder: str = "") -> None:
        """Enter the stages of a scene, in an order in which needs come first."""
        scene = len(self.parts)
        keys: dict[str, list[str]] = {}
        whole: dict[str, str] = {}
        clusters: dict[str, int] = {}
        in_memory: set[str] = set()
        self.parts[folder], self.records[folder] = {}, keys
        for position, stage in enumerate(stages):
            shared = "".join(whole[name] for name in stage.needs if name in in_memory)
            cluster = self._clusters.setdefault(shared, scene)
            clusters[stage.name] = max([cluster, *(clusters[name] for name in stage.needs)])
            head = digest([__version__, stage.name, stage.work, dict(stage.parts)])
            keys[stage.name] = []
            rows = [plain_text(row) for row in stage.rows]
            for record, row in enumerate(rows):
                needs, above = {}, []
                for name, which in stage.needs.items():
                    if which is None:
                        needs[name] = keys[name]
                        above.append(whole[name])
                    else:
                        needs[name] = [keys[name][k] for k in which(record)]
                        above += needs[name]
                key = sha256(" ".join((head, *above, row)).encode()).hexdigest()
                task = self.tasks.get(key)
                if task is None:
                    lead = self._shared(needs) if stage.on_device else None
                    cluster = clusters[stage.name] if lead is None else lead.order[0]
                    together = record if lead is None else lead.record
                    order = cluster, position, together, record, scene
                    task = self.tasks[key] = Task(stage, record, key, needs, order)
                task.places.append((folder, record))
                keys[stage.name].append(key)
            whole[stage.name] = digest(keys[stage.name])
            self.parts[folder][stage.name] = {
                **stage.parts, **{name: whole[name][:16] for name in stage.needs},
                "rows": digest(rows)[:16],
            }  # fmt: skip
            if not stage.keeps:
                in_memory.add(stage.name)

    def _shared(self, needs: Mapping[str, Sequence[str]]) -> Task | None:
        """The value that a record needs which takes room on the device, if there is one."""
        tasks = (self.tasks[key] for keys in needs.values() for key in keys[:1])
        return next((t for t in tasks if t.stage.on_device and not t.stage.keeps), None)

    def decide(
        self,
        store: Store | None,
        folders: Mapping[str, Folder],
        *,
        no_reuse: str = "",
        verify: bool = False,
        targets: Collection[str] | None = None,
    ) -> None:
        """State and reason of every task, before any work. ``no_reuse``: why nothing is reused;
        ``verify``: as `Store.fault` has it; ``targets``: stages that are wanted, by default all."""
        users: dict[str, dict[str, None]] = defaultdict(dict)
        for task in reversed(self.tasks.values()):
            if not task.stage.keeps:
                kinds = users.get(task.key, {})
                task.state = "run" if kinds else "skipped"
                who = [kind for kind in reversed(kinds) if kind != _REPORT] or [f"the {_REPORT}"]
                task.reason = (
                    f"needed by {', '.join(who)}" if kinds else "nothing that runs needs it"
                )
            elif targets is not None and task.stage.name not in targets and task.key not in users:
                task.state, task.reason = "skipped", "not asked for"
            elif no_reuse or store is None:
                task.state, task.reason = "run", no_reuse or "new run"
                if store is not None:
                    store.forget(task.key)
            else:
                fault = store.fault(task.key, task.stage.name, verify)
                task.state = "reused" if fault is None else "run"
                task.reason = "unchanged" if fault is None else fault or self._why(task, folders)
            if task.runs:
                kind = task.stage.public(task.record).split("/")[0]
                # a value that is hidden hands on who needs it
                names = {kind or _REPORT: None} if kind or task.stage.keeps else users[task.key]
                for key in (key for keys in task.needs.values() for key in keys):
                    users[key] |= names

    def kept(self, folder: str) -> list[str]:
        """Keys of a scene's results that are kept."""
        keys = (key for own in self.records[folder].values() for key in own)
        return [key for key in keys if self.tasks[key].stage.keeps]

    def current(self, folder: str, store: Store) -> set[str]:
        """The names of the files that a scene's results in ``store`` have."""
        records = map(store.find, self.kept(folder))
        return {name for record in records if record is not None for name in record.files}

    def _why(self, task: Task, folders: Mapping[str, Folder]) -> str:
        """Why a result that isn't there isn't."""
        place, stage = task.places[0][0], task.stage.name
        if place not in folders or folders[place].parts(stage) is None:
            return "not made yet"
        causes = self._changed(folders[place], place, stage)
        return f"{', '.join(sorted(causes))} changed" if causes else "not made yet"

    def _changed(self, folder: Folder, place: str, stage: str) -> set[str]:
        """What isn't as it was when the folder was last written: parts of the scene, or rows."""
        if (place, stage) not in self._causes:
            before, now = folder.parts(stage) or {}, self.parts[place][stage]
            causes: set[str] = set()
            for part in [part for part in now if before.get(part) != now[part]]:
                if part in self.parts[place]:
                    causes |= self._changed(folder, place, part)
                else:
                    causes.add("loads or places of frames" if part == "rows" else part)
            self._causes[place, stage] = causes
        return self._causes[place, stage]

    def order(self) -> list[Task]:
        """What is to be kept and made, in the order of work."""
        running = [task for task in self.tasks.values() if task.runs and task.stage.keeps]
        return sorted(running, key=lambda task: task.order)
