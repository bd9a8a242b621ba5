"""What is done with a scene: ``[analysis]``, ``[solver]``, ``[render]``, ``[output]``,
``[[measure]]``, ``[[variant]]``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from .colors import Tint
from .table import (
    SI,
    Length,
    Listed,
    Name,
    Names,
    SeveralNames,
    SignedAxis,
    Table,
    Words,
    each_once,
    fault,
)

__all__ = [
    "Analysis",
    "Damage",
    "Deflection",
    "Measure",
    "MeasureTable",
    "Output",
    "Published",
    "Render",
    "Solver",
    "Stereo",
    "Variant",
]

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

Series = Annotated[tuple[float, ...], Listed(1, 10_000)]
_FACTORS = (0.0, 1.0)
_PLANNED = ("modal", "transient", "harmonic", "dynamic", "buckling")


def _existing(value: Any) -> Any:
    from gpusim.scene.analyses import ANALYSES

    if value in tuple(ANALYSES):
        return value
    problem = "no such analysis yet" if value in _PLANNED else "unknown value"
    raise fault("", problem, value, '"static" (linear), or "field" (displacements that are given)')


_KINDS = {"enum": ["static", "field"], "type": "string"}


class Analysis(Table):
    """Linear statics, or displacements that are given; one frame per load factor or time."""

    type: Annotated[str, BeforeValidator(_existing), WithJsonSchema(_KINDS)] = "static"
    """"field": bodies have a ``field``, and nothing is solved."""
    load_factors_: Annotated[Series, Field(alias="load_factors")] = _FACTORS
    """All loads and prescribed displacements are multiplied by this; frame 0 is the reference."""
    times: Series | None = None
    """Of type "field": the time of each frame, within those of the files and between their steps as
    you like; frame 0 is the reference."""
    frame_rate_Hz: Annotated[float, Field(gt=0)] | None = None
    """How fast frames follow each other, for what moves while a ``camera.shutter`` is open."""
    frame_rate = SI[float | None]("Hz")

    @property
    def load_factors(self) -> tuple[float, ...]:
        """One per frame; of type "field" its time."""
        return self.times or self.load_factors_

    @model_validator(mode="after")
    def _check(self) -> Analysis:
        if self.type == "field":
            if self.times is None:
                raise fault("times", "missing", Words("no times"), "the time of each frame")
            if self.load_factors_ != _FACTORS:
                raise fault("load_factors", "of a given field", self.load_factors_, "times")
        elif self.times is not None:
            raise fault("times", 'of an analysis that is not of type "field"', self.times,
                        "load_factors")  # fmt: skip
        return self


class Solver(Table):
    """How far to solve."""

    tolerance: Annotated[float, Field(gt=0, le=0.1)] = 1e-6
    """Estimated relative error of the displacement (energy norm) at which the solver stops."""
    max_iterations: Annotated[int, Field(ge=1)] | None = None
    """Of conjugate gradients (a direct solver has none); without it the solver chooses; running out
    of them ends the run with exit code 3."""
    method: Literal["auto", "direct", "multigrid"] = "auto"
    """"auto": the quicker one of a direct solver and multigrid, by an estimate for the matrix."""


class Render(Table):
    """How exact the images are."""

    error: Annotated[float, Field(gt=0, le=16)] = 0.25
    """Allowed error of a pixel, in grey levels of 8 bit: so many lens positions and moments."""
    background: Tint = 0.0
    """Radiance where nothing is seen (W / (m2 sr); without lights: albedo)."""


class Output(Table):
    """What is written beside images, measurements and report."""

    truth: Annotated[tuple[TruthLayer, ...], Listed()] = ()
    """Layers of truth.h5, per camera and frame."""
    vtu: bool = False
    """The solution for ParaView."""
    stress: bool = False
    """Stress, von Mises stress and an error indicator, in the .vtu files and the report."""
    stl: bool = False
    """The deformed surface, one file per paint and frame."""

    @model_validator(mode="after")
    def _check(self) -> Output:
        each_once("truth", "a layer twice", self.truth)
        return self


class Published(Table):
    """What somebody else reached; the report sets it beside this run's error."""

    error_percent: Annotated[float, Field(ge=0)]
    """Relative error of the measure's main number: the last marker's displacement."""
    error = SI[float]("percent")
    source: Annotated[str, Field(min_length=1)]
    """Where it is written."""


def _odd(subset: int | None) -> None:
    if subset is not None and subset % 2 == 0:
        raise fault("subset_px", "even", subset, "an odd number of pixels")


class Deflection(Table):
    """The deflection line: markers tracked from frame 0 to the last frame."""

    name: Name
    type: Literal["deflection"]
    camera: Name
    groups: SeveralNames
    """Paints of markers on bodies, in order from the clamp."""
    static: Names = ()
    """Paints of markers on props: what they move is the camera's motion."""
    subset_px: Annotated[int, Field(ge=5, le=1001)] | None = None
    """Side of the tracked square, odd; without it as large as the marker allows."""
    subset = SI[int | None]("px")
    direction: SignedAxis
    """Of the deflection that counts as positive."""
    published: Published | None = None

    @model_validator(mode="after")
    def _check(self) -> Deflection:
        _odd(self.subset_px)
        for key, names in (("groups", self.groups), ("static", self.static)):
            each_once(key, "the same paint twice", names)
        return self


class Stereo(Table):
    """Points in space from two or more cameras that are calibrated from images alone.

    The cameras' calibration comes from the images of [calibration], which has to show a checker;
    the markers' displacement between frame 0 and the last one from triangulation.
    """

    name: Name
    type: Literal["stereo"]
    cameras: Annotated[tuple[Name, ...], Listed(2)]
    """The first one's coordinates are the rig's."""
    groups: SeveralNames
    """Paints of markers on bodies, in order from the clamp."""
    static: Names = ()
    """Paints of markers on props: what they move is the rig's motion."""
    lens: Literal[
        "pinhole", "radial", "radial3", "radtan", "brown", "rational", "prism", "tilted"
    ] = "brown"
    """What the calibration is to find: no distortion, k1 k2, + k3, + p1 p2, + k4..k6, + s1..s4,
    + tau."""
    subset_px: Annotated[int, Field(ge=5, le=1001)] | None = None
    """Side of the tracked square, odd; without it as large as the marker allows."""
    subset = SI[int | None]("px")
    published: Published | None = None

    @model_validator(mode="after")
    def _check(self) -> Stereo:
        _odd(self.subset_px)
        for key in ("cameras", "groups", "static"):
            each_once(key, "a name twice", getattr(self, key))
        return self


class Damage(Table):
    """Differences of a deflection line between the variants, and where their slope changes."""

    name: Name
    type: Literal["damage"]
    of: Name
    """The [[measure]] of type "deflection" that every variant makes."""
    reference: Name
    """The [[variant]] that the others are compared with."""
    tolerance_mm: Length = 10.0
    """How far a change of slope may be from the notch that made it."""
    tolerance = SI[float]("mm")
    significance: Annotated[float, Field(gt=0, lt=1)] = 1e-3
    """Highest p-value at which a change of slope counts."""
    most: Annotated[int, Field(ge=1, le=50)] = 6
    """Changes of slope that are looked for."""
    clearance_mm: Annotated[float, Field(ge=0)] | None = None
    """Markers nearer than this to a change don't count for where it is; the default is the depth of
    the notched member: so far the line is bent by how stress flows round the notch."""
    clearance = SI[float | None]("mm")


Measure = Deflection | Stereo | Damage
MeasureTable = Annotated[Measure, Field(discriminator="type")]


class Variant(Table):
    """A state of the scene. With variants, a run makes all of them, in ``variants/<name>``."""

    name: Name
    changes: Annotated[dict[str, Any], Field(alias="set")] = {}
    """Keys of the scene that are different: dotted paths, as in --set."""
