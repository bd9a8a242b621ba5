"""From tables to frozen dataclasses: units to SI, names to things, lines to points."""

from __future__ import annotations

from collections.abc import Mapping

from . import model
from .schema import SceneTable
from .schema.body import (
    BodyTable,
    ForceTable,
    GravityTable,
    LoadTable,
    NodalForceTable,
    PressureTable,
    SupportTable,
)
from .schema.mesh import BoxTable, MeshTable
from .schema.paint import CheckerTable, MarkersTable, PaintTable, PlainTable
from .schema.view import AmbientLightTable, AreaLightTable, CameraTable, LightTable, PropTable
from .schema.where import WhereTable
from .schema.work import MeasureTable

__all__ = [
    "analysis",
    "body",
    "camera",
    "light",
    "material_table",
    "measure",
    "output",
    "prop",
    "render",
    "sensor",
    "solver",
]

INFINITY = float("inf")


def _vec(values: list[float], divisor: float = 1.0) -> model.Vec3:
    x, y, z = values
    return x / divisor, y / divisor, z / divisor


def _m(values: list[float]) -> model.Vec3:
    """Millimetres to metres. Dividing by 1000 rounds once; times 0.001 would round twice."""
    return _vec(values, 1000.0)


def _pair(values: list[float]) -> tuple[float, float]:
    a, b = values
    return a / 1000.0, b / 1000.0


def where(table: WhereTable) -> model.Where:
    lower = [
        v if v is not None else -INFINITY for v in (table.x_min_mm, table.y_min_mm, table.z_min_mm)
    ]
    upper = [
        v if v is not None else INFINITY for v in (table.x_max_mm, table.y_max_mm, table.z_max_mm)
    ]
    return model.Where(table.set, _m(lower), _m(upper), table.normal, table.tolerance_mm / 1000.0)


def material_table(scene: SceneTable) -> dict[str, model.Material]:
    return {
        m.name: model.Material(
            m.name, m.youngs_modulus_GPa * 1e9, m.poissons_ratio, m.density_kg_m3
        )
        for m in scene.material
    }


def mesh(table: MeshTable) -> model.MeshRecipe:
    if isinstance(table, BoxTable):
        nx, ny, nz = table.divisions
        return model.BoxMesh(_m(table.size_mm), (nx, ny, nz), _m(table.origin_mm))
    return model.CraneMesh(
        height=table.height_mm / 1000.0,
        foot=table.foot_mm / 1000.0,
        length=table.length_mm / 1000.0,
        column_thickness=table.column_thickness_mm / 1000.0,
        beam_thickness=table.beam_thickness_mm / 1000.0,
        width=table.width_mm / 1000.0,
        load_length=table.load_length_mm / 1000.0,
        element=table.element_mm / 1000.0,
        through=table.through,
        across=table.across,
    )


def _support(table: SupportTable) -> model.Support:
    axes = tuple(axis for axis in "xyz" if axis in table.fix)
    return model.Support(table.name, where(table.where), axes, _m(table.displacement_mm))


def _load(table: LoadTable) -> model.Load:
    if isinstance(table, GravityTable):
        return model.Gravity(table.name, _vec(table.acceleration_m_s2))
    place = where(table.where)
    if isinstance(table, ForceTable):
        return model.Force(table.name, place, _vec(table.force_N))
    if isinstance(table, NodalForceTable):
        return model.NodalForce(table.name, place, _vec(table.force_N))
    if isinstance(table, PressureTable):
        return model.Pressure(table.name, place, table.pressure_MPa * 1e6)
    x, y, z = table.traction_MPa
    return model.Traction(table.name, place, (x * 1e6, y * 1e6, z * 1e6))


def paint(table: PaintTable) -> model.Paint:
    place = where(table.where)
    if isinstance(table, PlainTable):
        return model.Plain(table.name, place, table.albedo)
    up = None if table.up is None else _vec(table.up)
    if isinstance(table, MarkersTable):
        centres = table.centres_mm()
        digits = max(2, len(str(len(centres))))
        markers = tuple(
            model.Marker(f"{table.name}-{number:0{digits}d}", _m(centre))
            for number, centre in enumerate(centres, start=1)
        )
        return model.Markers(
            table.name, place, table.albedo, up, table.size_mm / 1000.0, table.dark, table.light,
            markers,
        )  # fmt: skip
    if isinstance(table, CheckerTable):
        return model.Checker(
            table.name, place, table.albedo, up, table.cell_mm / 1000.0, table.columns, table.rows,
            _m(table.origin_mm), table.dark, table.light,
        )  # fmt: skip
    return model.Dots(
        table.name, place, table.albedo, up, table.diameter_mm / 1000.0, table.pitch_mm / 1000.0,
        table.columns, table.rows, _m(table.origin_mm), table.dot,
    )  # fmt: skip


def body(table: BodyTable, materials: Mapping[str, model.Material]) -> model.Body:
    return model.Body(
        name=table.name,
        material=materials[table.material],
        formulation=table.formulation,
        mesh=mesh(table.mesh),
        supports=tuple(_support(entry) for entry in table.support),
        loads=tuple(_load(entry) for entry in table.load),
        paints=tuple(paint(entry) for entry in table.paint),
    )


def prop(table: PropTable) -> model.Prop:
    return model.Prop(
        table.name, _m(table.center_mm), _vec(table.normal), _vec(table.up), _pair(table.size_mm),
        paint(table.paint[0]),
    )  # fmt: skip


def camera(table: CameraTable) -> model.Camera:
    columns, rows = table.resolution_px
    return model.Camera(
        name=table.name,
        sensor=_pair(table.sensor_mm),
        resolution=(columns, rows),
        focal=table.focal_mm / 1000.0,
        position=_m(table.position_mm),
        target=_m(table.target_mm),
        up=_vec(table.up),
        principal_point_offset=_pair(table.principal_point_offset_mm),
    )


def light(table: LightTable) -> model.Light:
    if isinstance(table, AmbientLightTable):
        origin = (0.0, 0.0, 0.0)
        return model.Light(
            table.name, "ambient", origin, None, (0.0, 0.0), 0.0, table.radiance_W_m2_sr
        )
    position = _m(table.position_mm)
    if isinstance(table, AreaLightTable):
        return model.Light(
            table.name, "area", position, _m(table.target_mm),
            _pair(table.size_mm), table.power_W,
        )  # fmt: skip
    return model.Light(table.name, "point", position, None, (0.0, 0.0), table.power_W)


def measure(table: MeasureTable) -> model.Deflection:
    return model.Deflection(
        table.name, table.camera, tuple(table.groups), tuple(table.static), table.subset_px,
        table.direction,
    )  # fmt: skip


def analysis(scene: SceneTable) -> model.Analysis:
    return model.Analysis(scene.analysis.type, tuple(scene.analysis.load_factors))


def solver(scene: SceneTable) -> model.Solver:
    table = scene.solver
    return model.Solver(table.tolerance, table.max_iterations, table.preconditioner)


def render(scene: SceneTable) -> model.Render:
    return model.Render(scene.render.error, scene.render.background)


def sensor(scene: SceneTable) -> model.Sensor:
    exposure = None if scene.sensor.exposure == "auto" else float(scene.sensor.exposure)
    return model.Sensor(scene.sensor.bits, exposure, scene.sensor.format)


def output(scene: SceneTable) -> model.Output:
    return model.Output(tuple(scene.output.truth), scene.output.vtu, scene.output.stl)
