"""The tables of ``[[measure]]`` that find what vibrates in pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from gpusim.scene.tables.table import Name, Pair, PositivePair, Vector, fault

from .analysis.analysis_table import check_band
from .correlation_measures import one_of_each
from .measure_table import MeasureFault, MeasureTable
from .video import frame_rate_in

LEAST_FRAMES = 64
"""Of which modes can be told."""


class ModesTable(MeasureTable):
    """Natural frequencies, damping and mode shapes, from points along a line in the pictures of one
    camera; nobody needs to know the loads.

    Example::

        name = "modes"
        type = "modes"
        camera = "side"
        start_mm = [5.0, 0.0, 5.0]
        end_mm = [235.0, 0.0, 5.0]
        count = 12
        modes = 2
        excitation = "release"
    """

    type: Literal["modes"]
    references: ClassVar[Mapping[str, str]] = {"camera": "camera"}
    places: ClassVar[Sequence[str]] = ("start", "end")
    least_frames: ClassVar[int] = LEAST_FRAMES
    endings: ClassVar[Sequence[str]] = ("-shapes", "-series")

    camera: Name
    """The one that films."""
    start_px: Pair | None = None
    """Where the line begins in the first picture."""
    start_mm: Vector | None = None
    """Where it begins on the unloaded structure."""
    end_px: Pair | None = None
    """Where it ends in the first picture."""
    end_mm: Vector | None = None
    """Where it ends on the unloaded structure."""
    count: Annotated[int, Field(ge=1, le=2000)] = 20
    """Points, evenly spaced."""
    subset_px: Annotated[int, Field(ge=7, le=255)] = 21
    """Side of the square around each point, odd."""
    method: Literal["lucas-kanade", "gradient", "phase"] = "lucas-kanade"
    """How points are followed: by subsets, iterated or by their first step alone, which motions of
    a small part of a pixel need, or by the local phase, which changes of light don't touch."""
    modes: Annotated[int, Field(ge=1, le=50)] = 3
    """How many are looked for, at most."""
    band_Hz: PositivePair | None = None
    """Where; without it up to 0.45 pictures a second."""
    identification: Literal["ssi", "fdd"] = "ssi"
    """Covariance-driven subspace identification, or enhanced frequency-domain decomposition, which
    needs long films."""
    excitation: Literal["ambient", "release"] = "ambient"
    """"ambient": by a random force, all the time; "release": let go, or hit, at the beginning."""

    def seconds(self, markers: int, pixels: int, frames: int) -> float:
        """Roughly how long it takes."""
        return 1.0 + frames * (1e-8 * pixels + 2e-4 * self.count)

    @model_validator(mode="after")
    def _check(self) -> ModesTable:
        one_of_each(self, self.places)
        check_band(self.band_Hz)
        if self.identification == "fdd" and self.excitation == "release":
            raise fault("excitation", 'with identification "fdd"', "release", '"ambient"')
        return self

    @classmethod
    def faults(
        cls, entry: Mapping[str, Any], document: Mapping[str, Any]
    ) -> Iterator[MeasureFault]:
        """Frames are in time, as many and as fast as what is looked for needs."""
        rate = frame_rate_in(document)
        if rate is None:
            wanted = 'analysis.frame_rate_Hz, and of type "modal" or "harmonic" duration_s'
            yield ("type",), "without a time between frames", "modes", wanted
        band = entry.get("band_Hz")
        if isinstance(band, list) and isinstance(rate, int | float):
            fast = [one for one in band if isinstance(one, int | float) and one >= 0.5 * rate]
            if fast:
                wanted = f"below {0.5 * rate:g}, half of the frame rate"
                yield ("band_Hz",), "faster than frames show", fast[-1], wanted
        if isinstance(subset := entry.get("subset_px"), int) and subset % 2 == 0:
            yield ("subset_px",), "even", subset, "an odd number"
