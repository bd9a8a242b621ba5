"""What is done with a scene: ``[analysis]``, ``[solver]``, ``[render]``, ``[output]``,
``[[variant]]``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from .colors import Tint
from .table import Listed, Name, Table, Words, fault

TruthLayer = Literal[
    "reference",
    "displacement",
    "depth",
    "flow",
    "region",
    "element",
    "visibility",
    "cameras",
    "normal",
]
Geometry = Literal["auto", "linear", "nonlinear"]
CalibrationFormat = Literal["opencv", "matchid", "vic", "dice", "kalibr"]

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


class SolverTable(Table):
    """How far to solve.

    Example::

        tolerance = 1e-8
        method = "direct"
    """

    # the keys are arguments of `gpusim.fem.solve`

    tolerance: Annotated[float, Field(gt=0, le=0.1)] = 1e-6
    """Estimated relative error of the displacement (energy norm) at which the solver stops."""
    max_iterations: Annotated[int, Field(ge=1)] | None = None
    """Of conjugate gradients (a direct solver has none); without it the solver chooses; running out
    of them ends the run with exit code 3."""
    method: Literal["auto", "direct", "multigrid"] = "auto"
    """"auto": the quicker one of a direct solver and multigrid, by an estimate for the matrix."""


class RenderTable(Table):
    """How exact the images are.

    Example::

        error = 0.1
        background = 0.2
    """

    error: Annotated[float, Field(gt=0, le=16)] = 0.25
    """Allowed error of a pixel, in grey levels of 8 bit: so many lens positions and moments."""
    background: Tint = 0.0
    """Radiance where nothing is seen (W / (m2 sr); without lights: albedo)."""


class OutputTable(Table):
    """What is written beside images, measurements and report.

    Example::

        truth = ["reference", "displacement", "flow"]
        vtu = true
        stress = true
    """

    truth: Annotated[tuple[TruthLayer, ...], Listed(different=True)] = ()
    """Layers of truth.h5, per camera and frame, where a body is seen (not a prop)."""
    vtu: bool = False
    """The solution for ParaView."""
    stress: bool = False
    """Stress, von Mises stress and an error indicator, in the .vtu files and the report."""
    stl: bool = False
    """The deformed surface, one file per paint and frame."""
    fields: bool = True
    """Pictures of the bodies in the colours of their displacement, stress and strain, in the folder
    fields, and in the report. Stress and strain where stress is asked for, or the meshes have at
    most 20,000 elements together."""
    calibration: Annotated[tuple[CalibrationFormat, ...], Listed(different=True)] = ()
    """The cameras as calibration files of these programs."""


class VariantTable(Table):
    """A state of the scene. With variants, a run makes all of them, in ``variants/<name>``.

    Example::

        name = "notched"
        set = { "body.beam.notch" = [{ position_mm = 60.0, width_mm = 2.0, depth_mm = 4.0 }] }
    """

    name: Name
    """Of its folder, and what measures and the report call it."""
    changes: Annotated[dict[str, Any], Field(alias="set")] = {}
    """Keys of the scene that are different: dotted paths, as in --set."""
