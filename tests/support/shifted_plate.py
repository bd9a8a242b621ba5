"""A speckled plate that moves as a rigid body before one camera or two."""

from __future__ import annotations

import copy
from typing import Any

from gpusim.scene import Scene

_CAMERA = {"sensor_mm": [8.8, 6.6], "resolution_px": [220, 165], "focal_mm": 12.0,
           "up": [0.0, 1.0, 0.0]}  # fmt: skip
DOCUMENT: dict[str, Any] = {
    "schema": 1, "name": "plate",
    "prop": [{"name": "plate", "center_mm": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0],
              "up": [0.0, 1.0, 0.0], "size_mm": [126.0, 92.0],
              "paint": [{"name": "speckle", "type": "speckle", "albedo": 0.8, "diameter_mm": 3.4,
                         "softness_mm": 0.5, "spread": 0.3}]}],
    "camera": [
        {"name": "left", **_CAMERA, "position_mm": [-20.0, 0.0, 200.0],
         "target_mm": [-20.0, 0.0, 0.0]},
        {"name": "right", **_CAMERA, "position_mm": [25.0, 0.0, 200.0],
         "target_mm": [2.5, 0.0, 0.0]},
    ],
    "sensor": {"bits": 16, "exposure": "auto"},
    "measure": [], "output": {}, "analysis": {"load_factors": [0.0, 1.0]},
}  # fmt: skip


def shifted_plate(
    shift_mm: tuple[float, float, float], measure: dict[str, Any], **changes: Any
) -> Scene:
    """The scene with a ``measure`` "field" of type "dic", and ``changes`` of its tables; keys with
    a dot are overrides of single keys."""
    document = copy.deepcopy(DOCUMENT)
    document["prop"][0]["poses"] = [{"position_mm": one} for one in ([0.0] * 3, list(shift_mm))]
    own = {"name": "field", "type": "dic", "subset_px": 21, "step_px": 9, **measure}
    overrides = {key: value for key, value in changes.items() if "." in key}
    tables = {key: value for key, value in changes.items() if "." not in key}
    return Scene.from_document({**document, "measure": [own], **tables}, overrides=overrides)
