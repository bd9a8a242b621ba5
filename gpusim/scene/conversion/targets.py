"""From the tables of targets to the parameters of the paints that draw them, in SI."""

from __future__ import annotations

from gpusim.scene.schema.paint import (
    ArucoTable,
    CharucoTable,
    CirclesTable,
    LinesTable,
    RingCodesTable,
    StarTable,
)

__all__ = ["target_values"]

Table = ArucoTable | CharucoTable | CirclesTable | LinesTable | RingCodesTable | StarTable
Values = dict[str, float | int | str | tuple[float, ...]]
ALONG = {"both": "both", "across": "s", "up": "t"}


def target_values(table: Table) -> tuple[str, list[list[float]], Values]:
    """Kind, places (mm) and parameters (m) of a target."""
    values: Values
    if isinstance(table, LinesTable):
        values = {
            "pitch": table.pitch_mm / 1000.0, "width": table.width_mm / 1000.0,
            "along": ALONG[table.along], "columns": table.columns, "rows": table.rows,
            "albedo": table.line, "ground": table.albedo,
        }  # fmt: skip
        return table.type, [table.origin_mm], values
    if isinstance(table, RingCodesTable):
        values = {
            "codes": tuple(table.codes), "diameter": table.diameter_mm / 1000.0,
            "bits": table.bits, "dot": table.dot, "ground": table.albedo,
        }  # fmt: skip
        return table.type, table.positions_mm, values
    values = {"dark": table.dark, "light": table.light, "ground": table.albedo}
    if isinstance(table, CharucoTable):
        values |= {
            "columns": table.columns, "rows": table.rows, "square": table.square_mm / 1000.0,
            "marker": table.marker_mm / 1000.0, "dictionary": table.dictionary,
        }  # fmt: skip
        return table.type, [table.origin_mm], values
    if isinstance(table, CirclesTable):
        values["diameters"] = tuple(size / 1000.0 for size in table.diameters_mm)
    elif isinstance(table, StarTable):
        values |= {"diameter": table.diameter_mm / 1000.0, "spokes": table.spokes}
    else:
        values |= {
            "size": table.size_mm / 1000.0, "ids": tuple(table.ids),
            "dictionary": table.dictionary,
        }  # fmt: skip
    return table.type, table.positions_mm, values
