"""Which task is next: those whose needs are there, in the graph's order."""

from __future__ import annotations

from collections import defaultdict
from heapq import heappop, heappush

from gpusim.graph.graph import Graph, Task

_PATIENCE_S = 0.02
"""Between looks whether another process has made what it is at."""


class Schedule:
    """What is left to be made. Values in memory don't count: who needs one waits for what that is
    made of."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._made_of: dict[str, frozenset[str]] = {}
        self._users: dict[str, list[Task]] = defaultdict(list)
        self._waiting: dict[str, int] = {}
        self._ready: dict[bool, list[tuple[tuple[int, int, int, int, int], str, Task]]] = {
            True: [], False: [],
        }  # fmt: skip
        self._deferred: list[Task] = []
        tasks = graph.order()
        self.left = len(tasks)
        for task in tasks:
            awaited = self.made_of(task)
            self._waiting[task.key] = len(awaited)
            for key in awaited:
                self._users[key].append(task)
            if not awaited:
                self._enter(task)

    def made_of(self, task: Task) -> frozenset[str]:
        """Keys of the results still to be made that a task needs, through values in memory too."""
        if task.key not in self._made_of:
            found: set[str] = set()
            for key in (key for keys in task.needs.values() for key in keys):
                need = self._graph.tasks[key]
                if not need.stage.keeps:
                    found |= self.made_of(need)
                elif need.runs:
                    found.add(key)
            self._made_of[task.key] = frozenset(found)
        return self._made_of[task.key]

    def take(self, on_device: bool) -> Task | None:
        """The next task of those that need the device, or of the others."""
        ready = self._ready[on_device]
        return heappop(ready)[2] if ready else None

    def finish(self, task: Task) -> None:
        """Enter that a result is there."""
        self.left -= 1
        for user in self._users[task.key]:
            self._waiting[user.key] -= 1
            if not self._waiting[user.key]:
                self._enter(user)

    def defer(self, task: Task) -> None:
        """Put off what another process is at."""
        self._deferred.append(task)

    @property
    def patience_s(self) -> float | None:
        """How long to wait before a look at what was put off; None if nothing was."""
        return _PATIENCE_S if self._deferred else None

    def resume(self) -> None:
        """Make the deferred tasks ready again."""
        deferred, self._deferred = self._deferred, []
        for task in deferred:
            self._enter(task)

    def _enter(self, task: Task) -> None:
        heappush(self._ready[task.stage.on_device], (task.order, task.key, task))
