"""A crane of 50 elements before a wall, photographed small: what runs of many frames and many
variants are counted with."""

from __future__ import annotations

import copy
from typing import Any

from gpusim.scene import Scene

__all__ = ["DOCUMENT", "crane", "crane_variants"]

_STEEL = {"albedo": 0.56, "roughness": 0.65, "metallic": 1.0}
DOCUMENT: dict[str, Any] = {
    "schema": 1,
    "name": "Small crane",
    "material": [{"name": "steel", "youngs_modulus_GPa": 210.0, "poissons_ratio": 0.3,
                  "density_kg_m3": 7850.0}],
    "body": [{
        "name": "crane", "material": "steel", "formulation": "incompatible",
        "mesh": {"builder": "crane", "height_mm": 562.0, "foot_mm": 70.0, "length_mm": 597.0,
                 "column_thickness_mm": 40.0, "beam_thickness_mm": 40.0, "width_mm": 40.0,
                 "load_length_mm": 108.0, "element_mm": 20.0, "through": 1, "across": 2},
        "support": [{"name": "clamp", "where": {"set": "foot"}, "fix": ["x", "y", "z"]}],
        "load": [{"name": "weight", "type": "force", "force_N": [0.0, 0.0, -13000.0],
                  "where": {"normal": "+z", "x_min_mm": 489.0, "z_min_mm": 600.0}}],
        "paint": [{"name": "steel", "type": "plain", **_STEEL},
                  {"name": "beam", "type": "markers", **_STEEL, "size_mm": 40.0,
                   "where": {"normal": "-y", "z_min_mm": 562.0},
                   "line": {"start_mm": [100.0, -20.0, 582.0], "end_mm": [560.0, -20.0, 582.0],
                            "count": 4}}],
    }],
    "prop": [{"name": "wall", "center_mm": [300.0, 150.0, 290.0], "normal": [0.0, -1.0, 0.0],
              "size_mm": [1800.0, 1300.0],
              "paint": [{"name": "plaster", "type": "plain", "albedo": 0.55}]}],
    "camera": [{"name": "front", "sensor_mm": [36.0, 27.0], "resolution_px": [100, 75],
                "focal_mm": 30.0, "position_mm": [300.0, -1020.0, 290.0],
                "target_mm": [300.0, -20.0, 290.0]}],
    "analysis": {"type": "static", "load_factors": [0.0, 1.0]},
    "solver": {"tolerance": 1e-6},
    "sensor": {"bits": 8, "full_well_e": 30_000.0, "read_noise_e": 6.0},
}  # fmt: skip


def crane(frames: int = 2, cameras: int = 1, **changes: Any) -> Scene:
    """The scene with so many frames and cameras; ``changes`` of tables."""
    document = {**copy.deepcopy(DOCUMENT), **changes}
    document["analysis"] = {"type": "static",
                            "load_factors": [k / (frames - 1) for k in range(frames)]}  # fmt: skip
    (front,) = document["camera"]
    document["camera"] += [
        front | {"name": f"camera{k}", "position_mm": [300.0 + 50 * k, -1020.0, 330.0]}
        for k in range(1, cameras)
    ]
    return Scene.from_document(document)


def crane_variants(seeds: int, places: int, loads: int) -> Scene:
    """Variants that differ in the noise, the camera's place and the load."""
    variants = [
        {"name": f"seed{seed}-place{place}-load{load}",
         "set": {"sensor.seed": seed, "sensor.series": 0,
                 "camera.front.position_mm": [300.0 + 5.0 * place, -1020.0, 290.0],
                 "body.crane.load.weight.force_N": [0.0, 0.0, -9e3 - 4e3 * load]}}
        for seed in range(seeds) for place in range(places) for load in range(loads)
    ]  # fmt: skip
    return crane(variant=variants)
