"""The scene file's tables (pydantic, strict); they stop at the loader."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from .base import Table
from .body import BodyTable
from .described import add_descriptions
from .light import LightTable
from .material import MaterialTable
from .measure import MeasureTable, VariantTable
from .processing import AnalysisTable, OutputTable, RenderTable, SolverTable
from .prop import CalibrationTable, PropTable
from .sensor import SensorTable, merged
from .view import CameraTable

__all__ = ["SceneTable", "json_schema"]


class SceneTable(Table):
    """A gpusim scene: structure, loads, cameras, lights, and what to measure."""

    schema_: Annotated[Literal[1], Field(alias="schema")]
    """Version of the scene format."""
    name: Annotated[str, Field(min_length=1, max_length=200)]
    description: str = ""
    material: list[MaterialTable] = []
    body: list[BodyTable] = []
    prop: list[PropTable] = []
    analysis: AnalysisTable = AnalysisTable()
    solver: SolverTable = SolverTable()
    camera: list[CameraTable] = []
    light: list[LightTable] = []
    """Without any, images show the albedo."""
    calibration: CalibrationTable | None = None
    """Images of a calibration target, beside the frames."""
    render: RenderTable = RenderTable()
    sensor: SensorTable = SensorTable()
    measure: list[MeasureTable] = []
    variant: list[VariantTable] = []
    """States that are made in one run and compared."""
    output: OutputTable = OutputTable()

    @model_validator(mode="after")
    def _check_sensors(self) -> SceneTable:
        for index, camera in enumerate(self.camera):
            if camera.sensor is not None:
                merged(self.sensor, camera.sensor, f"camera.{index}.sensor")
        return self


def json_schema() -> dict[str, Any]:
    """The JSON schema of a scene file, for editors.

    Examples
    --------
    >>> from gpusim.scene import json_schema
    >>> json_schema()["type"]
    'object'
    """
    schema = SceneTable.model_json_schema(by_alias=True)
    add_descriptions(schema, SceneTable)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
