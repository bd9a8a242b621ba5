"""Damage to files: what disks, networks, editors and fuzzers do to them.

::

    for damage, data in mutations(valid, numpy.random.default_rng(seed), 100):
        ...  # `damage` says in words what was done
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import numpy as np

from tests.hostile.amount import SEED, share

__all__ = ["SEED", "mutations", "share"]

Damage = tuple[str, bytes]
# in a text: no number, none that is finite, none that fits
_NUMBERS = (b"", b"-1", b"0", b"nan", b"inf", b"1e999", b"-7.5", b"99999999999", b"4294967296",
            b"9223372036854775807", b"1" * 400, b"0x10", b"1_0", b"1,5", b"one",
            b"\xff\xfe")  # fmt: skip
_BYTES = (b"\x00", b"\xff", b"\n", b"\r\n", b" ", b"\x1b[31m", b"\xe2\x80\xae", b'"', b"<", b"$")
_FLOATS = (np.nan, np.inf, -np.inf, 1e300, -1.0, 0.0)
_INTEGERS = (-1, 0, 2**31 - 1, -(2**31), 2**24, 1)


def mutations(data: bytes, rng: np.random.Generator, count: int) -> Iterator[Damage]:
    """``count`` damaged versions of a file, each with the words for what was done to it."""
    kinds: tuple[Callable[[bytes, np.random.Generator], Damage], ...] = (
        _flipped, _cut, _number, _number, _overwritten, _line, _moved, _inserted, _word,
    )  # fmt: skip
    for number in range(count):
        damage, result = kinds[number % len(kinds)](data, rng)
        if rng.random() < 0.2:  # seldom one fault alone
            more, result = kinds[int(rng.integers(len(kinds)))](result, rng)
            damage += f"; {more}"
        yield damage, result


def _place(data: bytes, rng: np.random.Generator) -> int:
    # half of them near the beginning, where the headers are
    end = max(1, len(data) if rng.random() < 0.5 else min(len(data), 400))
    return int(rng.integers(end))


def _flipped(data: bytes, rng: np.random.Generator) -> Damage:
    changed = bytearray(data)
    places = [_place(data, rng) for _ in range(int(rng.integers(1, 9)))]
    for place in places if data else ():
        changed[place] ^= 1 << int(rng.integers(8))
    return f"bits flipped at {places}", bytes(changed)


def _cut(data: bytes, rng: np.random.Generator) -> Damage:
    end = int(rng.integers(len(data) + 1))
    return f"cut off after {end} bytes", data[:end]


def _number(data: bytes, rng: np.random.Generator) -> Damage:
    """A number of a text: the first few, which are often counts, as often as all others."""
    found = list(re.finditer(rb"-?\d+(\.\d*)?([eE][-+]?\d+)?", data[:1_000_000]))
    if not found:
        return _word(data, rng)
    few = found if rng.random() < 0.5 else found[:20]
    one = few[int(rng.integers(len(few)))]
    new = _NUMBERS[int(rng.integers(len(_NUMBERS)))]
    return f"{one[0]!r} at {one.start()} is {new[:20]!r}", data[: one.start()] + new + data[
        one.end() :
    ]


def _word(data: bytes, rng: np.random.Generator) -> Damage:
    """A binary number: 4 or 8 bytes of either order."""
    kind = str(rng.choice(["<i4", ">i4", "<i8", ">i8", "<f4", "<f8", ">f8"]))
    values = _FLOATS if "f" in kind else _INTEGERS
    with np.errstate(over="ignore"):
        word = np.array(values[int(rng.integers(len(values)))]).astype(kind).tobytes()
    place = _place(data, rng) & ~3
    return f"{kind} {word.hex()} at {place}", data[:place] + word + data[place + len(word) :]


def _overwritten(data: bytes, rng: np.random.Generator) -> Damage:
    place, size = _place(data, rng), int(rng.integers(1, 200))
    noise = rng.bytes(size) if rng.random() < 0.5 else bytes(size)
    return f"{size} bytes overwritten at {place}", data[:place] + noise + data[place + size :]


def _line(data: bytes, rng: np.random.Generator) -> Damage:
    """A line is missing, or there twice."""
    lines = data.splitlines(keepends=True) or [b""]
    place, times = int(rng.integers(len(lines))), int(rng.choice([0, 2, 3]))
    lines[place : place + 1] = [lines[place]] * times
    return f"line {place + 1} is there {times} times", b"".join(lines)


def _moved(data: bytes, rng: np.random.Generator) -> Damage:
    """A piece stands elsewhere."""
    start, size = _place(data, rng), int(rng.integers(1, 300))
    piece, rest = data[start : start + size], data[:start] + data[start + size :]
    to = int(rng.integers(len(rest) + 1))
    return f"{len(piece)} bytes moved from {start} to {to}", rest[:to] + piece + rest[to:]


def _inserted(data: bytes, rng: np.random.Generator) -> Damage:
    place, new = _place(data, rng), _BYTES[int(rng.integers(len(_BYTES)))]
    return f"{new!r} put in at {place}", data[:place] + new + data[place:]
