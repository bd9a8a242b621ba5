"""The sources that a scene has anyway, with what is common in a laboratory.

A pair of cameras is calibrated as bundle adjustment of good pictures does it; a camera alone stands
as a tripod and a spirit level leave it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from gpusim.errors import nearest_name, require
from gpusim.scene import Scene
from gpusim.scene.effects import active_effects
from gpusim.studies.budget_tables import BudgetSourceTable, BudgetTable

# standard uncertainties: in percent; px; percent; percent of the distance
CALIBRATED = {"focal": 0.02, "principal point": 0.3, "distortion": 1.0, "position": 0.02,
              "orientation": 0.01}  # fmt: skip
SET_UP = {"focal": 0.5, "principal point": 5.0, "distortion": 10.0, "position": 0.2,
          "orientation": 0.2}  # fmt: skip
JOINT = "all together"
DRIFT = 1.0  # percent of brightness
SHAKE_UM, SHAKE_DEG = 2.0, 0.0002  # along and about each axis of a camera

Sources = dict[str, list[BudgetSourceTable]]


def sources_of(scene: Scene, tables: BudgetTable) -> Sources:
    """The sources of a budget by their names, the scene's own ones first. Raises InputError for a
    name that isn't one of them."""
    common: Sources = {}
    for table in _common(scene):
        common.setdefault(table.name, []).append(table)
    for name in tables.sources or ():
        expected = ", ".join(common) + nearest_name(name, common)
        require(name in common, "budget.sources", repr(name), expected)
    own = {table.name for table in tables.source}
    require(JOINT not in own, "budget.source", JOINT, "another name")
    wanted = set(common if tables.sources is None else tables.sources)
    found = {name: common[name] for name in common if name in wanted - own}
    for table in tables.source:
        found.setdefault(table.name, []).append(table)
    return found


def _common(scene: Scene) -> Iterator[BudgetSourceTable]:
    document = scene.document

    def source(name: str, *keys: str, **how: Any) -> BudgetSourceTable:
        return BudgetSourceTable.model_validate({"name": name, "keys": list(keys), **how})

    if "noise" in active_effects(document):
        yield source("noise", "sensor.seed", seeds=True)
    # another level of black moves all the steps of grey
    black = (document["sensor"].get("black_level_DN") or 0.0) + 0.5
    yield source("quantisation", "sensor.black_level_DN", half_width=0.5,
                 set={"sensor.black_level_DN": black})  # fmt: skip
    paired = {view for spec in scene.measures if len(spec.views) > 1 for view in spec.views}
    measured = {view for spec in scene.measures for view in spec.views}
    cameras = [one for one in document["camera"] if one["name"] in measured]
    for camera in cameras:
        path, lens = f"camera.{camera['name']}", camera.get("lens") or {}
        psf = lens.get("psf") or {}
        for key in ("sigma_px", "radius_px"):
            if key in psf:
                yield source("point spread", f"{path}.lens.psf.{key}", percent=10.0)
        if lens.get("focus_distance_mm") is not None:
            yield source("defocus", f"{path}.lens.focus_distance_mm", percent=0.5)
    for camera in cameras:
        size = CALIBRATED if camera["name"] in paired else SET_UP
        for name, keys, kind, value in _of_camera(camera, size):
            yield source(name, *keys, **{kind: value})
    yield source("light", "sensor.drift_percent", normal=DRIFT, set={"sensor.drift_percent": 0.0})
    for key, shake in (("moved_um", SHAKE_UM), ("turned_deg", SHAKE_DEG)) if cameras else ():
        paths = [f"camera.{camera['name']}.{key}" for camera in cameras]
        yield source("vibration", *paths, normal=shake, set={path: [0.0] * 3 for path in paths})
    speckled = [
        f"{kind}.{thing['name']}.paint.{paint['name']}.seed"
        for kind in ("body", "prop") for thing in document.get(kind, ())
        for paint in thing.get("paint", ()) if paint["type"] == "speckle"
    ]  # fmt: skip
    if speckled:
        yield source("speckle", *speckled, seeds=True)
    for spec in document["measure"]:
        if (subset := spec.get("subset_px")) is not None:
            yield source("settings", f"measure.{spec['name']}.subset_px",
                         choices=[subset - 2, subset, subset + 2])  # fmt: skip


def _of_camera(
    camera: Mapping[str, Any], size: Mapping[str, float]
) -> Iterator[tuple[str, list[str], str, float]]:
    """Sources of a camera's calibration: name, keys, how they are drawn, and how far."""
    path, pitch = f"camera.{camera['name']}", 1.0
    focal, centre = ["fx_px", "fy_px"], ["cx_px", "cy_px"]
    if camera.get("focal_mm") is not None:
        width = camera.get("pixel_um") or 1e3 * camera["sensor_mm"][0] / camera["resolution_px"][0]
        pitch, focal, centre = width / 1e3, ["focal_mm"], ["principal_point_offset_mm"]
    place, direction, turn = "position_mm", "target_mm", 1.0
    away = np.subtract(camera.get("target_mm") or 0.0, camera.get("position_mm") or 0.0)
    if camera.get("translation_mm") is not None:
        place, direction, away = "translation_mm", "rotation_vector", camera["translation_mm"]
        turn = 1.0 / float(np.linalg.norm(away))
    far = float(np.linalg.norm(away)) / 100.0
    bent = [f"distortion.{k}" for k, one in enumerate(camera["distortion"]) if one]
    for name, keys, kind, value in (
        ("focal length", focal, "percent", size["focal"]),
        ("principal point", centre, "normal", size["principal point"] * pitch),
        ("distortion", bent, "percent", size["distortion"]),
        ("position", [place], "normal", size["position"] * far),
        ("orientation", [direction], "normal", size["orientation"] * far * turn),
    ):
        # of a camera that a file describes some aren't there to be drawn
        known = [f"{path}.{key}" for key in keys if camera.get(key.split(".")[0]) is not None]
        if known:
            yield name, known, kind, value
