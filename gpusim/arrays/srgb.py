"""The curve of sRGB (IEC 61966-2-1): linear values as screens and files have them, and back."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

T = TypeVar("T", bound=np.floating)


def encoded(linear: npt.NDArray[T]) -> npt.NDArray[T]:
    """What stands for linear values from 0 to 1, of the same type."""
    result: npt.NDArray[T] = np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055
    )
    return result


def decoded(value: npt.NDArray[T]) -> npt.NDArray[T]:
    """The linear values that encoded ones from 0 to 1 stand for, of the same type."""
    result: npt.NDArray[T] = np.where(
        value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4
    )
    return result
