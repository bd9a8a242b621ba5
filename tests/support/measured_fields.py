"""A result of a measurement at points of a picture, as small as can be."""

from __future__ import annotations

from dataclasses import dataclass

from gpusim.pipeline.measurements.results import Result

__all__ = ["FieldResult"]


@dataclass(frozen=True, eq=False)
class FieldResult(Result):
    """With the cameras whose picture the points are in."""

    cameras: tuple[str, ...]
