"""Arguments of the Python API: refused with one clear message, before anything works with them.

`checked` reads the types from a function's or dataclass' annotations, so that what the signature
says is what is checked: numbers, whole numbers, texts, switches, arrays and tuples of numbers.
Other types, ranges and shapes are left to the function itself.

`unmasked`, which is part of `checked`, is the rule for NumPy's masked arrays, whose masks
`np.asarray` would drop without a word. Masked pixels of a picture that is measured count as NaN
(see `gpusim.measure.images`); anywhere else a masked value is an error.
"""

from __future__ import annotations

import difflib
import functools
import inspect
import itertools
import re
import types
import typing
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError

T = TypeVar("T", bound=Callable[..., Any])
Test = tuple[str, Callable[[Any], bool]]


def real_numbers(value: Any, what: str) -> Float:
    """``value`` as a float64 array. Raises InputError naming ``what`` if it isn't numbers."""
    array = _array(value)
    if array is None:
        raise InputError(f"{what}; got {_shown(value)}; expected an array of real numbers")
    return array


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


def nearest_name(name: str, names: Iterable[str]) -> str:
    """ " (did you mean x?)" if one of the ``names`` is close, else ""."""
    near = difflib.get_close_matches(name, list(names), 1, 0.6)
    return f" (did you mean {near[0]}?)" if near else ""


def checked(thing: T) -> T:
    """Decorator of functions, methods and dataclasses: InputError in place of a TypeError for
    arguments that are unknown, missing, or of another type than annotated.

    A dataclass' own checks come first: they know what is expected better than its types do.
    """
    if not isinstance(thing, type):
        return unmasked()(typing.cast(T, _wrapped(thing, thing.__name__)))
    init: Any = thing.__init__  # type: ignore[misc]
    thing.__init__ = _wrapped(init, thing.__name__, own_first=True)  # type: ignore[misc]
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
    function: Callable[..., Any], name: str, own_first: bool = False
) -> Callable[..., Any]:
    signature = inspect.signature(function)
    own = [p for p in signature.parameters if p != "self"]

    @functools.cache
    def tests() -> dict[str, list[Test]]:
        # at the first call: annotations may name what the module defines further down
        hints = typing.get_type_hints(function)
        found = {key: _tests(hints[key]) for key in own if key in hints}
        return {key: kinds for key, kinds in found.items() if kinds}

    def check(given: dict[str, Any]) -> None:
        for key, kinds in tests().items():
            if key in given and not any(fits(given[key]) for _, fits in kinds):
                words = " or ".join(dict.fromkeys(word for word, _ in kinds))
                raise InputError(f"{name} {key}; got {_shown(given[key])}; expected {words}")

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise _misfit(name, own, kwargs, error) from None
        if not own_first:
            check(given)
            return function(*args, **kwargs)
        try:
            function(*args, **kwargs)
        except InputError:
            raise
        except (TypeError, ValueError, AttributeError, IndexError):
            check(given)
            raise
        check(given)
        return None

    return call


def _misfit(name: str, own: Sequence[str], given: Iterable[str], error: TypeError) -> InputError:
    for key in given:
        if key not in own:
            expected = f"expected some of {', '.join(own)}{nearest_name(key, own)}"
            return InputError(f"{name}: unknown argument; got {key!r}; {expected}")
    return InputError(f"{name}: {error}; expected ({', '.join(own)})")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:40]}… ({type(value).__name__})"


def _tests(hint: Any) -> list[Test]:
    """What a value of an annotated type must be, one entry per alternative; [] if not known."""
    hint = getattr(hint, "__value__", hint)  # ``type`` statements, as NumPy's ArrayLike from 2.5 on
    origin = typing.get_origin(hint)
    if origin in (types.UnionType, typing.Union):
        parts = [_tests(part) for part in typing.get_args(hint)]
        return [test for part in parts for test in part] if all(parts) else []
    if hint is type(None):
        return [("None", lambda value: value is None)]
    if hint is bool:
        return [("True or False", lambda value: isinstance(value, bool | np.bool_))]
    if hint is str:
        return [("a text", lambda value: isinstance(value, str))]
    if hint is float:
        return [("a number", is_number)]
    if hint is int:
        return [("a whole number", lambda value: is_number(value) and float(value).is_integer())]
    if hint is np.ndarray or origin is np.ndarray:
        return [("an array of real numbers", _is_real)]
    items = [part for part in typing.get_args(hint) if part is not Ellipsis]
    if origin in (tuple, Sequence) and items and all(part in (int, float) for part in items):
        count = len(items) if origin is tuple and Ellipsis not in typing.get_args(hint) else None
        words = "numbers" if count is None else f"{count} numbers"

        def row(value: Any) -> bool:
            array = _array(value)
            return array is not None and array.ndim == 1 and count in (None, len(array))

        return [(words, row)]
    return []


def _is_real(value: Any) -> bool:
    """Whether it is numbers in an array or lists; NumPy would take texts and None as well."""
    try:
        return np.asarray(value).dtype.kind in "iuf"
    except (TypeError, ValueError):
        return False


def _array(value: Any) -> Float | None:
    return np.asarray(value, np.float64) if _is_real(value) else None
