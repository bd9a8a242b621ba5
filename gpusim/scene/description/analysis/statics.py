"""Equilibria under loads, and displacements that are given: frames are load factors, or times."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .analysis_table import AnalysisTable, Rate, Series

Geometry = Literal["auto", "linear", "nonlinear"]

_ITERATIONS = 6
"""Linear solutions that a load step takes as long as."""


class StaticTable(AnalysisTable):
    """Equilibrium under loads; each frame has a load factor.

    Example::

        type = "static"
        load_factors = [0.0, 0.5, 1.0]
    """

    type: Literal["static"] = "static"
    geometry: Geometry = "auto"
    """"linear": forces act on the unloaded shape; "nonlinear": on the shape as it is displaced, and
    displacements may be any; "auto": linear, and nonlinear for a body of which the linear solution
    is off by more than 0.2 % in some frame, or whose material needs it."""
    load_factors_: Annotated[Series, Field(alias="load_factors")] = (0.0, 1.0)
    """All loads and prescribed displacements are multiplied by this; frame 0 is the reference."""
    frame_rate_Hz: Rate | None = None
    """How fast frames follow each other, for what moves while a ``camera.shutter`` is open."""

    about: ClassVar[str] = "equilibrium"
    frames_key: ClassVar[str] = "load_factors"
    scales_loads: ClassVar[bool] = True

    @property
    def frame_values(self) -> tuple[float, ...]:
        """Load factors."""
        return self.load_factors_

    def solutions(self, nonlinear: bool) -> tuple[str, float]:
        """Load steps where they are certain."""
        steps = len(set(self.load_factors_) - {0.0})
        if nonlinear and steps:
            return f", nonlinear, {steps} load steps", 1.0 + _ITERATIONS * steps
        auto = self.geometry == "auto"
        return ", nonlinear if the linear solution is too far off" if auto else "", 1.0


class FieldTable(AnalysisTable):
    """Displacements that are given: bodies have a ``field``, and nothing is solved.

    Example::

        type = "field"
        times = [0.0, 0.5, 1.0]
    """

    type: Literal["field"]
    times: Series
    """The time of each frame, within those of the files and between their steps as you like; frame
    0 is the reference."""
    frame_rate_Hz: Rate | None = None
    """How fast frames follow each other, for what moves while a ``camera.shutter`` is open."""

    about: ClassVar[str] = "displacements that are given"
    word: ClassVar[str] = "time"
    frames_key: ClassVar[str] = "times"
    given: ClassVar[bool] = True

    @property
    def frame_values(self) -> tuple[float, ...]:
        """Times."""
        return self.times
