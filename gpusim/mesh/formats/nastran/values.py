"""Numbers in Nastran's fields."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.mesh.formats.abaqus.values import LARGEST
from gpusim.mesh.formats.nastran.cards import BdfCard

__all__ = ["integer", "integers", "real", "reals"]

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

_INTEGER = re.compile(r"[+-]?\d{1,15}", re.ASCII)
# 1.5-3 and 1.5D-3 stand for 1.5e-3
_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[ED]?([+-]?\d+))?", re.ASCII | re.IGNORECASE)


def integer(word: str, card: BdfCard) -> int:
    """A whole number. Raises InputError."""
    if not _INTEGER.fullmatch(word):
        card.fail(f"got {word!r}; expected a whole number")
    return int(word)


def real(word: str, card: BdfCard) -> float:
    """A coordinate; an empty field is zero. Raises InputError."""
    if not word:
        return 0.0
    found = _REAL.fullmatch(word)
    value = float(f"{found[1]}e{found[2] or 0}") if found else math.nan
    if not abs(value) <= LARGEST:
        card.fail(f"got {word!r}; expected a coordinate, at most {LARGEST:g}")
    return value


def integers(rows: Sequence[Sequence[str]], cards: Sequence[BdfCard]) -> Long:
    """(N,k) whole numbers of rows of words, one row of each card. Raises InputError."""
    quick = _at_once(rows, np.dtype(np.int64))
    if quick is None:
        each = zip(rows, cards, strict=True)
        return np.array(
            [[integer(word, card) for word in row] for row, card in each], dtype=np.int64
        )
    return quick


def reals(rows: Sequence[Sequence[str]], cards: Sequence[BdfCard]) -> Float:
    """(N,k) coordinates of rows of words, one row of each card. Raises InputError."""
    quick = _at_once(rows, np.dtype(np.float64))
    if quick is None or not (np.abs(quick) <= LARGEST).all():
        each = zip(rows, cards, strict=True)
        return np.array(
            [[real(word, card) for word in row] for row, card in each], dtype=np.float64
        )
    return quick


def _at_once(rows: Sequence[Sequence[str]], kind: np.dtype[Any]) -> npt.NDArray[Any] | None:
    """All words as numbers; None where one needs to be looked at by itself."""
    text = "".join(word for row in rows for word in row)
    if "_" in text or not text.isascii():  # which Python takes for numbers, and nobody else
        return None
    try:
        return np.array(rows, dtype=kind)
    except (ValueError, OverflowError):
        return None
