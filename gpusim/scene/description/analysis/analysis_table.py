"""What every ``[analysis]`` says, whatever its kind, and the kinds that there are.

A kind of analysis is known by its ``type``: here is its table, in `gpusim.scene.analyses` what
moves bodies by it.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from contextlib import suppress
from math import floor
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, ValidationError

from gpusim.scene.tables.table import AnyOf, Listed, Table, Words, fault

MassRule = Literal["exact", "calculix", "lumped"]
Rate = Annotated[float, Field(gt=0)]

_MODE_COST = 1.5
"""Linear solutions that a mode takes as long as."""
MOST_FRAMES = 10_000
Series = Annotated[tuple[float, ...], Listed(1, MOST_FRAMES)]
ModeCount = Annotated[int, Field(ge=1, le=1000)]
OTHER_SOLVER = (
    "what another program has solved goes into [body.field] file, or `gpusim render --field FILE`"
)
"""The way out where gpusim doesn't solve."""


class AnalysisTable(Table):
    """What is computed, and the frames that it is computed for; each kind has a table of its own.

    A subclass gives ``type`` the kind's name, adds its keys, and says

    - ``about``: what it is, in a few words;
    - ``frame_values``: a number for each frame, which is a ``word``; ``frames_key``: which key has
      one for each, so that loads may have one as well;
    - ``given``: whether bodies have a ``field`` in place of a mesh;
    - ``vibrates``: whether bodies have inertia (materials need a density, and nothing needs to hold
      them), and how they move is known at any instant, not only in frames;
    - ``scales_loads``: whether frames are equilibria under multiples of the loads.
    """

    type: str

    about: ClassVar[str] = ""
    frames_key: ClassVar[str] = "type"
    given: ClassVar[bool] = False
    vibrates: ClassVar[bool] = False
    scales_loads: ClassVar[bool] = False

    @property
    def word(self) -> str:
        """What ``frame_values`` are."""
        return "load_factor"

    @property
    def frame_values(self) -> tuple[float, ...]:
        """One per frame."""
        raise NotImplementedError

    @property
    def frame_rate(self) -> float | None:
        """Hz; None where frames aren't instants of a motion."""
        return getattr(self, "frame_rate_Hz", None)

    @classmethod
    def in_time(cls, given: Container[str]) -> bool:
        """Whether frames of a table with the ``given`` keys are in time, if their rate is known."""
        lasts = "duration_s" in given or "duration_s" not in cls.model_fields
        return "frame_rate_Hz" in cls.model_fields and lasts

    def at_rate(self, rate: float | None) -> Self:
        """The table with the ``rate`` (Hz) of frames that are in time, where it says none. Raises a
        fault of the key ``analysis``."""
        said = self.frame_rate is not None or not self.in_time(self.model_fields_set)
        if rate is None or said:
            return self
        timed = self.model_copy(update={"frame_rate_Hz": rate})
        timed.check_instants("analysis.")
        return timed

    def check_instants(self, at: str = "") -> None:
        """Raises a fault of a key, which begins ``at``, where frames in time are too few or too
        many."""
        duration, rate = getattr(self, "duration_s", None), self.frame_rate
        if duration is None or rate is None:
            return
        key, count = f"{at}duration_s", 1.0 + duration * rate
        check_frame_count(count, key, "less time or a lower frame_rate_Hz")
        if len(instants(duration, rate)) < 2:
            wanted = f"at least {1.0 / rate:g}, from one frame to the next"
            raise fault(key, "over before a second frame", duration, wanted)

    @property
    def load_factors(self) -> tuple[float, ...]:
        """One per frame of statics; what doesn't vary with frames has its loads once."""
        return self.frame_values if self.scales_loads else (1.0,)

    @property
    def moves_ground(self) -> bool:
        """Whether the supports stand on something that moves."""
        return getattr(self, "base_motion", None) is not None

    def shown_motions(self, most: int) -> Sequence[Mapping[int, str]]:
        """Of vibrations that are shown, so many at ``most``: the frames that tell their shape, and
        their texts."""
        return ()

    def frame_text(self, frame: int) -> str:
        """What is shown in a frame, in a few words."""
        return f"{self.word.replace('_', ' ')} {self.frame_values[frame]:g}"

    def solutions(self, nonlinear: bool) -> tuple[str, float]:
        """How bodies are solved, as far as it is known, and how many linear solutions take as long;
        ``nonlinear``: some are certain to need large displacements."""
        return "", 1.0


TABLES: dict[str, type[AnalysisTable]] = {}
"""The tables of all kinds by their ``type``; `gpusim.scene.analyses.add_analysis` adds one."""


def frame_count(analysis: Mapping[str, Any] | None) -> int | None:
    """How many frames a plain table has; None if it is no valid one."""
    given = {"type": "static", **(analysis or {})}
    with suppress(ValidationError, KeyError, TypeError):
        return len(TABLES[given["type"]].model_validate(given).frame_values)
    return None


def instants(duration: float, rate: float) -> tuple[float, ...]:
    """Times (s) of frames at a ``rate`` (Hz), from 0 on."""
    return tuple(k / rate for k in range(floor(duration * rate * (1 + 1e-12)) + 1))


def superposition(modes: int, frames: int) -> tuple[str, float]:
    """As `AnalysisTable.solutions` has it, of ``frames`` that are made of ``modes``."""
    return f", {modes} modes; {frames:,} frames are superposed from them", 1.0 + _MODE_COST * modes


def check_frame_count(count: float, key: str, fewer: str) -> None:
    """Of a table's ``key``. Raises a fault."""
    if not count <= MOST_FRAMES:
        raise fault(key, "too many frames", Words(f"{count:.6g} frames"),
                    f"at most {MOST_FRAMES}, by {fewer}")  # fmt: skip


def check_band(band: tuple[float, float] | None) -> None:
    """Raises a fault for one whose ends aren't in their order."""
    if band is not None and not band[0] < band[1]:
        raise fault("band_Hz", "no band", band, "a lower and a higher frequency")


def _of_known_type(value: Any) -> Any:
    """A plain table with its type, which is "static" if it isn't said."""
    if not isinstance(value, dict):
        return value
    value = {"type": "static", **value}
    if value["type"] not in tuple(TABLES):
        kinds = ", or ".join(f'"{name}" ({table.about})' for name, table in TABLES.items())
        raise fault("type", "unknown value", value["type"], f"{kinds}; {OTHER_SOLVER}")
    return value


AnyAnalysis = Annotated[AnalysisTable, AnyOf(TABLES), BeforeValidator(_of_known_type)]
"""The table of any kind."""
