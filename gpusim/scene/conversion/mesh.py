"""From the tables of a mesh and its notches to a recipe in metres."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from gpusim.scene.description import mesh_recipe as recipe
from gpusim.scene.schema.field import FieldTable
from gpusim.scene.schema.mesh import (
    BeamTable,
    BoxTable,
    BracketTable,
    CraneTable,
    FileTable,
    MeshTable,
    NotchTable,
)

__all__ = ["field_recipe", "mesh_recipe", "metres"]

_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}


def mesh_recipe(table: MeshTable, notches: Sequence[NotchTable]) -> recipe.MeshRecipe:
    """Notches belong to boxes and beams; others have none (checked before)."""
    slots = tuple(
        recipe.NotchRecipe(
            notch.position_mm / 1000.0, notch.width_mm / 1000.0, notch.depth_mm / 1000.0,
            notch.axis, notch.side, notch.cells,
        )
        for notch in notches
    )  # fmt: skip
    if isinstance(table, BoxTable):
        return recipe.BoxMesh(
            _three(table.size_mm), _counts(table.divisions), _three(table.origin_mm), table.cells,
            slots,
        )  # fmt: skip
    if isinstance(table, BeamTable):
        return recipe.BeamMesh(
            length=table.length_mm / 1000.0,
            width=table.width_mm / 1000.0,
            height=table.height_mm / 1000.0,
            end_width=(table.end_width_mm or table.width_mm) / 1000.0,
            end_height=(table.end_height_mm or table.height_mm) / 1000.0,
            divisions=_counts(table.divisions),
            cells=table.cells,
            notches=slots,
        )
    if isinstance(table, CraneTable):
        return _crane(table)
    if isinstance(table, FileTable):
        step = PurePath(table.file).suffix.lower() in (".step", ".stp")
        return recipe.FileMesh(
            path=table.file,
            scale=1e-3 if step else _METRES[table.unit],
            order=table.order,
            size=None if table.size_mm is None else table.size_mm / 1000.0,
            hexahedra=table.hexahedra,
            hex_dominant=table.hex_dominant,
            curvature=table.curvature,
            time_limit=table.time_limit_s,
        )
    if isinstance(table, BracketTable):
        return recipe.BracketMesh(
            base_length=table.base_length_mm / 1000.0,
            wall_height=table.wall_height_mm / 1000.0,
            width=table.width_mm / 1000.0,
            thickness=table.thickness_mm / 1000.0,
            fillet_radius=table.fillet_radius_mm / 1000.0,
            hole_diameter=table.hole_diameter_mm / 1000.0,
            around=table.around,
            radial=table.radial,
            through=table.through,
            bend=table.bend,
            cells=table.cells,
        )
    return recipe.PlateMesh(
        length=table.length_mm / 1000.0,
        width=table.width_mm / 1000.0,
        thickness=table.thickness_mm / 1000.0,
        hole_diameter=table.hole_diameter_mm / 1000.0,
        around=table.around,
        radial=table.radial,
        through=table.through,
        cells=table.cells,
    )


def metres(unit: str) -> float:
    """Metres per unit of a file."""
    return _METRES[unit]


def field_recipe(table: FieldTable) -> recipe.FieldMesh:
    """The result file of a body whose displacements are given."""
    return recipe.FieldMesh(table.file, _METRES[table.unit], table.scale, table.displacement)


def _crane(table: CraneTable) -> recipe.CraneMesh:
    return recipe.CraneMesh(
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
        cells=table.cells,
    )


def _three(values: Sequence[float]) -> recipe.Vec3:
    x, y, z = values
    return x / 1000.0, y / 1000.0, z / 1000.0


def _counts(values: Sequence[int]) -> tuple[int, int, int]:
    x, y, z = values
    return x, y, z
