"""Motion in time: frames are instants at the camera's rate."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Literal

from pydantic import model_validator

from gpusim.scene.tables.table import Length, Names, fault

from .analysis_table import (
    AnalysisTable,
    MassRule,
    ModeCount,
    Rate,
    instants,
    superposition,
)
from .excitation import BaseMotionTable, DampingTable

TimeMethod = Literal["modal", "newmark", "hht", "generalized-alpha"]

_USUAL_COUNT = 20
_STEP_COST, _NONLINEAR_STEP_COST = 0.15, 4.0
"""Linear solutions that a time step takes as long as."""


class TransientTable(AnalysisTable):
    """Motion in time; frames are instants at the camera's rate, whatever steps it is computed in.

    Example::

        type = "transient"
        duration_s = 0.5
        frame_rate_Hz = 50.0
        release = ["weight"]
    """

    type: Literal["transient"]
    duration_s: Length
    """From frame 0, at time 0, to the last frame or a little later."""
    frame_rate_Hz: Rate | None = None
    """The camera's; said here or in [video]."""
    method: TimeMethod = "modal"
    """"modal" superposes ``count`` modes, and has no time steps; the others step through time by
    ``step_s``."""
    geometry: Literal["linear", "nonlinear"] = "linear"
    """"nonlinear": displacements may be any, and materials as in statics; of the methods that
    step."""
    count: ModeCount | None = None
    """How many modes the motion is superposed from; without it 20."""
    step_s: Length | None = None
    """Of the methods that step: without it a quarter of the time from frame to frame."""
    mass: MassRule = "exact"
    """"exact", "lumped" at the nodes, or "calculix": integrated as CalculiX does."""
    damping: DampingTable | None = None
    """None without it."""
    release: Names | None = None
    """Names of loads that are let go at time 0: bodies start from their equilibrium under all
    loads. Without it they start at rest and unloaded."""
    base_motion: BaseMotionTable | None = None
    """The ground that supports stand on moves."""

    about: ClassVar[str] = "motion in time"
    word: ClassVar[str] = "time"
    frames_key: ClassVar[str] = "duration_s"
    vibrates: ClassVar[bool] = True

    @cached_property
    def frame_values(self) -> tuple[float, ...]:
        """Times."""
        return () if self.frame_rate is None else instants(self.duration_s, self.frame_rate)

    def frame_text(self, frame: int) -> str:
        """Its time."""
        return f"{super().frame_text(frame)} s"

    @property
    def time_step(self) -> float | None:
        """s, of the methods that step through time."""
        return None if self.method == "modal" else self.step_s or 0.25 * self.frame_values[1]

    @property
    def mode_count(self) -> int:
        """Of superposition."""
        return self.count or _USUAL_COUNT

    @property
    def solved_for(self) -> dict[str, Any]:
        """Damping, and other arguments of `gpusim.transient`."""
        how: dict[str, Any] = {"method": self.method, "geometry": self.geometry, "mass": self.mass}
        how |= {"step": self.time_step} if self.time_step else {"count": self.mode_count}
        return self.model_dump(include={"damping"}, exclude_none=True) | {"how": how}

    def solutions(self, nonlinear: bool) -> tuple[str, float]:
        """Of modes frames are made; or time steps."""
        frames = len(self.frame_values)
        if self.time_step is None:
            return superposition(self.mode_count, frames)
        steps, large = round(self.frame_values[-1] / self.time_step), self.geometry == "nonlinear"
        words = f"{', nonlinear' * large}, {steps:,} time steps for {frames:,} frames"
        return words, 1.0 + (_NONLINEAR_STEP_COST if large else _STEP_COST) * steps

    @model_validator(mode="after")
    def _check(self) -> TransientTable:
        self.check_instants()
        method = f'of method "{self.method}"'
        if self.method == "modal":
            wanted = 'a method that steps, as "newmark"'
            if self.step_s is not None:
                raise fault("step_s", method, self.step_s, wanted)
            if self.geometry == "nonlinear":
                raise fault("geometry", method, self.geometry, wanted)
            return self
        if self.count is not None:
            raise fault("count", method, self.count, 'method "modal"')
        damping = self.damping
        if damping is None:
            return self
        if damping.ratio is not None:
            raise fault("damping.ratio", method, damping.ratio, 'Rayleigh\'s, or method "modal"')
        if self.geometry == "nonlinear" and damping.rayleigh_stiffness_s:
            raise fault("damping.rayleigh_stiffness_s", "would damp rotations at large "
                        "displacements", damping.rayleigh_stiffness_s,
                        "rayleigh_mass_per_s alone")  # fmt: skip
        return self
