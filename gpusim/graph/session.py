"""What the stages of a process share, and results don't depend on."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from gpusim.gpu import Device, default_device


@dataclass
class Session:
    """The device, values in memory by key, and what stages keep from record to record.

    ``options``: how work is done (backend, shortcuts). ``kept``: by the name of a stage, what its
    last record left for the next one to save time. ``results``: measurements by key, for who wants
    them as they were made; None: nobody does.
    """

    options: Any
    values: dict[str, Any] = field(default_factory=dict)
    kept: dict[str, Any] = field(default_factory=dict)
    results: dict[str, Any] | None = None

    @cached_property
    def device(self) -> Device | None:
        """The device, opened now if it wasn't; None for the NumPy twins."""
        return None if self.options.backend == "numpy" else default_device()

    @property
    def adapter(self) -> str:
        """What results are made on."""
        return "none (numpy backend)" if self.device is None else self.device.name
