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

CALIBRATED = {"focal": 0.02, "principal point": 0.3, "distortion": 1.0, "position": 0.02,
              "orientation": 0.01}  # fmt: skip
"""Standard uncertainties of a calibrated pair: in percent; px; percent; percent of the distance."""
SET_UP = {"focal": 0.5, "principal point": 5.0, "distortion": 10.0, "position": 0.2,
          "orientation": 0.2}  # fmt: skip
"""The same of a camera alone."""
DRIFT = 1.0
"""Percent of brightness between frames."""
SHAKE_UM, SHAKE_DEG = 2.0, 0.0002
"""Between frames, along and about each axis of a camera."""

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
    found = {
        name: own
        for name, own in common.items()
        if tables.sources is None or name in tables.sources
    }
    for name in {table.name for table in tables.source}:
        found.pop(name, None)
    for table in tables.source:
        found.setdefault(table.name, []).append(table)
    return found


def _common(scene: Scene) -> Iterator[BudgetSourceTable]:
    document = scene.document

    def source(name: str, *keys: str, **how: Any) -> BudgetSourceTable:
        return BudgetSourceTable(name=name, keys=list(keys), **how)

    if "noise" in active_effects(document):
        yield source("noise", "sensor.seed", seeds=True)
    # another level of black moves all the steps of grey
    black = (document["sensor"].get("black_level_DN") or 0.0) + 0.5
    yield source("quantisation", "sensor.black_level_DN", half_width=0.5,
                 set={"sensor.black_level_DN": black})  # fmt: skip
    paired = {
        view for spec in scene.measures if len(spec.views) > 1 for view in spec.views
    }  # fmt: skip
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
    for key, size in (("moved_um", SHAKE_UM), ("turned_deg", SHAKE_DEG)):
        paths = [f"camera.{camera['name']}.{key}" for camera in cameras]
        yield source("vibration", *paths, normal=size, set=dict.fromkeys(paths, [0.0, 0.0, 0.0]))
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
    path = f"camera.{camera['name']}"
    if camera.get("focal_mm") is not None:
        yield "focal length", [f"{path}.focal_mm"], "percent", size["focal"]
        width = camera.get("pixel_um") or 1e3 * camera["sensor_mm"][0] / camera["resolution_px"][0]
        yield ("principal point", [f"{path}.principal_point_offset_mm"], "normal",
               size["principal point"] * width / 1e3)  # fmt: skip
    elif camera.get("fx_px") is not None:
        yield "focal length", [f"{path}.fx_px", f"{path}.fy_px"], "percent", size["focal"]
        yield ("principal point", [f"{path}.cx_px", f"{path}.cy_px"], "normal",
               size["principal point"])  # fmt: skip
    bent = [f"{path}.distortion.{k}" for k, one in enumerate(camera["distortion"]) if one]
    if bent:
        yield "distortion", bent, "percent", size["distortion"]
    if camera.get("target_mm") is not None:
        away = float(np.linalg.norm(np.subtract(camera["target_mm"], camera["position_mm"]))) / 100
        # the axis stays as it is directed where the camera moves with what it looks at
        yield "position", [f"{path}.position_mm"], "normal", size["position"] * away
        yield "orientation", [f"{path}.target_mm"], "normal", size["orientation"] * away
    elif camera.get("translation_mm") is not None:
        away = float(np.linalg.norm(camera["translation_mm"])) / 100
        yield "position", [f"{path}.translation_mm"], "normal", size["position"] * away
        turn = "rotation_vector" if camera.get("rotation_vector") is not None else ""
        if turn:
            yield "orientation", [f"{path}.{turn}"], "normal", size["orientation"] / 100
