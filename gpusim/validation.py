"""Arguments of the Python API: refused with one clear message, before anything works with them.

`checked` reads the types from a function's or dataclass' annotations, so that what the signature
says is what is checked: numbers, whole numbers, texts, switches, functions, arrays and tuples of
numbers. A `Rule` beside a type says what else a value must be (``power: Positive``). Other types,
shapes and what depends on several arguments are left to the function itself, which asks by
`gpusim.errors.require`, `require_one_of` and `count_of`.

`unmasked`, which is part of `checked`, is the rule for NumPy's masked arrays, whose masks
`np.asarray` would drop without a word. Masked pixels of a picture that is measured count as NaN
(see `gpusim.measure.images`); anywhere else a masked value is an error.
"""

from __future__ import annotations

import functools
import inspect
import itertools
import re
import types
import typing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError, nearest_name
from gpusim.errors import require as require

T = TypeVar("T", bound=Callable[..., Any])


@dataclass(frozen=True)
class Rule:
    """What a value must be beside its type, in ``Annotated[float, Rule("0 to 1", ...)]``.

    ``expected`` is how that is said; ``fits`` is asked of values of the type alone, NaN included.
    """

    expected: str
    fits: Callable[[Any], bool]


def one_of(*texts: str) -> Rule:
    """One of some texts."""
    return Rule(" or ".join(map(repr, texts)), texts.__contains__)


def within(low: float, high: float, unit: str = "") -> Rule:
    """From ``low`` to ``high``, both included."""
    return Rule(f"{low:g} to {high:g} {unit}".rstrip(), lambda value: low <= value <= high)


def positive(expected: str = "above 0") -> Rule:
    """Finite and above 0; ``expected`` says of what."""
    return Rule(expected, lambda value: 0.0 < value < np.inf)


Positive = Annotated[float, positive()]
FromZero = Annotated[float, Rule("from 0 up", lambda value: 0.0 <= value < np.inf)]
Share = Annotated[float, within(0.0, 1.0)]
"""0 to 1."""
Portion = Annotated[float, Rule("above 0, up to 1", lambda value: 0.0 < value <= 1.0)]
Count = Annotated[int, Rule("a whole number of at least 1", lambda value: value >= 1)]
Finite = Annotated[float, Rule("a finite number", np.isfinite)]


def require_one_of(what: str, got: object, names: Iterable[str]) -> None:
    """Raises InputError "what; got …; expected one of …" unless an argument is one of ``names``."""
    known = tuple(names)
    require(got in known, what, repr(got), f"one of {', '.join(known)}")


def count_of(what: str, value: float) -> int:
    """``value`` as a whole number from 1 up. Raises InputError naming ``what`` if it is none."""
    require(_is_whole(value) and value >= 1, what, value, "a whole number >= 1")
    return int(value)


class _Alternative(NamedTuple):
    """One of the types that a value may have: its name, whether a value is of it, and its rule."""

    name: str
    is_one: Callable[[Any], bool]
    rule: Rule | None = None


def real_numbers(value: Any, what: str) -> Float:
    """``value`` as a float64 array. Raises InputError naming ``what`` if it isn't numbers."""
    array = _array(value)
    if array is None:
        raise InputError(f"{what}; got {_shown(value)}; expected an array of real numbers")
    return array


def finite_numbers(
    value: Any, what: str, shapes: Sequence[tuple[int, ...]], expected: str
) -> Float:
    """``value`` as finite float64 of one of some ``shapes``. Raises InputError naming ``what``."""
    array = as_float64(value, what, expected)
    got = f"shape {array.shape}" if array.size > 3 else _shown(value)
    require(array.shape in shapes, what, got, expected)
    got = f"{got}, not all finite" if array.size > 3 else got
    require(bool(np.isfinite(array).all()), what, got, expected)
    return array


def as_float64(value: Any, what: str, expected: str) -> Float:
    """What NumPy makes numbers of, as float64. Raises InputError naming ``what``."""
    try:
        if np.iscomplexobj(value):
            raise TypeError("complex")
        return np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}; got {_shown(value)} ({error}); expected {expected}") from None


def by_number(names: Iterable[str]) -> list[str]:
    """Sorted, with ``face_10`` after ``face_9``."""

    def parts(name: str) -> list[str | int]:
        return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]

    return sorted(names, key=parts)


def is_number(value: Any) -> bool:
    """Whether it is one real number: of Python or NumPy, no text, no True or False."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    real = isinstance(value, int | float | np.integer | np.floating)
    return real and not isinstance(value, bool | np.bool_)


def checked(thing: T) -> T:
    """Decorator of functions, methods and dataclasses: InputError in place of a TypeError for
    arguments that are unknown, missing, or of another type than annotated.

    A dataclass' own checks come first: they know what is expected better than its types do.
    """
    if not isinstance(thing, type):
        name = thing.__qualname__.rpartition("<locals>.")[2]
        return unmasked()(typing.cast(T, _wrapped(thing, name)))
    init: Any = thing.__init__  # type: ignore[misc]
    thing.__init__ = _wrapped(init, thing.__name__, thing)  # type: ignore[misc]
    return unmasked()(thing)


def unmasked(*images: str) -> Callable[[T], T]:
    """Decorator of functions and classes, methods included: InputError for masked arrays.

    ``images`` are the arguments that may be masked. Masked arrays without a masked value pass.
    """

    def decorated(thing: T) -> T:
        if not isinstance(thing, type):
            return typing.cast(T, _without_masks(thing, thing.__name__, images))
        for name, method in list(vars(thing).items()):
            if inspect.isfunction(method) and (name == "__init__" or not name.startswith("_")):
                where = thing.__name__ if name == "__init__" else f"{thing.__name__}.{name}"
                setattr(thing, name, _without_masks(method, where, images))
        return thing

    return decorated


def _without_masks(
    function: Callable[..., Any], name: str, images: Sequence[str]
) -> Callable[..., Any]:
    own = list(inspect.signature(function).parameters)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        for key, value in itertools.chain(zip(own, args, strict=False), kwargs.items()):
            if key not in images and _is_masked(value):
                raise InputError(
                    f"{name} {key}: masked; got an array with masked values; expected numbers "
                    "everywhere: fill them (.filled()) or leave them out (.compressed()) first"
                )
        return function(*args, **kwargs)

    return call


def _is_masked(value: Any) -> bool:
    """Whether it is, or directly holds, an array some values of which are masked."""
    if isinstance(value, np.ma.MaskedArray):
        return bool(np.ma.is_masked(value))
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        kinds = set(map(type, value))
        kinds = {kind for kind in kinds if issubclass(kind, np.ma.MaskedArray)}
        return bool(kinds) and any(map(np.ma.is_masked, value))
    return False


def _wrapped(
    function: Callable[..., Any], name: str, dataclass: type | None = None
) -> Callable[..., Any]:
    signature = inspect.signature(function)
    own = [p for p in signature.parameters if p != "self"]

    @functools.cache
    def types_of() -> dict[str, list[_Alternative]]:
        # at the first call: annotations may name what the module defines further down. A dataclass
        # may have fields of another module's; no names of its own, which rules couldn't look beyond
        hints = typing.get_type_hints(dataclass or function, localns={}, include_extras=True)
        return {key: _alternatives(hints[key]) for key in own if key in hints}

    def check(given: dict[str, Any], ruled: bool) -> None:
        """Those arguments whose types have a rule, or the others."""
        label = given.get("name") if dataclass else None  # of a camera, a surface
        where = f"{name} {label!r}" if isinstance(label, str) else name
        for key, alternatives in types_of().items():
            if key in given and any(one.rule for one in alternatives) == ruled:
                _check(f"{where} {key}", given[key], alternatives)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError as error:
            raise _misfit(name, own, kwargs, error) from None
        given = bound.arguments
        for key, value in given.items():
            if isinstance(value, np.ndarray) and value.ndim == 0:
                given[key] = value[()]  # a number, which has a hash
        check(given, ruled=True)
        if dataclass is None:
            check(given, ruled=False)
            return function(*bound.args, **bound.kwargs)
        try:
            function(*bound.args, **bound.kwargs)
        except InputError:
            raise
        except (TypeError, ValueError, AttributeError, IndexError):
            check(given, ruled=False)
            raise
        check(given, ruled=False)
        return None

    return call


def _check(what: str, value: Any, alternatives: Sequence[_Alternative]) -> None:
    """Refuse a value that is of none of some types, or breaks the rule of the one that it is of."""
    own = [one for one in alternatives if one.is_one(value)]
    if not alternatives or any(one.rule is None or one.rule.fits(value) for one in own):
        return
    rules = " or ".join(dict.fromkeys(one.rule.expected for one in alternatives if one.rule))
    types_named = " or ".join(dict.fromkeys(one.name for one in alternatives))
    expected = rules if own else f"{types_named}: {rules}" if rules else types_named
    raise InputError(f"{what}; got {value if is_number(value) else _shown(value)}; "
                     f"expected {expected}")  # fmt: skip


def _misfit(name: str, own: Sequence[str], given: Iterable[str], error: TypeError) -> InputError:
    for key in given:
        if key not in own:
            expected = f"expected some of {', '.join(own)}{nearest_name(key, own)}"
            return InputError(f"{name}: unknown argument; got {key!r}; {expected}")
    return InputError(f"{name}: {error}; expected ({', '.join(own)})")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:40]}… ({type(value).__name__})"


def _alternatives(hint: Any) -> list[_Alternative]:
    """What a value of an annotated type may be; [] if not known."""
    hint = getattr(hint, "__value__", hint)  # ``type`` statements, as NumPy's ArrayLike from 2.5 on
    origin = typing.get_origin(hint)
    if origin is Annotated:
        kind, rule = typing.get_args(hint)
        return [one._replace(rule=rule) for one in _alternatives(kind)]
    if origin in (types.UnionType, typing.Union):
        parts = [_alternatives(part) for part in typing.get_args(hint)]
        return [one for part in parts for one in part] if all(parts) else []
    if hint is type(None):
        return [_Alternative("None", lambda value: value is None)]
    if hint is bool:
        return [_Alternative("True or False", lambda value: isinstance(value, bool | np.bool_))]
    if hint is str:
        return [_Alternative("a text", lambda value: isinstance(value, str))]
    if hint is float:
        return [_Alternative("a number", is_number)]
    if hint is int:
        return [_Alternative("a whole number", _is_whole)]
    if origin is Callable:
        return [_Alternative("a function", callable)]
    if hint is np.ndarray or origin is np.ndarray:
        return [_Alternative("an array of real numbers", _is_real)]
    items = [part for part in typing.get_args(hint) if part is not Ellipsis]
    if origin in (tuple, Sequence) and items and all(part in (int, float) for part in items):
        count = len(items) if origin is tuple and Ellipsis not in typing.get_args(hint) else None
        words = "numbers" if count is None else f"{count} numbers"

        def row(value: Any) -> bool:
            array = _array(value)
            return array is not None and array.ndim == 1 and count in (None, len(array))

        return [_Alternative(words, row)]
    return []


def _is_whole(value: Any) -> bool:
    return is_number(value) and float(value).is_integer()


def _is_real(value: Any) -> bool:
    """Whether it is numbers in an array or lists; NumPy would take texts and None as well."""
    try:
        return np.asarray(value).dtype.kind in "iuf"
    except (TypeError, ValueError):
        return False


def _array(value: Any) -> Float | None:
    return np.asarray(value, np.float64) if _is_real(value) else None
