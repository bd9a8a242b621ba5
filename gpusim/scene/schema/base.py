"""What every table of a scene file shares: strictness, names, numbers, directions.

Keys carry their unit (``size_mm``, ``force_N``), so a value is a bare number. Nothing is coerced:
``"3"`` is not a number, ``1`` is not a boolean; only an integer stands for a float.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

__all__ = [
    "Albedo",
    "Axis",
    "Direction",
    "Length",
    "Name",
    "Pair",
    "PositivePair",
    "SignedAxis",
    "Table",
    "Vector",
    "Words",
    "fault",
    "norm",
    "parallel",
]

_SMALLEST, _LARGEST = 1e-30, 1e30
_LARGEST_COUNT = 2**63 - 1

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]
Length = Annotated[float, Field(gt=0)]
Albedo = Annotated[float, Field(ge=0, le=1)]
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Direction = Vector
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
PositivePair = Annotated[list[Length], Field(min_length=2, max_length=2)]
Axis = Literal["x", "y", "z"]
SignedAxis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


class Table(BaseModel):
    """One table of the file: unknown keys, wrong types, NaN and infinity are faults.

    So are numbers of a size that nothing measured has: their products leave the range of float64.
    """

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
    )

    @model_validator(mode="after")
    def _sizes(self) -> Self:
        for key in type(self).model_fields:
            for value in _numbers(getattr(self, key)):
                if isinstance(value, int):
                    if not abs(value) <= _LARGEST_COUNT:
                        raise fault(key, "out of any range", value, f"at most {_LARGEST_COUNT}")
                elif value and not _SMALLEST <= abs(value) <= _LARGEST:
                    expected = f"0, or a size from {_SMALLEST:g} to {_LARGEST:g}"
                    raise fault(key, "out of any range", value, expected)
        return self


class Words(str):
    """What was got where it is no value of the file: "neither", "2 cameras"."""


def fault(key: str, problem: str, got: object, expected: str) -> PydanticCustomError:
    """A fault between keys of one table; ``key`` is the one that is blamed ("" for the table)."""
    context = {"key": key, "problem": problem, "got": got, "expected": expected}
    return PydanticCustomError("scene_fault", "{problem}", context)


def _numbers(value: object) -> Iterator[float]:
    """The numbers of a value or of nested lists."""
    if isinstance(value, float | int):
        yield value
    elif isinstance(value, list):
        for item in value:
            yield from _numbers(item)


def norm(vector: list[float]) -> float:
    """Euclidean length."""
    return float(sum(value * value for value in vector) ** 0.5)


def parallel(a: list[float], b: list[float]) -> bool:
    """Whether two vectors are parallel within 1e-6 rad; a zero vector is parallel to all."""
    cross = [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
    return not norm(cross) > 1e-6 * norm(a) * norm(b)
