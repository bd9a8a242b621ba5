"""Names and numbers in input files."""

from __future__ import annotations

from typing import Generic, TypeVar

import numpy as np

from gpusim.errors import InputError
from gpusim.mesh.formats.abaqus.cards import nearest

__all__ = ["LARGEST", "Names", "is_plain", "number", "whole"]

T = TypeVar("T")

LARGEST = 1e60
"""Beyond it products of numbers (volumes, stresses) would leave the range of float64."""


class Names(Generic[T]):
    """Named things, found without regard to case; the spelling of the first definition is kept.

    In a file with instances of parts, what a part names is ``INSTANCE.NAME``. Where there is one
    instance only (``single``), ``NAME`` finds it too, unless the assembly has a thing of that name;
    the assembly's own name (``assembly``) may stand before any.
    """

    def __init__(self, what: str, single: str = "", assembly: str = "") -> None:
        self.what = what
        self.single = single.upper()
        self.assembly = assembly.upper()
        self.shown: dict[str, str] = {}
        self.values: dict[str, T] = {}
        self.places: dict[str, str] = {}

    def __contains__(self, name: str) -> bool:
        return self._key(name) in self.values

    def set(self, name: str, value: T) -> None:
        self.shown.setdefault(name.upper(), name)
        self.values[name.upper()] = value

    def define(self, name: str, value: T, where: str) -> None:
        """A thing that is defined once. Raises InputError where its name is taken."""
        first = self.places.setdefault(name.upper(), where)
        if name.upper() in self.values:
            raise InputError(
                f"{where}: a second {self.what} of one name; got {name!r}, which {first} defines; "
                "expected names of their own"
            )
        self.set(name, value)

    def get(self, name: str, where: str) -> T:
        """Raises InputError with the nearest name."""
        key = self._key(name)
        if key in self.values:
            return self.values[key]
        known = list(self.shown.values())
        listed = ", ".join(known[:8]) + (", …" if len(known) > 8 else "")
        raise InputError(
            f"{where}: unknown {self.what}; got {name!r}; "
            f"expected one of {listed or 'none, none is defined'}{nearest(name, known)}"
        )

    def items(self) -> list[tuple[str, T]]:
        """Names as they are shown: those of a single instance without it, where that is enough."""
        found = []
        for key, value in self.values.items():
            short = key.removeprefix(f"{self.single}.") if self.single else key
            plain = short == key or short in self.values
            shown = self.shown[key]
            found.append((shown if plain else shown[len(self.single) + 1 :], value))
        return found

    def _key(self, name: str) -> str:
        key = name.upper()
        if key not in self.values and self.assembly:
            key = key.removeprefix(f"{self.assembly}.")
        if key not in self.values and self.single:
            key = f"{self.single}.{key}"
        return key


def is_plain(text: str) -> bool:
    """Whether Python takes nothing in it for a digit that other programs don't: 1_000, \u0663."""
    return "_" not in text and text.isascii()


def number(text: str, where: str) -> float:
    """A finite float64; Fortran's ``1.D3`` is one. Raises InputError."""
    try:
        value = float(text.replace("D", "E").replace("d", "e")) if is_plain(text) else np.nan
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{where}: not a number; got {text!r}; expected a finite number")
    if abs(value) > LARGEST:
        raise InputError(f"{where}: number too large; got {text}; expected at most {LARGEST:g}")
    return value


def whole(text: str, where: str) -> int:
    """A whole number below 2^53 in size. Raises InputError."""
    try:
        value = int(text if is_plain(text) and len(text) < 40 else "?")
    except ValueError:
        raise InputError(f"{where}: not a whole number; got {text!r}; expected one") from None
    if abs(value) >= 2**53:
        raise InputError(f"{where}: number too large; got {text}; expected less than 2^53")
    return value
