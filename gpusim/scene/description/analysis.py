"""``[analysis]``: what is computed, and the frames that it is computed for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from .table import Listed, Table, Words, fault

Geometry = Literal["auto", "linear", "nonlinear"]

Series = Annotated[tuple[float, ...], Listed(1, 10_000)]
_FACTORS = (0.0, 1.0)
OTHER_SOLVER = (
    "what another program has solved goes into [body.field] file, or `gpusim render --field FILE`"
)
"""The way out where gpusim doesn't solve."""
_PLANNED = ("modal", "transient", "harmonic", "dynamic", "buckling")


@dataclass(frozen=True)
class AnalysisType:
    """A ``type``: what it is ``about``, in a few words; whether bodies have a ``field`` in place of
    a mesh, and frames times in place of load factors: ``given``."""

    about: str
    given: bool = False


ANALYSIS_TYPES = {
    "static": AnalysisType("equilibrium"),
    "field": AnalysisType("displacements that are given", given=True),
}
"""`gpusim.scene.analyses.add_analysis` adds another one."""


def _existing(value: Any) -> Any:
    if value in tuple(ANALYSIS_TYPES):
        return value
    kinds = ", or ".join(f'"{name}" ({kind.about})' for name, kind in ANALYSIS_TYPES.items())
    if value in _PLANNED:
        raise fault("", "no such analysis yet", value, f"{kinds}; {OTHER_SOLVER}")
    raise fault("", "unknown value", value, kinds)


def _list_kinds(schema: dict[str, Any]) -> None:
    schema["enum"] = list(ANALYSIS_TYPES)


class AnalysisTable(Table):
    """Statics, or displacements that are given; one frame per load factor or time.

    Example::

        type = "static"
        load_factors = [0.0, 0.5, 1.0]
    """

    type: Annotated[str, BeforeValidator(_existing), Field(json_schema_extra=_list_kinds)] = (
        "static"
    )
    """"field": bodies have a ``field``, and nothing is solved."""
    geometry: Geometry = "auto"
    """"linear": forces act on the unloaded shape; "nonlinear": on the shape as it is displaced, and
    displacements may be any; "auto": linear, and nonlinear for a body of which the linear solution
    is off by more than 0.2 % in some frame, or whose material needs it."""
    load_factors_: Annotated[Series, Field(alias="load_factors")] = _FACTORS
    """All loads and prescribed displacements are multiplied by this; frame 0 is the reference."""
    times: Series | None = None
    """Of type "field": the time of each frame, within those of the files and between their steps as
    you like; frame 0 is the reference."""
    frame_rate_Hz: Annotated[float, Field(gt=0)] | None = None
    """How fast frames follow each other, for what moves while a ``camera.shutter`` is open."""

    @property
    def load_factors(self) -> tuple[float, ...]:
        """One per frame; of type "field" its time."""
        return self.times or self.load_factors_

    @model_validator(mode="after")
    def _check(self) -> AnalysisTable:
        if ANALYSIS_TYPES[self.type].given:
            if self.times is None:
                raise fault("times", "missing", Words("no times"), "the time of each frame")
            if self.geometry != "auto":
                raise fault("geometry", "of a given field", self.geometry, "none")
            if self.load_factors_ != _FACTORS:
                raise fault("load_factors", "of a given field", self.load_factors_, "times")
        elif self.times is not None:
            raise fault("times", f'of an analysis of type "{self.type}"', self.times,
                        "load_factors")  # fmt: skip
        return self
