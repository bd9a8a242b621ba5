"""``[analysis]``: what is computed, and the frames that it is computed for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from math import floor
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from gpusim.scene.tables.table import (
    Count,
    Direction,
    Length,
    Listed,
    Names,
    PositivePair,
    Table,
    Words,
    fault,
)

Geometry = Literal["auto", "linear", "nonlinear"]
MassRule = Literal["exact", "calculix", "lumped"]
TimeMethod = Literal["modal", "newmark", "hht", "generalized-alpha"]

MOST_FRAMES = 10_000
Series = Annotated[tuple[float, ...], Listed(1, MOST_FRAMES)]
ModeNumbers = Annotated[
    tuple[Annotated[int, Field(ge=1)], ...], Listed(1, MOST_FRAMES, different=True)
]
Frequencies = Annotated[
    tuple[Annotated[float, Field(gt=0)], ...], Listed(1, MOST_FRAMES, different=True)
]
_FACTORS = (0.0, 1.0)
_COUNTS = {"modal": 10, "buckling": 3}
OTHER_SOLVER = (
    "what another program has solved goes into [body.field] file, or `gpusim render --field FILE`"
)
"""The way out where gpusim doesn't solve."""


@dataclass(frozen=True)
class AnalysisType:
    """A ``type``: what it is ``about``, in a few words.

    given : whether bodies have a ``field`` in place of a mesh.
    vibrates : whether bodies have inertia: materials need a density, and how bodies move is known
        at any instant, not only in frames.
    keys : of its table, those that not all types have; ``needs``: which of them must be there, and
        what each is.
    word : what frames are numbered by.
    """

    about: str
    given: bool = False
    vibrates: bool = False
    keys: tuple[str, ...] = ("geometry", "load_factors", "frame_rate_Hz")
    needs: Mapping[str, str] = field(default_factory=dict)
    word: str = "load_factor"


ANALYSIS_TYPES = {
    "static": AnalysisType("equilibrium"),
    "field": AnalysisType(
        "displacements that are given", given=True, keys=("times", "frame_rate_Hz"),
        needs={"times": "the time of each frame"}, word="time",
    ),
    "modal": AnalysisType(
        "natural frequencies and mode shapes", vibrates=True, word="phase_deg",
        keys=("count", "band_Hz", "mass", "modes", "amplitude_mm", "phases", "prestress"),
    ),
    "transient": AnalysisType(
        "motion in time", vibrates=True, word="time",
        keys=("duration_s", "frame_rate_Hz", "method", "count", "step_s", "mass", "damping",
              "release", "base_motion"),
        needs={"duration_s": "how long it is followed", "frame_rate_Hz": "frames per second"},
    ),
    "harmonic": AnalysisType(
        "steady vibration under loads that swing", vibrates=True, word="phase_deg",
        keys=("frequencies_Hz", "phases", "count", "mass", "damping", "band_Hz"),
        needs={"frequencies_Hz": "the frequencies of the loads that are shown"},
    ),
    "buckling": AnalysisType(
        "critical load factors", keys=("count", "modes", "amplitude_mm"), word="phase_deg",
    ),
}  # fmt: skip
"""`gpusim.scene.analyses.add_analysis` adds another one."""


def frame_count(analysis: Mapping[str, Any] | None) -> int | None:
    """How many frames a plain table has; None if it is no valid one."""
    with suppress(ValidationError):
        return len(AnalysisTable.model_validate(analysis or {}).frame_values)
    return None


def _existing(value: Any) -> Any:
    if value in tuple(ANALYSIS_TYPES):
        return value
    kinds = ", or ".join(f'"{name}" ({kind.about})' for name, kind in ANALYSIS_TYPES.items())
    raise fault("", "unknown value", value, f"{kinds}; {OTHER_SOLVER}")


def _list_kinds(schema: dict[str, Any]) -> None:
    schema["enum"] = list(ANALYSIS_TYPES)


class DampingTable(Table):
    """What takes energy out of a vibration: a share of critical damping, Rayleigh's kind, or of
    harmonic motion a loss factor.

    Example::

        ratio = 0.01
    """

    ratio: Annotated[float, Field(ge=0, lt=1)] | None = None
    """Of critical damping, the same for all modes."""
    rayleigh_mass_per_s: Annotated[float, Field(ge=0)] | None = None
    """Damping per mass; beside it, or without it, rayleigh_stiffness_s."""
    rayleigh_stiffness_s: Annotated[float, Field(ge=0)] | None = None
    """Damping per stiffness."""
    loss_factor: Annotated[float, Field(ge=0)] | None = None
    """Of the stiffness, in harmonic motion: the same energy is lost in each cycle at any
    frequency."""

    @model_validator(mode="after")
    def _check(self) -> DampingTable:
        kinds = [key.split("_")[0] for key, value in self if value is not None]
        if len(set(kinds)) != 1:
            got = Words(" and ".join(dict.fromkeys(kinds)) or "no kind")
            raise fault("", "not one kind of damping", got,
                        "ratio, or Rayleigh's two, or loss_factor")  # fmt: skip
        return self


class BaseMotionTable(Table):
    """How the ground moves that supports stand on; cameras don't move with it.

    Example::

        file = "shaker.csv"
        direction = [1.0, 0.0, 0.0]
    """

    path: Annotated[str, Field(alias="file", min_length=1)]
    """A CSV file of two columns: time (s), and acceleration along ``direction`` (m/s2), the ground
    at rest before."""
    direction: Direction
    """In which it is accelerated; its length doesn't matter."""


class AnalysisTable(Table):
    """What is computed, and the frames that it is computed for: load factors of statics, times, or
    mode shapes.

    Example::

        type = "static"
        load_factors = [0.0, 0.5, 1.0]
    """

    type: Annotated[str, BeforeValidator(_existing), Field(json_schema_extra=_list_kinds)] = (
        "static"
    )
    """"field": bodies have a ``field``, and nothing is solved. "modal" and "buckling": frames show
    the shapes of modes, "transient": times, "harmonic": phases of a steady vibration."""
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
    """How fast frames follow each other, for what moves while a ``camera.shutter`` is open; of type
    "transient" the camera's rate, whatever steps the motion is computed in."""
    count: Annotated[int, Field(ge=1, le=1000)] | None = None
    """How many modes are computed, from the lowest; without it 10, of type "buckling" 3, and 20
    where a motion is superposed from them."""
    band_Hz: PositivePair | None = None
    """Of type "modal": all modes in it, in place of ``count``; of type "harmonic": the report shows
    the response from its first to its second frequency."""
    modes: ModeNumbers | None = None
    """Which modes frames show, 1 the lowest; those of rigid bodies aren't counted. Without it
    all."""
    amplitude_mm: Length | None = None
    """The largest displacement of each body in frames that show modes; 1 without it."""
    phases: Count | None = None
    """Frames in a period of vibration, after frame 0, which shows bodies at rest; 8 without it."""
    prestress: bool | None = None
    """Of type "modal": bodies vibrate about their equilibrium under the loads, which stiffens or
    weakens them."""
    mass: MassRule | None = None
    """"exact" (without it), "lumped" at the nodes, or "calculix": integrated as CalculiX does."""
    duration_s: Length | None = None
    """Of type "transient": from frame 0, at time 0, to the last frame or a little later."""
    method: TimeMethod | None = None
    """Of type "transient": "modal" (without it) superposes ``count`` modes, and has no time steps;
    the others step through time by ``step_s``."""
    step_s: Length | None = None
    """Of the methods that step: without it a quarter of the time from frame to frame."""
    release: Names | None = None
    """Names of loads that are let go at time 0: bodies start from their equilibrium under all
    loads. Without it they start at rest and unloaded."""
    base_motion: BaseMotionTable | None = None
    """Of type "transient": the ground that supports stand on moves."""
    damping: DampingTable | None = None
    """None without it."""
    frequencies_Hz: Frequencies | None = None
    """Of type "harmonic": of the loads; frames show ``phases`` of each."""

    @property
    def vibrates(self) -> bool:
        """Whether bodies have inertia, and may be free."""
        return self._kind.vibrates

    @property
    def scales_loads(self) -> bool:
        """Whether frames are equilibria under multiples of the loads."""
        return "load_factors" in self._kind.keys

    @property
    def load_factors(self) -> tuple[float, ...]:
        """One per frame of statics; what doesn't vary with frames has its loads once."""
        return self.load_factors_ if self.scales_loads else (1.0,)

    @cached_property
    def frame_values(self) -> tuple[float, ...]:
        """One per frame: load factor, time, or phase (deg)."""
        if self.duration_s is not None:
            rate = self.frame_rate_Hz or 1.0
            return tuple(k / rate for k in range(floor(self.duration_s * rate * (1 + 1e-12)) + 1))
        if self.oscillations:
            return (0.0, *(360.0 * turn for _, turn in self.oscillations))
        return self.times or self.load_factors_

    @property
    def shown_modes(self) -> tuple[int, ...]:
        """Numbers of the modes, or of the frequencies, that frames show, from 1."""
        if self.frequencies_Hz is not None:
            return tuple(range(1, len(self.frequencies_Hz) + 1))
        return self.modes or tuple(range(1, self.mode_count + 1))

    @property
    def mode_count(self) -> int:
        """How many modes are computed."""
        return self.count or max(self.modes or (_COUNTS.get(self.type, 20),))

    @property
    def superposes_modes(self) -> bool:
        """Whether modes are all that is solved for, and frames cost no solution of their own."""
        return "count" in self._kind.keys and self.time_step is None

    @property
    def time_step(self) -> float | None:
        """s, of the methods that step through time."""
        if self.type != "transient" or self.method in (None, "modal"):
            return None
        return self.step_s or 0.25 / (self.frame_rate_Hz or 1.0)

    @cached_property
    def oscillations(self) -> tuple[tuple[int, float], ...]:
        """Of modes, and of motions of one frequency: number, and the share of its period that has
        passed, in each frame after the first, in which bodies are at rest."""
        phases = range(self.phase_count)
        return tuple((number, k / len(phases)) for number in self.shown_modes for k in phases)

    @property
    def phase_count(self) -> int:
        """Frames of each mode."""
        if self._kind.word != "phase_deg":
            return 0
        return (self.phases or 8) if "phases" in self._kind.keys else 1

    @property
    def _kind(self) -> AnalysisType:
        return ANALYSIS_TYPES[self.type]

    @model_validator(mode="after")
    def _check(self) -> AnalysisTable:
        kind, given = self._kind, dict[str, Any]()
        for name, info in type(self).model_fields.items():
            if getattr(self, name) != info.default:
                given[info.alias or name] = getattr(self, name)
        for key, value in given.items():
            if key not in (*kind.keys, "type"):
                other = [f'"{name}"' for name, one in ANALYSIS_TYPES.items() if key in one.keys]
                expected = f"type {' or '.join(other)}, or one of {', '.join(kind.keys)}"
                raise fault(key, f'of an analysis of type "{self.type}"', value, expected)
        for key, what in kind.needs.items():
            if key not in given:
                raise fault(key, "missing", Words(f"no {key}"), what)
        for wrong, *words in self._misfits(given):
            if wrong:
                raise fault(*words)
        return self

    def _misfits(self, given: Mapping[str, Any]) -> Iterator[tuple[bool, str, str, Any, str]]:
        """Of the keys that are ``given``: whether they don't fit each other, and what is said
        then."""
        modal, stepping = self.type == "modal", self.time_step is not None
        low, high = self.band_Hz or (0.0, 1.0)
        yield low >= high, "band_Hz", "no band", self.band_Hz, "a lower and a higher frequency"
        in_band = modal and self.band_Hz is not None
        yield (in_band and not self.modes, "modes", "missing beside band_Hz, which doesn't say how "
               "many there are", Words("no modes"), "those that are shown, as [1, 2]")  # fmt: skip
        yield in_band and "count" in given, "count", "beside band_Hz", self.count, "one of them"
        most = max(self.modes or (0,))
        yield most > (self.count or most), "modes", "more than count", most, f"at most {self.count}"
        method = f'of method "{self.method or "modal"}"'
        yield ("step_s" in given and not stepping, "step_s", method, self.step_s,
               'a method that steps, as "newmark"')  # fmt: skip
        yield stepping and "count" in given, "count", method, self.count, 'method "modal"'
        loss = None if self.damping is None else self.damping.loss_factor
        yield (loss is not None and self.type != "harmonic", "damping.loss_factor",
               f'of an analysis of type "{self.type}"', loss, "ratio, or Rayleigh's")  # fmt: skip
        key, frames, fewer = "phases", 0.0, "fewer phases or modes"
        if self.phase_count:
            frames = 1.0 + len(self.shown_modes) * self.phase_count
        else:
            key, fewer = "duration_s", "less time or a lower frame_rate_Hz"
            frames = 1.0 + (self.duration_s or 0.0) * (self.frame_rate_Hz or 0.0)
        yield (not frames <= MOST_FRAMES, key, "too many frames", Words(f"{frames:.6g} frames"),
               f"at most {MOST_FRAMES}, by {fewer}")  # fmt: skip
