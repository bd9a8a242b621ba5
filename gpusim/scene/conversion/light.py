"""``[[light]]`` tables to the model, in SI."""

from __future__ import annotations

import math

from gpusim.scene.description import model
from gpusim.scene.schema.light import (
    AmbientLightTable,
    AreaLightTable,
    EnvironmentLightTable,
    LightTable,
    PointLightTable,
    SpotLightTable,
)

__all__ = ["light"]


def light(table: LightTable) -> model.Light:
    """One light."""
    if isinstance(table, AmbientLightTable):
        return model.Ambient(table.name, table.radiance_W_m2_sr, table.occlusion)
    if isinstance(table, EnvironmentLightTable):
        return model.Environment(
            table.name, table.sky_W_m2_sr or 0.0, table.ground_W_m2_sr or 0.0, _vec(table.up),
            table.occlusion, table.file or "", table.scale_W_m2_sr,
            None if table.forward is None else _vec(table.forward),
        )  # fmt: skip
    if isinstance(table, PointLightTable):
        return model.Point(table.name, _m(table.position_mm), table.watts(), table.shadows)
    if isinstance(table, SpotLightTable):
        return model.Spot(
            table.name, _m(table.position_mm), _m(table.target_mm), table.watts(),
            math.radians(table.cone_deg), table.penumbra, table.shadows,
        )  # fmt: skip
    if isinstance(table, AreaLightTable):
        width, height = table.size_mm
        return model.Area(
            table.name, _m(table.position_mm), _m(table.target_mm),
            (width / 1000.0, height / 1000.0), table.watts(), table.shape, table.shadows,
        )  # fmt: skip
    return model.Sun(
        table.name, _vec(table.direction), table.irradiance_W_m2,
        math.radians(table.diameter_deg), table.shadows,
    )  # fmt: skip


def _vec(values: list[float]) -> model.Vec3:
    x, y, z = values
    return x, y, z


def _m(values: list[float]) -> model.Vec3:
    x, y, z = (value / 1000.0 for value in values)
    return x, y, z
