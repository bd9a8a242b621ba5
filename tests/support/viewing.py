"""A small window's size, a lamp for the small scene, and patience for what a viewer sees change."""

from __future__ import annotations

import time
from typing import Any

from gpusim.view.viewer import Viewer

__all__ = ["LIGHT", "SIZE", "wait_for"]

SIZE = (331, 207)
LIGHT: list[dict[str, Any]] = [
    {"name": "sun", "type": "sun", "direction": [0.3, 1.0, -0.6], "irradiance_W_m2": 3.0}
]


def wait_for(viewer: Viewer, what: str) -> float:
    """Seconds until a change of the file is seen."""
    begun = time.monotonic()
    content, fault = viewer.content, viewer.fault
    while (viewer.content, viewer.fault) == (content, fault):
        viewer.tick()
        assert time.monotonic() - begun < 20.0, what
        time.sleep(0.01)
    return time.monotonic() - begun
