"""Shapes in which bodies vibrate or buckle, and steady vibrations: frames are phases of these, or
instants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from gpusim.motion import ALL
from gpusim.scene.tables.table import Count, Length, Listed, PositivePair, Words, fault

from .analysis_table import (
    MOST_FRAMES,
    AnalysisTable,
    MassRule,
    ModeCount,
    Rate,
    check_band,
    check_frame_count,
    instants,
    superposition,
)
from .excitation import HarmonicDampingTable, ShakerTable

ModeNumbers = Annotated[
    tuple[Annotated[int, Field(ge=1)], ...], Listed(1, MOST_FRAMES, different=True)
]
Frequencies = Annotated[
    tuple[Annotated[float, Field(gt=0)], ...], Listed(1, MOST_FRAMES, different=True)
]

_SHOWN = ("modes", "phases", "duration_s", "frame_rate_Hz", "amplitude_mm")
_PHASES = 8
"""Keys of what frames show of motions that are known."""


class OscillationTable(AnalysisTable):
    """Motions of one frequency each, by number: one after the other in phases of their period,
    after frame 0, which is at rest; or in time, all at once. ``begin``: share of its period that
    has passed of each at time 0."""

    begin: ClassVar[float] = 0.0
    vibrates: ClassVar[bool] = True

    @property
    def word(self) -> str:
        """Of frames in time another one than of phases."""
        return "phase_deg" if self.frame_rate is None else "time"

    @property
    def shown(self) -> Sequence[int]:
        """Numbers of the motions that frames show, from 1."""
        raise NotImplementedError

    @property
    def mode_count(self) -> int:
        """How many modes are computed."""
        raise NotImplementedError

    @property
    def solved_for(self) -> dict[str, Any]:
        """All keys but those that say what frames show."""
        asked = self.model_dump(exclude={"type", *_SHOWN}, exclude_none=True)
        return asked | {"count": self.mode_count}

    @property
    def phase_count(self) -> int:
        """Frames of each motion that is shown in phases."""
        return int(getattr(self, "phases", 1) or _PHASES)

    @cached_property
    def oscillations(self) -> tuple[tuple[float, ...], ...]:
        """States of a `gpusim.motion.Oscillation` in each frame that isn't at rest: the number of
        the motion, the share of its period and, of frames in time, the time (s) that have passed.
        """
        if self.word == "time":
            return tuple((ALL, self.begin, time) for time in self.frame_values)
        count = self.phase_count
        return tuple((float(number), k / count) for number in self.shown for k in range(count))

    @cached_property
    def frame_values(self) -> tuple[float, ...]:
        """Phases (deg), or times."""
        if self.frame_rate is not None:
            return instants(getattr(self, "duration_s", 0.0), self.frame_rate)
        return (0.0, *(360.0 * turn for _, turn in self.oscillations))

    def name_of(self, number: int) -> str:
        """What a motion is called."""
        return f"mode {number}"

    def frame_text(self, frame: int) -> str:
        """The motion of a frame, and its phase or time."""
        if self.word == "time":
            return f"{super().frame_text(frame)} s"
        if not frame:
            return "at rest"
        name = self.name_of(int(self.oscillations[frame - 1][0]))
        return name if self.phase_count == 1 else f"{name}, phase {self.frame_values[frame]:g} deg"

    def shown_motions(self, most: int) -> Sequence[Mapping[int, str]]:
        """Each in all its frames, of which any may be the one that moves most; where there are
        more, the last ones together. Of frames in time, none."""
        if self.word == "time":
            return []
        motions: dict[int, dict[int, str]] = {}
        for frame, (number, *_) in enumerate(self.oscillations, 1):
            motions.setdefault(min(int(number), most), {})[frame] = self.frame_text(frame)
        return list(motions.values())

    def solutions(self, nonlinear: bool) -> tuple[str, float]:
        """Of modes frames are made."""
        return superposition(self.mode_count, len(self.frame_values))

    @model_validator(mode="after")
    def _check_frames(self) -> Self:
        self.check_instants()
        if self.frame_rate is None:
            count = 1.0 + len(self.shown) * self.phase_count
            check_frame_count(count, "phases", "fewer phases or modes")
        return self


class FilmedTable(OscillationTable):
    """Of which frames are phases, or in time."""

    phases: Count | None = None
    """Frames in a period of vibration, after frame 0, which shows bodies at rest; without it 8."""
    duration_s: Length | None = None
    """In place of phases: frames are in time, from 0 to the last one or a little later, and show
    all modes or frequencies at once; modes from where they pass their place at rest, steady
    vibrations from where loads are greatest."""
    frame_rate_Hz: Rate | None = None
    """The camera's, of frames in time; said here or in [video]."""

    @model_validator(mode="after")
    def _check_time(self) -> Self:
        if self.duration_s is None and self.frame_rate is not None:
            problem = "of frames that are phases"
            raise fault("frame_rate_Hz", problem, self.frame_rate, "duration_s beside it")
        if self.duration_s is not None and self.phases is not None:
            raise fault("phases", "beside duration_s", self.phases, "one of them")
        return self


class _ShapesTable(OscillationTable):
    """Shapes of any amplitude."""

    count: ModeCount | None = None
    """How many modes are computed, from the lowest; without it 10, of type "buckling" 3."""
    modes: ModeNumbers | None = None
    """Which modes frames show, 1 the lowest; those of rigid bodies aren't counted. Without it
    all."""
    amplitude_mm: Length = 1.0
    """The largest displacement of each body in frames that show modes."""

    usual_count: ClassVar[int] = 10

    @property
    def shown(self) -> Sequence[int]:
        """Modes."""
        return self.modes or tuple(range(1, self.mode_count + 1))

    @property
    def mode_count(self) -> int:
        """At least as many as are shown."""
        return self.count or max(self.modes or (self.usual_count,))

    @model_validator(mode="after")
    def _check_modes(self) -> Self:
        most = max(self.modes or (0,))
        if most > (self.count or most):
            raise fault("modes", "more than count", most, f"at most {self.count}")
        return self


class ModalTable(FilmedTable, _ShapesTable):
    """Natural frequencies and mode shapes; frames show these.

    Example::

        type = "modal"
        count = 6
        modes = [1, 3]
        amplitude_mm = 2.0
    """

    type: Literal["modal"]
    band_Hz: PositivePair | None = None
    """All modes in it are computed, in place of ``count``."""
    mass: MassRule = "exact"
    """"exact", "lumped" at the nodes, or "calculix": integrated as CalculiX does."""
    prestress: bool = False
    """Bodies vibrate about their equilibrium under the loads, which stiffens or weakens them."""

    about: ClassVar[str] = "natural frequencies and mode shapes"
    begin: ClassVar[float] = -0.25

    @model_validator(mode="after")
    def _check_band(self) -> ModalTable:
        check_band(self.band_Hz)
        if self.band_Hz is None:
            return self
        if not self.modes:
            problem = "missing beside band_Hz, which doesn't say how many there are"
            raise fault("modes", problem, Words("no modes"), "those that are shown, as [1, 2]")
        if self.count is not None:
            raise fault("count", "beside band_Hz", self.count, "one of them")
        return self


class BucklingTable(_ShapesTable):
    """Critical load factors; frames show the shapes in which the loads, times a factor, buckle
    bodies.

    Example::

        type = "buckling"
        count = 2
    """

    type: Literal["buckling"]

    about: ClassVar[str] = "critical load factors"
    vibrates: ClassVar[bool] = False
    usual_count: ClassVar[int] = 3


class HarmonicTable(FilmedTable):
    """Steady vibration under loads that swing, or on a shaker; frames show its phases.

    Example::

        type = "harmonic"
        frequencies_Hz = [95.0, 120.0]
        damping = { ratio = 0.01 }
    """

    type: Literal["harmonic"]
    frequencies_Hz: Frequencies
    """Of the loads, and of the shaker; frames show ``phases`` of each."""
    band_Hz: PositivePair | None = None
    """The report shows the response from its first to its second frequency."""
    count: ModeCount = 20
    """How many modes the motion is superposed from."""
    mass: MassRule = "exact"
    """"exact", "lumped" at the nodes, or "calculix": integrated as CalculiX does."""
    damping: HarmonicDampingTable | None = None
    """None without it."""
    base_motion: ShakerTable | None = None
    """Supports stand on a shaker that swings, beside loads or in place of them."""

    about: ClassVar[str] = "steady vibration under loads that swing, or on a shaker"

    @property
    def shown(self) -> Sequence[int]:
        """Frequencies."""
        return range(1, len(self.frequencies_Hz) + 1)

    @property
    def mode_count(self) -> int:
        """As the table has it."""
        return self.count

    def name_of(self, number: int) -> str:
        """The frequency."""
        return f"{self.frequencies_Hz[number - 1]:g} Hz"

    @model_validator(mode="after")
    def _check_band(self) -> HarmonicTable:
        check_band(self.band_Hz)
        return self
