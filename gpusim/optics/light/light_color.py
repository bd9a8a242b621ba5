"""Colours of lights, which act upon how strong a light is in each band."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar, Self

from gpusim.errors import InputError
from gpusim.surface.color import BANDS, Colored, color, in_band, is_colored


class LightColor:
    """A field of a light: red, green and blue with a mean of 1, or None where it is grey.

    It takes what `gpusim.surface.color.color` does. (A descriptor, as dataclasses have them for
    fields.)
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(
        self, light: object | None, owner: type | None = None
    ) -> tuple[float, float, float] | None:
        found: tuple[float, float, float] | None
        found = None if light is None else light.__dict__[self.name]
        return found

    def __set__(self, light: object, value: float | str | Sequence[float] | None) -> None:
        what = f"{type(light).__name__} {self.name}; got {value}; expected"
        try:
            found = 1.0 if value is None else color(value)
        except InputError:
            raise InputError(f"{what} three numbers (red, green, blue), or '#rrggbb'") from None
        bands = [in_band(found, band) for band in BANDS]
        if not (min(bands) >= 0.0 and max(bands) > 0.0):
            raise InputError(f"{what} red, green and blue from 0 up, not all of them 0")
        mean = sum(bands) / 3.0
        normalised = tuple(value / mean for value in bands)
        light.__dict__[self.name] = normalised if is_colored(found) else None


class ColoredLight(Colored):
    """Base of lights with a field ``color``; the fields ``strengths`` are multiplied by it."""

    color: Any
    strengths: ClassVar[tuple[str, ...]] = ("power",)

    @property
    def colored(self) -> bool:
        """Whether it isn't grey."""
        return self.color is not None

    @property
    def grey(self) -> Self:
        """The same without colour, as what is equally sensitive in all bands sees it; made once."""
        return self._grey if self.colored else self

    @cached_property
    def _grey(self) -> Self:
        light: Any = self
        result: Self = replace(light, color=None)  # whose mean is 1
        return result

    def _of_band(self, band: int) -> Self:
        # a changed copy: what a new lamp may not have, a power of 0, is right in a band
        result, share = copy.copy(self), 1.0 if self.color is None else self.color[band]
        for name in self.strengths:
            object.__setattr__(result, name, share * getattr(self, name))
        object.__setattr__(result, "color", None)
        return result
