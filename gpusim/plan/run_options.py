"""How a scene is run: on which backend, with which earlier results, and by which shortcuts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

__all__ = ["RunOptions"]


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
