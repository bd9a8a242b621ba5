"""Scenes that together have every kind of table, small."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.support.small_scene import DOCUMENT

__all__ = ["everything", "given_field", "write_inputs"]

_LENS = {"sensor_mm": [36.0, 24.0], "resolution_px": [480, 320], "focal_mm": 50.0}
_TILTS = ([20, 5, -25], [-25, -10, 15], [15, 12, 28], [-18, 0, -20])


def write_inputs(folder: Path) -> None:
    """The files that `everything` names."""
    folder.mkdir(parents=True, exist_ok=True)
    grey = np.linspace(20, 230, 64, dtype=np.uint8).reshape(8, 8)
    Image.fromarray(grey).save(folder / "wall.png")


def everything() -> dict[str, Any]:
    """Two bodies, props with poses, a calibration, a shutter, a lens, noise, a camera's own sensor,
    lights of all kinds, all outputs."""
    document = copy.deepcopy(DOCUMENT)
    (bar,) = document["body"]
    side = bar["paint"][1]
    del side["line"]
    side |= {"size_mm": 8.0, "positions_mm": [[20.0, 0.0, 4.0], [90.0, 0.0, 6.0],
                                             [160.0, 0.0, 4.0], [230.0, 0.0, 6.0]]}  # fmt: skip
    bar["load"].append({"name": "side", "type": "force", "where": {"set": "x_max"},
                        "force_N": [0.0, 5.0, 0.0], "amplitude": [0.0, 0.0, 1.0]})  # fmt: skip
    block = copy.deepcopy(bar) | {"name": "block", "load": [], "support": [
        {"name": "foot", "where": {"set": "z_min"}, "fix": ["x", "y", "z"]}]}  # fmt: skip
    block["mesh"] = {"builder": "box", "size_mm": [20.0, 20.0, 20.0], "divisions": [1, 1, 1]}
    block["paint"] = [{"name": "dark", "type": "plain", "albedo": 0.3}]
    document["body"] = [bar, block]
    wall = {"name": "wall", "center_mm": [120.0, 60.0, 5.0], "normal": [0.0, -1.0, 0.0],
            "size_mm": [400.0, 200.0],
            "paint": [{"name": "picture", "type": "image", "file": "wall.png", "albedo": 0.5,
                       "origin_mm": [-80.0, 60.0, -95.0], "texel_mm": 50.0}]}  # fmt: skip
    mover = {"name": "mover", "center_mm": [60.0, 30.0, 60.0], "normal": [0.0, -1.0, 0.0],
             "size_mm": [30.0, 30.0], "paint": [{"name": "m", "type": "plain", "albedo": 0.5}],
             "poses": [{"position_mm": [60.0 + 5 * k, 30.0, 60.0],
                        "rotation_deg": [0.0, 0.0, 3.0 * k]} for k in range(3)]}  # fmt: skip
    board = {"name": "board", "center_mm": [120.0, 0.0, 5.0], "normal": [0.0, -1.0, 0.0],
             "size_mm": [170.0, 155.0],
             "paint": [{"name": "fields", "type": "checker", "albedo": 0.9, "cell_mm": 15.0,
                        "columns": 9, "rows": 8, "origin_mm": [52.5, 0.0, -55.0]}]}  # fmt: skip
    document |= {
        "prop": [wall, mover, board],
        "camera": [
            {"name": "left", **_LENS, "position_mm": [20.0, -470.0, 40.0],
             "target_mm": [120.0, 0.0, 5.0], "sensor": {"bits": 12, "gain_DN_per_e": 0.5}},
            {"name": "right", **_LENS, "focal_mm": 52.0, "position_mm": [230.0, -480.0, 30.0],
             "target_mm": [120.0, 0.0, 5.0], "distortion": [-0.02, 0.01, 0.0, 0.0],
             "shutter": {"exposure_ms": 2.0, "line_time_us": 5.0, "samples": 2}},
            {"name": "blurred", "sensor_mm": [15.0, 4.0], "resolution_px": [150, 40],
             "focal_mm": 50.0, "position_mm": [120.0, -900.0, 5.0],
             "target_mm": [120.0, 0.0, 5.0],
             "lens": {"f_number": 8.0, "focus_distance_mm": 880.0, "positions": 4}},
        ],
        "light": [
            {"name": "lamp", "type": "area", "position_mm": [-200.0, -900.0, 300.0],
             "target_mm": [120.0, 0.0, 5.0], "size_mm": [60.0, 60.0], "power_W": 60.0},
            {"name": "room", "type": "environment", "sky_W_m2_sr": 1.0, "ground_W_m2_sr": 0.5},
        ],
        "analysis": {"type": "static", "geometry": "nonlinear", "load_factors": [0.0, 0.5, 1.0],
                     "frame_rate_Hz": 50.0},
        "solver": {"tolerance": 1e-6},
        "render": {"error": 1.0},
        "sensor": {"bits": 10, "full_well_e": 20_000.0, "read_noise_e": 5.0, "seed": 3},
        "calibration": {
            "board": "board",
            "pose": [{"position_mm": [110.0 + 12 * k, -20.0 + 15 * (k % 3), 20.0 - 9 * k],
                      "rotation_deg": [float(angle) for angle in tilt]}
                     for k, tilt in enumerate(_TILTS)],
        },
        "measure": [
            {"name": "space", "type": "stereo", "cameras": ["left", "right"], "groups": ["side"],
             "lens": "pinhole"},
            {"name": "tip", "type": "deflection", "camera": "left", "groups": ["side"],
             "direction": "-z"},
            {"name": "field", "type": "dic", "camera": "left", "plane_pose": 0, "lens": "pinhole",
             "roi": {"where": {"normal": "-y"}}, "subset_px": 15, "step_px": 4,
             "formats": ["csv", "h5"]},
            {"name": "extension", "type": "extensometer", "camera": "left", "width_px": 40.0,
             "ends_mm": [[40.0, 0.0, 5.0], [200.0, 0.0, 5.0]], "subset_px": 21},
            {"name": "root", "type": "gauge", "camera": "left", "subset_px": 21,
             "center_mm": [60.0, 0.0, 5.0], "size_px": [80.0, 26.0]},
            {"name": "deflection-line", "type": "line", "camera": "left", "subset_px": 21,
             "start_mm": [30.0, 0.0, 5.0], "end_mm": [210.0, 0.0, 5.0], "count": 9,
             "mm_per_px": 0.5, "frames": [2]},
            {"name": "end", "type": "point", "camera": "left", "points_mm": [[200.0, 0.0, 5.0]],
             "names": ["end"], "subset_px": 21},
        ],
        "output": {"vtu": True, "stl": True, "stress": True, "calibration": ["opencv", "vic"],
                   "truth": ["reference", "displacement", "depth", "flow", "region", "element",
                             "visibility", "normal", "cameras"]},
    }  # fmt: skip
    return document


def given_field(strip: Path) -> dict[str, Any]:
    """A body whose displacements another program has found."""
    document = everything()
    body = {"name": "strip", "field": {"file": str(strip), "unit": "mm"},
            "paint": [{"name": "metal", "type": "plain", "albedo": 0.3}]}  # fmt: skip
    camera = {"name": "above", "sensor_mm": [12.0, 8.0], "resolution_px": [120, 80],
              "focal_mm": 25.0, "position_mm": [60.0, -250.0, 220.0],
              "target_mm": [60.0, 0.0, 22.0]}  # fmt: skip
    document |= {
        "body": [body], "camera": [camera], "measure": [], "light": [],
        "analysis": {"type": "field", "times": [0.0, 0.3, 1.0]},
        "output": {"vtu": True, "stl": True, "truth": ["displacement", "element"]},
    }  # fmt: skip
    for name in ("calibration", "prop", "solver"):
        del document[name]
    return document
