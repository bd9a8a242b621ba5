"""From tables to frozen dataclasses: units to SI, names to things, lines to points."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from gpusim.scene.conversion import photo
from gpusim.scene.description import model
from gpusim.scene.schema import SceneTable
from gpusim.scene.schema.base import norm
from gpusim.scene.schema.body import BodyTable, SupportTable
from gpusim.scene.schema.load import (
    CentrifugalTable,
    ForceTable,
    GravityTable,
    LineForceTable,
    LoadTable,
    NodalForceTable,
    PressureTable,
    ThermalTable,
)
from gpusim.scene.schema.material import MaterialTable
from gpusim.scene.schema.measure import DamageTable, DeflectionTable, MeasureTable, StereoTable
from gpusim.scene.schema.paint import (
    CheckerTable,
    DotsTable,
    ImageTable,
    MarkersTable,
    PaintTable,
    PatternTable,
    PlainTable,
    SpeckleTable,
)
from gpusim.scene.schema.prop import BoxPropTable, PlateTable, PoseTable, PropTable
from gpusim.scene.schema.sensor import SensorTable, merged
from gpusim.scene.schema.view import CameraTable
from gpusim.scene.schema.where import WhereTable

from .mesh import field_recipe, mesh_recipe, metres
from .targets import target_values

__all__ = [
    "analysis",
    "body",
    "calibration",
    "camera",
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
    return {table.name: _material(table) for table in scene.material}


def _material(table: MaterialTable) -> model.Material:
    expansion = table.expansion_per_K
    if table.type == "isotropic":
        return model.Isotropic(
            table.name, table.youngs_modulus_GPa * 1e9, table.poissons_ratio, table.density_kg_m3,
            expansion,
        )  # fmt: skip
    assert table.shear_modulus_GPa is not None
    first = _unit(table.axis_1)
    along = sum(a * b for a, b in zip(first, table.axis_2, strict=True))
    second = _unit([b - along * a for a, b in zip(first, table.axis_2, strict=True)])
    third = (
        first[1] * second[2] - first[2] * second[1],
        first[2] * second[0] - first[0] * second[2],
        first[0] * second[1] - first[1] * second[0],
    )
    return model.Orthotropic(
        name=table.name,
        youngs_moduli=_vec([value * 1e9 for value in table.youngs_modulus_GPa]),
        poissons_ratios=_vec(table.poissons_ratio),
        shear_moduli=_vec([value * 1e9 for value in table.shear_modulus_GPa]),
        density=table.density_kg_m3,
        expansion=_vec(expansion if isinstance(expansion, list) else [expansion] * 3),
        axes=(first, second, third),
    )


def _unit(values: list[float]) -> model.Vec3:
    return _vec(values, norm(values))


def _support(table: SupportTable, factors: model.Amplitude) -> model.Support:
    axes = tuple(axis for axis in "xyz" if axis in table.fix)
    return model.Support(
        table.name, where(table.where), axes, _m(table.displacement_mm), table.type == "symmetry",
        _amplitude(table.amplitude, factors),
    )  # fmt: skip


def _amplitude(given: list[float] | None, factors: model.Amplitude) -> model.Amplitude:
    return factors if given is None else tuple(given)


def _load(table: LoadTable, factors: model.Amplitude) -> model.Load:
    name, amplitude = table.name, _amplitude(table.amplitude, factors)
    if isinstance(table, GravityTable):
        return model.Gravity(name, _vec(table.acceleration_m_s2), amplitude)
    if isinstance(table, ThermalTable):
        return model.Thermal(name, table.temperature_change_K, amplitude)
    if isinstance(table, CentrifugalTable):
        omega = table.speed_rpm * math.tau / 60.0
        point, axis = _m(table.axis_point_mm), _vec(table.axis)
        return model.Centrifugal(name, point, axis, omega, amplitude)
    place = where(table.where)
    if isinstance(table, ForceTable):
        return model.Force(name, place, _vec(table.force_N), amplitude)
    if isinstance(table, LineForceTable):
        return model.LineForce(name, place, _vec(table.force_N), amplitude)
    if isinstance(table, NodalForceTable):
        return model.NodalForce(name, place, _vec(table.force_N), amplitude)
    if isinstance(table, PressureTable):
        return model.Pressure(name, place, table.pressure_MPa * 1e6, amplitude)
    x, y, z = table.traction_MPa
    return model.Traction(name, place, (x * 1e6, y * 1e6, z * 1e6), amplitude)


def paint(table: PaintTable) -> model.Paint:
    bump = None
    if table.bump_um > 0.0:
        along = None if table.bump_along is None else _vec(table.bump_along)
        bump = model.Bump(
            table.bump_um / 1e6, table.bump_length_mm / 1000.0, along, table.bump_stretch,
            table.bump_seed,
        )  # fmt: skip
    return replace(_paint(table), finish=model.Finish(table.roughness, table.metallic, bump))


def _paint(table: PaintTable) -> model.Paint:
    if isinstance(table, PlainTable):
        return model.Plain(table.name, where(table.where), table.albedo)
    if table.mapping == "plane":
        return _pattern(table)
    if table.axis_point_mm is None or table.axis is None:
        return replace(_pattern(table), wrap=model.Wrap())
    return replace(_pattern(table), wrap=model.Wrap(_m(table.axis_point_mm), _vec(table.axis)))


def _pattern(table: PatternTable) -> model.Pattern:
    place = where(table.where)
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
    if isinstance(table, SpeckleTable):
        return model.Speckle(
            table.name, place, table.albedo, up, table.diameter_mm / 1000.0, table.coverage,
            table.softness_mm / 1000.0, table.size_law, table.spread, table.arrangement,
            table.seed, table.dot,
        )  # fmt: skip
    if isinstance(table, ImageTable):
        return model.Picture(
            table.name, place, table.albedo, up, table.file, table.texel_mm / 1000.0,
            _m(table.origin_mm), table.dark, table.light, table.gamma,
        )  # fmt: skip
    if not isinstance(table, DotsTable):
        kind, places, values = target_values(table)
        return model.Target(
            table.name, place, table.albedo, up, kind, tuple(_m(p) for p in places),
            tuple(values.items()),
        )  # fmt: skip
    return model.Dots(
        table.name, place, table.albedo, up, table.diameter_mm / 1000.0, table.pitch_mm / 1000.0,
        table.columns, table.rows, _m(table.origin_mm), table.dot,
    )  # fmt: skip


def body(
    table: BodyTable, materials: Mapping[str, model.Material], factors: model.Amplitude
) -> model.Body:
    """``factors`` are the load factors of the frames, for what has no amplitude of its own."""
    if table.field is not None:
        mesh: model.MeshRecipe = field_recipe(table.field)
    else:
        assert table.mesh is not None  # the table's own check made sure
        mesh = mesh_recipe(table.mesh, table.notch)
    return model.Body(
        name=table.name,
        material=None if table.material is None else materials[table.material],
        parts=tuple(model.Part(materials[p.material], where(p.where)) for p in table.part),
        formulation=table.formulation,
        mesh=mesh,
        supports=tuple(_support(entry, factors) for entry in table.support),
        loads=tuple(_load(entry, factors) for entry in table.load),
        paints=tuple(paint(entry) for entry in table.paint),
    )


def _radians(degrees: list[float]) -> model.Vec3:
    x, y, z = (math.radians(value) for value in degrees)
    return x, y, z


def _pose(table: PoseTable) -> model.Pose:
    return model.Pose(_m(table.position_mm), _radians(table.rotation_deg))


def prop(table: PropTable) -> model.Prop:
    poses = tuple(_pose(entry) for entry in table.poses or ())
    if isinstance(table, PlateTable):
        return model.Plate(
            table.name, _m(table.center_mm), _vec(table.normal), _vec(table.up),
            _pair(table.size_mm), paint(table.paint[0]), poses,
        )  # fmt: skip
    paints = tuple(paint(entry) for entry in table.paint)
    turn = _radians(table.rotation_deg)
    if isinstance(table, BoxPropTable):
        return model.Box(table.name, _m(table.center_mm), _m(table.size_mm), paints, turn, poses)
    return model.Shape(
        table.name, table.file, metres(table.unit), _m(table.position_mm), paints, turn, poses
    )


def calibration(scene: SceneTable) -> model.Calibration | None:
    table = scene.calibration
    if table is None:
        return None
    cameras = table.cameras or [camera.name for camera in scene.camera]
    poses = tuple(_pose(entry) for entry in table.pose)
    return model.Calibration(table.board, tuple(cameras), tuple(table.show), poses)


def camera(table: CameraTable, common: SensorTable) -> model.Camera:
    """``common`` is the scene's [sensor]."""
    columns, rows = table.resolution_px
    size = table.size_mm()
    intrinsics: tuple[float, ...] = ()
    if table.fx_px is not None:
        assert table.fy_px is not None and table.cx_px is not None and table.cy_px is not None
        intrinsics = (table.fx_px, table.fy_px, table.cx_px, table.cy_px, table.skew_px)
    focal = table.focal_mm or 0.0
    if table.fx_px is not None and size is not None:
        focal = table.fx_px * size[0] / columns
    rotation = table.rotation_vector or []
    if table.rotation_matrix is not None:
        rotation = [value for row in table.rotation_matrix for value in row]
    return model.Camera(
        name=table.name,
        sensor=(0.0, 0.0) if size is None else _pair(size),
        resolution=(columns, rows),
        focal=focal / 1000.0,
        position=None if table.position_mm is None else _m(table.position_mm),
        target=None if table.target_mm is None else _m(table.target_mm),
        up=_vec(table.up),
        principal_point_offset=_pair(table.principal_point_offset_mm),
        intrinsics=intrinsics,
        distortion=tuple(table.distortion),
        rotation=tuple(rotation),
        translation=None if table.translation_mm is None else _m(table.translation_mm),
        calibration=table.calibration or "",
        calibration_camera=table.calibration_camera,
        calibration_unit=(table.calibration_unit_mm or 0.0) / 1000.0,
        lens=photo.lens(table.lens),
        shutter=photo.shutter(table.shutter),
        electronics=None
        if table.sensor is None
        else photo.sensor(merged(common, table.sensor, "sensor")),
    )


def measure(table: MeasureTable) -> model.Measure:
    if isinstance(table, StereoTable):
        return model.Stereo(
            table.name, tuple(table.cameras), tuple(table.groups), tuple(table.static), table.lens,
            table.subset_px, _published(table),
        )  # fmt: skip
    if isinstance(table, DamageTable):
        return model.Damage(
            table.name, table.of, table.reference, table.tolerance_mm / 1000.0,
            table.significance, table.most,
            None if table.clearance_mm is None else table.clearance_mm / 1000.0,
        )  # fmt: skip
    return model.Deflection(
        table.name, table.camera, tuple(table.groups), tuple(table.static), table.subset_px,
        table.direction, _published(table),
    )  # fmt: skip


def _published(table: DeflectionTable | StereoTable) -> model.Published | None:
    own = table.published
    return None if own is None else model.Published(own.error_percent / 100.0, own.source)


def analysis(scene: SceneTable) -> model.Analysis:
    table = scene.analysis
    return model.Analysis(table.type, tuple(table.times or table.load_factors), table.frame_rate_Hz)


def solver(scene: SceneTable) -> model.Solver:
    table = scene.solver
    return model.Solver(table.tolerance, table.max_iterations, table.method)


def render(scene: SceneTable) -> model.Render:
    return model.Render(scene.render.error, scene.render.background)


def sensor(scene: SceneTable) -> model.Sensor:
    return photo.sensor(scene.sensor)


def output(scene: SceneTable) -> model.Output:
    table = scene.output
    return model.Output(tuple(table.truth), table.vtu, table.stl, table.stress)
