"""Shapes in which bodies vibrate or buckle, and steady vibrations: frames are phases of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from gpusim.scene.tables.table import Count, Length, Listed, PositivePair, Words, fault

from .analysis_table import (
    MOST_FRAMES,
    AnalysisTable,
    MassRule,
    ModeCount,
    check_band,
    check_frame_count,
    superposition,
)
from .excitation import HarmonicDampingTable, ShakerTable

ModeNumbers = Annotated[
    tuple[Annotated[int, Field(ge=1)], ...], Listed(1, MOST_FRAMES, different=True)
]
Frequencies = Annotated[
    tuple[Annotated[float, Field(gt=0)], ...], Listed(1, MOST_FRAMES, different=True)
]

_SHOWN = ("modes", "phases", "amplitude_mm")
"""Keys of what frames show of motions that are known."""


class OscillationTable(AnalysisTable):
    """Motions of one frequency each, by number, in phases of their period; frame 0 is at rest."""

    word: ClassVar[str] = "phase_deg"
    vibrates: ClassVar[bool] = True

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
        """Frames of each motion."""
        return int(getattr(self, "phases", 1))

    @cached_property
    def oscillations(self) -> tuple[tuple[int, float], ...]:
        """Number of the motion, and the share of its period that has passed, in each frame after
        the first."""
        count = self.phase_count
        return tuple((number, k / count) for number in self.shown for k in range(count))

    @cached_property
    def frame_values(self) -> tuple[float, ...]:
        """Phases (deg)."""
        return (0.0, *(360.0 * turn for _, turn in self.oscillations))

    def name_of(self, number: int) -> str:
        """What a motion is called."""
        return f"mode {number}"

    def frame_text(self, frame: int) -> str:
        """The motion of a frame, and its phase."""
        if not frame:
            return "at rest"
        number, turn = self.oscillations[frame - 1]
        name = self.name_of(number)
        return name if self.phase_count == 1 else f"{name}, phase {360.0 * turn:g} deg"

    def shown_motions(self, most: int) -> Sequence[Mapping[int, str]]:
        """Modes: the first frame tells their shape."""
        frames = range(1, len(self.frame_values), self.phase_count)[:most]
        return [{frame: self.frame_text(frame)} for frame in frames]

    def solutions(self, nonlinear: bool) -> tuple[str, float]:
        """Of modes frames are made."""
        return superposition(self.mode_count, len(self.frame_values))

    @model_validator(mode="after")
    def _check_frames(self) -> Self:
        count = 1.0 + len(self.shown) * self.phase_count
        check_frame_count(count, "phases", "fewer phases or modes")
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


class ModalTable(_ShapesTable):
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
    phases: Count = 8
    """Frames in a period of vibration, after frame 0, which shows bodies at rest."""
    mass: MassRule = "exact"
    """"exact", "lumped" at the nodes, or "calculix": integrated as CalculiX does."""
    prestress: bool = False
    """Bodies vibrate about their equilibrium under the loads, which stiffens or weakens them."""

    about: ClassVar[str] = "natural frequencies and mode shapes"

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


class HarmonicTable(OscillationTable):
    """Steady vibration under loads that swing, or on a shaker; frames show its phases.

    Example::

        type = "harmonic"
        frequencies_Hz = [95.0, 120.0]
        damping = { ratio = 0.01 }
    """

    type: Literal["harmonic"]
    frequencies_Hz: Frequencies
    """Of the loads, and of the shaker; frames show ``phases`` of each."""
    phases: Count = 8
    """Frames in a period of vibration, after frame 0, which shows bodies at rest."""
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

    def shown_motions(self, most: int) -> Sequence[Mapping[int, str]]:
        """Each in all phases, of which any may be the one that moves most; where there are more,
        the last ones together."""
        motions: dict[int, dict[int, str]] = {}
        for frame, (number, _) in enumerate(self.oscillations, 1):
            motions.setdefault(min(number, most), {})[frame] = self.frame_text(frame)
        return list(motions.values())

    @model_validator(mode="after")
    def _check_band(self) -> HarmonicTable:
        check_band(self.band_Hz)
        return self
