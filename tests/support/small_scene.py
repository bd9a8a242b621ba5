"""A clamped bar of 240 x 20 x 10 mm before a camera: small, and every stage of a run has work."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from gpusim.scene import Scene

DOCUMENT: dict[str, Any] = {
    "schema": 1,
    "name": "bar",
    "material": [{"name": "steel", "youngs_modulus_GPa": 70.0, "poissons_ratio": 0.33,
                  "density_kg_m3": 2700.0}],
    "body": [{
        "name": "bar", "material": "steel",
        "mesh": {"builder": "box", "size_mm": [240.0, 20.0, 10.0], "divisions": [12, 2, 1]},
        "support": [{"name": "clamp", "where": {"set": "x_min"}, "fix": ["x", "y", "z"]}],
        "load": [{"name": "push", "type": "force", "where": {"set": "x_max"},
                  "force_N": [0.0, 0.0, -50.0]}],
        "paint": [{"name": "grey", "type": "plain", "albedo": 0.4},
                  {"name": "side", "type": "markers", "where": {"normal": "-y"}, "albedo": 0.4,
                   "size_mm": 8.0, "line": {"start_mm": [20.0, 0.0, 5.0],
                                            "end_mm": [230.0, 0.0, 5.0], "count": 4}}],
    }],
    "camera": [{"name": "side", "sensor_mm": [15.0, 4.0], "resolution_px": [450, 120],
                "focal_mm": 50.0, "position_mm": [120.0, -900.0, 5.0],
                "target_mm": [120.0, 0.0, 5.0]}],
    "measure": [{"name": "tip", "type": "deflection", "camera": "side", "groups": ["side"],
                 "direction": "-z"}],
    "output": {"vtu": True, "stl": True, "stress": True, "truth": ["depth", "displacement"]},
}  # fmt: skip


def small_scene(folder: Path | str = ".", **changes: Any) -> Scene:
    """The scene with ``changes`` of its tables; files are looked for in ``folder``."""
    return Scene.from_document({**copy.deepcopy(DOCUMENT), **changes}, folder=folder)
