"""``[[measure]]``: what is measured in the images; ``[[variant]]``: states that are compared."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from .base import Length, Name, SignedAxis, Table, fault

__all__ = ["DamageTable", "DeflectionTable", "MeasureTable", "StereoTable", "VariantTable"]


class PublishedTable(Table):
    """What somebody else reached; the report sets it beside this run's error."""

    error_percent: Annotated[float, Field(ge=0)]
    """Relative error of the measure's main number: the last marker's displacement."""
    source: Annotated[str, Field(min_length=1)]
    """Where it is written."""


class DeflectionTable(Table):
    """The deflection line: markers tracked from frame 0 to the last frame."""

    name: Name
    type: Literal["deflection"]
    camera: Name
    groups: Annotated[list[Name], Field(min_length=1)]
    """Paints of markers on bodies, in order from the clamp."""
    static: list[Name] = []
    """Paints of markers on props: what they move is the camera's motion."""
    subset_px: Annotated[int, Field(ge=5, le=1001)] | None = None
    """Side of the tracked square, odd; without it as large as the marker allows."""
    direction: SignedAxis
    """Of the deflection that counts as positive."""
    published: PublishedTable | None = None

    @model_validator(mode="after")
    def _check(self) -> DeflectionTable:
        if self.subset_px is not None and self.subset_px % 2 == 0:
            raise fault("subset_px", "even", self.subset_px, "an odd number of pixels")
        for key, names in (("groups", self.groups), ("static", self.static)):
            if len(set(names)) != len(names):
                raise fault(key, "the same paint twice", names, "each once")
        return self


class StereoTable(Table):
    """Points in space from two or more cameras that are calibrated from images alone.

    The cameras' calibration comes from the images of [calibration], which has to show a checker;
    the markers' displacement between frame 0 and the last one from triangulation.
    """

    name: Name
    type: Literal["stereo"]
    cameras: Annotated[list[Name], Field(min_length=2)]
    """The first one's coordinates are the rig's."""
    groups: Annotated[list[Name], Field(min_length=1)]
    """Paints of markers on bodies, in order from the clamp."""
    static: list[Name] = []
    """Paints of markers on props: what they move is the rig's motion."""
    lens: Literal[
        "pinhole", "radial", "radial3", "radtan", "brown", "rational", "prism", "tilted"
    ] = "brown"
    """What the calibration is to find: no distortion, k1 k2, + k3, + p1 p2, + k4..k6, + s1..s4,
    + tau."""
    subset_px: Annotated[int, Field(ge=5, le=1001)] | None = None
    """Side of the tracked square, odd; without it as large as the marker allows."""
    published: PublishedTable | None = None

    @model_validator(mode="after")
    def _check(self) -> StereoTable:
        if self.subset_px is not None and self.subset_px % 2 == 0:
            raise fault("subset_px", "even", self.subset_px, "an odd number of pixels")
        for key, names in (
            ("cameras", self.cameras), ("groups", self.groups), ("static", self.static)
        ):  # fmt: skip
            if len(set(names)) != len(names):
                raise fault(key, "a name twice", names, "each once")
        return self


class DamageTable(Table):
    """Differences of a deflection line between the variants, and where their slope changes."""

    name: Name
    type: Literal["damage"]
    of: Name
    """The [[measure]] of type "deflection" that every variant makes."""
    reference: Name
    """The [[variant]] that the others are compared with."""
    tolerance_mm: Length = 10.0
    """How far a change of slope may be from the notch that made it."""
    significance: Annotated[float, Field(gt=0, lt=1)] = 1e-3
    """Highest p-value at which a change of slope counts."""
    most: Annotated[int, Field(ge=1, le=50)] = 6
    """Changes of slope that are looked for."""
    clearance_mm: Annotated[float, Field(ge=0)] | None = None
    """Markers nearer than this to a change don't count for where it is; the default is the depth of
    the notched member: so far the line is bent by how stress flows round the notch."""


MeasureTable = Annotated[DeflectionTable | StereoTable | DamageTable, Field(discriminator="type")]


class VariantTable(Table):
    """A state of the scene. With variants, a run makes all of them, in ``variants/<name>``."""

    name: Name
    set: dict[str, Any] = {}
    """Keys of the scene that are different: dotted paths, as in --set."""
