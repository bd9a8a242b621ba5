"""What every table of a scene file shares: strictness, names, numbers, directions, and SI.

Keys carry their unit (``size_mm``, ``force_N``), so a value is a bare number. Nothing is coerced:
``"3"`` is not a number, ``1`` is not a boolean; only an integer stands for a float. Lists of the
file are tuples here: a scene that was read doesn't change.
"""

from __future__ import annotations

import ast
import inspect
import math
import re
import sys
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import cache, reduce
from itertools import pairwise
from operator import or_
from pathlib import PurePath
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from gpusim.files.input_file import results_hint

_SMALLEST, _LARGEST = 1e-30, 1e30
_LARGEST_COUNT = 2**63 - 1
_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}  # per unit of a file
# A millimetre becomes a metre by division by 1000, which rounds once; times 0.001 rounds twice.
UNITS: dict[str, Callable[[Any], float] | None] = {
    "mm": lambda value: value / 1000.0,
    "um": lambda value: value / 1e6,
    "nm": lambda value: value / 1e9,
    "ms": lambda value: value / 1e3,
    "us": lambda value: value / 1e6,
    "MPa": lambda value: value * 1e6,
    "GPa": lambda value: value * 1e9,
    "rpm": lambda value: value * math.tau / 60.0,
    "percent": lambda value: value / 100.0,
    "deg": math.radians,
    **dict.fromkeys(
        ("px", "N", "Hz", "K", "s", "W", "lm", "m_s2", "W_m2", "W_m2_sr", "kg_m3", "per_K", "per_s")
    ),
    **dict.fromkeys(("e", "e_per_s", "DN", "DN_per_e")),
}
"""By the end of a key: what makes its value one in SI, if it isn't."""
_WITH_UNIT = re.compile(rf"(.+?)_({'|'.join(UNITS)})")

Vec3 = tuple[float, float, float]


class Words(str):
    """What was got where it is no value of the file: "neither", "2 cameras"."""


def fault(key: str, problem: str, got: object, expected: str) -> PydanticCustomError:
    """A fault between keys of one table; ``key`` is the one that is blamed ("": what is looked at,
    the table or a value)."""
    context = {"key": key, "problem": problem, "got": got, "expected": expected}
    return PydanticCustomError("scene_fault", "{problem}", context)


class Listed:
    """Marks a tuple that is a list in the file, with the ``least`` and ``most`` items it may have
    (a tuple of a fixed length says that itself), each once if they are ``different``."""

    def __init__(
        self, least: int | None = None, most: int | None = None, different: bool = False
    ) -> None:
        self.least, self.most, self.different = least, most, different

    def _tuple(self, items: list[Any]) -> tuple[Any, ...]:
        if self.different and len(set(items)) != len(items):
            raise fault("", "has one twice", items, "each once")
        return tuple(items)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        item, *rest = source.__args__
        fixed = None if rest == [...] else len(source.__args__)
        listed = core_schema.list_schema(
            handler.generate_schema(item),
            min_length=fixed or self.least,
            max_length=fixed or self.most,
        )
        return core_schema.no_info_after_validator_function(
            self._tuple,
            listed,
            serialization=core_schema.wrap_serializer_function_ser_schema(
                # of several types that a value may have, each is asked
                lambda value, write: write(list(value)) if isinstance(value, tuple) else value,
                schema=listed,
            ),
        )


class AnyOf:
    """Marks what may be a table of any kind: of those that there are by the key ``type`` when the
    class is made."""

    def __init__(self, tables: Mapping[str, type[Table]]) -> None:
        self.tables = tables

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        tables: Any = reduce(or_, self.tables.values())
        return handler.generate_schema(Annotated[tables, Field(discriminator="type")])


def _with_direction(vector: Vec3) -> Vec3:
    if not norm(vector) > 0:
        raise fault("", "has no direction", vector, "a vector that isn't zero")
    return vector


Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]
Names = Annotated[tuple[Name, ...], Listed(different=True)]
SeveralNames = Annotated[tuple[Name, ...], Listed(1, different=True)]
Length = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1, le=100_000)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Numbers = Annotated[tuple[float, ...], Listed()]
Vector = Annotated[Vec3, Listed()]
Direction = Annotated[Vec3, Listed(), AfterValidator(_with_direction)]
Pair = Annotated[tuple[float, float], Listed()]
PositivePair = Annotated[tuple[Length, Length], Listed()]
Axis = Literal["x", "y", "z"]
SignedAxis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
FileUnit = Literal["m", "cm", "mm", "um", "in"]


def file_unit(file: str) -> FileUnit:
    """That of a file's coordinates where nothing is said: metres for glTF, which says so itself."""
    return "m" if PurePath(file).suffix.lower() in (".glb", ".gltf") else "mm"


def metres(unit: FileUnit) -> float:
    """Metres per unit of a file."""
    return _METRES[unit]


def in_si(value: Any, unit: str) -> Any:
    """A number, or a tuple of numbers or of tuples, of ``unit`` in SI; None stays None."""
    convert = UNITS.get(unit)
    if value is None or convert is None:
        return value
    if isinstance(value, tuple):
        return tuple(in_si(item, unit) for item in value)
    return convert(value)


def name_and_unit(key: str) -> tuple[str, str]:
    """``"size_mm"`` -> "size" and "mm"; without a unit the key and ""."""
    found = _WITH_UNIT.fullmatch(key)
    return (found[1], found[2]) if found else (key, "")


class _InSI:
    """A key's value in SI."""

    def __init__(self, key: str, unit: str) -> None:
        self.key, self.unit = key, unit

    def __get__(self, table: object | None, owner: type) -> Any:
        return self if table is None else in_si(getattr(table, self.key), self.unit)


def descriptions(table: type[BaseModel]) -> dict[str, str]:
    """The text below each field in the source, by the field's name; base classes included.

    Read when somebody asks for it. pydantic would read it whenever the classes are made
    (``use_attribute_docstrings``): a third of the time that a scene's classes take, in every
    command.
    """
    found: dict[str, str] = {}
    for owner in reversed(table.__mro__):
        if issubclass(owner, BaseModel) and owner is not BaseModel:
            found |= _field_texts(owner.__module__).get(owner.__name__, {})
    return found


@cache
def _field_texts(module: str) -> dict[str, dict[str, str]]:
    """The same of every class of a module, by its name."""
    classes = ast.parse(inspect.getsource(sys.modules[module])).body
    return {
        one.name: {
            field.target.id: inspect.cleandoc(text.value.value)
            for field, text in pairwise(one.body)
            if isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
            and isinstance(text.value.value, str)
        }
        for one in classes
        if isinstance(one, ast.ClassDef)
    }


def add_descriptions(schema: dict[str, Any], table: type[BaseModel]) -> None:
    """Enter the texts of the fields in a table's JSON schema, and the example of its docstring:
    as TOML, and as what that says."""
    texts = descriptions(table)
    for name, info in table.model_fields.items():
        entry = schema["properties"][info.alias or name]
        if name in texts:
            entry["description"] = texts[name]
        elif "const" in entry:
            entry["description"] = "Says which kind of table it is."
    about, *example = schema.get("description", "").split("\n\nExample::\n\n")
    if example:
        text = inspect.cleandoc(example[0])
        schema |= {"description": about, "examples": [tomllib.loads(text)], "x-toml": text}


class Table(BaseModel):
    """One table of the file: unknown keys, wrong types, NaN and infinity are faults.

    So are numbers of a size that nothing measured has: their products leave the range of float64.

    A key's value in SI has the key's name without its unit: ``size`` is that of ``size_mm``, None
    if that is None. A class that says itself what ``size`` is keeps it.
    """

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        json_schema_extra=add_descriptions,
    )

    if TYPE_CHECKING:  # scripts/mypy_si.py knows of which type

        def __getattr__(self, name: str) -> Any: ...

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        super().__pydantic_init_subclass__(**options)
        for key in cls.model_fields:
            name, unit = name_and_unit(key)
            if unit and name not in cls.model_fields and not hasattr(cls, name):
                setattr(cls, name, _InSI(key, unit))

    @model_validator(mode="after")
    def _sizes(self) -> Self:
        for name, info in type(self).model_fields.items():
            for value in _numbers(getattr(self, name)):
                if isinstance(value, int):
                    if not abs(value) <= _LARGEST_COUNT:
                        expected = f"at most {_LARGEST_COUNT}"
                        raise fault(info.alias or name, "out of any range", value, expected)
                elif value and not _SMALLEST <= abs(value) <= _LARGEST:
                    expected = f"0, or a size from {_SMALLEST:g} to {_LARGEST:g}"
                    raise fault(info.alias or name, "out of any range", value, expected)
        return self


def _numbers(value: object) -> Iterator[float]:
    """The numbers of a value or of nested lists."""
    if isinstance(value, float | int):
        yield value
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _numbers(item)


def table_of(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A table of a plain document; what is none is an empty one."""
    table = document.get(key)
    return table if isinstance(table, Mapping) else {}


def tables_of(document: Mapping[str, Any], key: str) -> Iterator[tuple[int, dict[str, Any]]]:
    """The tables of a list in a plain document, with their places; what is none is left out."""
    items = document.get(key)
    for place, item in enumerate(items if isinstance(items, list) else ()):
        if isinstance(item, dict):
            yield place, item


def known_suffix(kind: str, file: str, known: Collection[str]) -> str:
    """The ending of a file; raises a fault for the key ``file`` if it isn't a ``known`` one."""
    suffix = PurePath(file).suffix.lower()
    if suffix not in known:
        expected = "one of " + ", ".join(known) + results_hint(file)
        raise fault("file", f"unknown kind of {kind}", file, expected)
    return suffix


def norm(vector: Sequence[float]) -> float:
    """Euclidean length."""
    return float(sum(value * value for value in vector) ** 0.5)


def between(a: Vec3, b: Vec3) -> Vec3:
    """From a to b."""
    return b[0] - a[0], b[1] - a[1], b[2] - a[2]


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def parallel(a: Vec3, b: Vec3) -> bool:
    """Whether two vectors are parallel within 1e-6 rad; a zero vector is parallel to all."""
    return not norm(cross(a, b)) > 1e-6 * norm(a) * norm(b)


def unit(vector: Vec3) -> Vec3:
    """A vector of length 1."""
    x, y, z = (value / norm(vector) for value in vector)
    return x, y, z


def across(vector: Vec3, axis: Vec3) -> Vec3:
    """The part of a vector that is perpendicular to an ``axis`` of length 1."""
    along = sum(a * b for a, b in zip(axis, vector, strict=True))
    x, y, z = (a - along * b for a, b in zip(vector, axis, strict=True))
    return x, y, z
