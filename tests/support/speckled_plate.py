"""A speckled plate with a hole that is pulled, before two cameras and a calibration target."""

from __future__ import annotations

import copy
from typing import Any

from gpusim.scene import Scene

_TILTS = ([18, 10, 4], [-20, 14, -10], [12, -22, 20], [-16, -18, -25], [25, 3, 10], [-5, 25, -15])
_CAMERA = {"sensor_mm": [13.2, 8.8], "resolution_px": [480, 320], "focal_mm": 35.0,
           "target_mm": [0.0, 0.0, 2.0]}  # fmt: skip
DOCUMENT: dict[str, Any] = {
    "schema": 1, "name": "plate",
    "material": [{"name": "aluminium", "youngs_modulus_GPa": 70.0, "poissons_ratio": 0.33}],
    "body": [{
        "name": "plate", "material": "aluminium",
        "mesh": {"builder": "plate_with_hole", "length_mm": 120.0, "width_mm": 60.0,
                 "thickness_mm": 4.0, "hole_diameter_mm": 20.0, "radial": 4},
        "support": [{"name": "clamp", "where": {"set": "x_min"}, "fix": ["x", "y", "z"]}],
        "load": [{"name": "pull", "type": "force", "where": {"set": "x_max"},
                  "force_N": [50_000.0, 0.0, 0.0]}],
        "paint": [{"name": "speckle", "type": "speckle", "where": {"normal": "+z"}, "albedo": 0.8,
                   "diameter_mm": 1.3, "softness_mm": 0.15, "spread": 0.3}],
    }],
    "prop": [{"name": "board", "center_mm": [0.0, 0.0, 2.0], "normal": [0.0, 0.0, 1.0],
              "up": [0.0, 1.0, 0.0], "size_mm": [90.0, 60.0],
              "paint": [{"name": "fields", "type": "checker", "albedo": 0.9, "cell_mm": 6.0,
                         "columns": 9, "rows": 8, "origin_mm": [-27.0, -24.0, 2.0]}]}],
    "camera": [
        {"name": "left", **_CAMERA, "position_mm": [-80.0, 0.0, 330.0], "up": [0.0, 1.0, 0.0]},
        {"name": "right", **_CAMERA, "position_mm": [80.0, 0.0, 330.0], "up": [0.0, 1.0, 0.0]},
    ],
    "sensor": {"bits": 12, "exposure": "auto"},
    "calibration": {"board": "board", "pose": [
        {"position_mm": [0.0, 0.0, 4.0]},
        *({"position_mm": [15.0 * (-1) ** k, 6.0 - 3.0 * k, 12.0 - 5.0 * k], "rotation_deg": tilt}
          for k, tilt in enumerate(_TILTS)),
    ]},
    "measure": [], "output": {}, "analysis": {"load_factors": [0.0, 1.0]},
}  # fmt: skip


def speckled_plate(*measures: dict[str, Any], **changes: Any) -> Scene:
    """The scene with these measures, of type "dic", and ``changes`` of its tables."""
    own = [{"name": f"field{k}", "type": "dic", "subset_px": 21, "step_px": 7, **one}
           for k, one in enumerate(measures)]  # fmt: skip
    return Scene.from_document({**copy.deepcopy(DOCUMENT), "measure": own, **changes})
