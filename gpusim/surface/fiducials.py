"""Coded targets: ArUco and AprilTag markers, ChArUco boards, ring codes. All are exact shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import cv2
import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.surface.color import Albedo, Color
from gpusim.surface.features import (
    DISC,
    PATCH,
    SECTOR,
    Angle,
    Features,
    Length,
    Pattern,
    Place,
    Stack,
    set_centres,
)
from gpusim.validation import Count, checked, require, within


def _dictionary(what: str, name: str) -> Any:
    names = sorted(n[5:] for n in dir(cv2.aruco) if n.startswith("DICT_"))
    require(name in names, f"{what} dictionary", repr(name), f"one of {names}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


def _check_numbers(
    numbers: Sequence[int], count: int, centres: Float, what: str, which: str
) -> None:
    """Refuse other than a whole number below ``count`` for each of ``centres``."""
    fits = len(numbers) == len(centres) and all(i == int(i) and 0 <= i < count for i in numbers)
    got = f"{list(numbers)} for {len(centres)} centres"
    require(fits, what, got, f"as many numbers {which}")


def _white_runs(dictionary: Any, number: int) -> tuple[Float, int]:
    """Runs of white cells (n, 4): column, row from below, length, 1; and the cells a side."""
    cells = int(dictionary.markerSize) + 2
    bits = cv2.aruco.generateImageMarker(dictionary, number, cells)[::-1] > 127
    runs = []
    for row, line in enumerate(bits):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        runs += [(a, row, b - a, 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return np.array(runs, np.float64).reshape(-1, 4), cells


def _marker(
    stack: Stack, dictionary: Any, number: int, corner: Float, size: float, angle: float,
    albedo: tuple[Color, Color], under: Color, layer: int,
) -> None:  # fmt: skip
    """A marker with its lower left corner at ``corner``: a dark square and white runs on it."""
    runs, cells = _white_runs(dictionary, number)
    dark, light = albedo
    stack.add(PATCH, corner[None], size, dark, under, layer, angle=angle)
    cell = size / cells
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, sin], [-sin, cos]])
    place, sides = corner + runs[:, :2] * cell @ turn, runs[:, 2:] * cell
    stack.add(PATCH, place, sides, light, dark, layer + 1, angle=angle)


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Aruco(Pattern):
    """Markers of one of OpenCV's dictionaries ("4X4_50", "APRILTAG_36h11", …).

    ``centres`` (M, 2); ``ids`` one number per centre; ``size`` is the side of the dark square,
    which needs a lighter ground around it. ``angle`` (rad) turns every marker.

    Examples
    --------
    >>> tags = gs.paint.Aruco(np.array([[0.0, 0.0], [0.1, 0.0]]), ids=(3, 7), size=0.05)
    >>> tags.dictionary
    '4X4_50'
    """

    centres: Float
    ids: tuple[int, ...]
    size: Length
    dictionary: str = "4X4_50"
    angle: Angle = 0.0
    dark: Albedo = Albedo(0.05)
    light: Albedo = Albedo(0.9)
    ground: Albedo = Albedo(0.9)

    def __post_init__(self) -> None:
        set_centres(self)
        count = len(_dictionary("Aruco", self.dictionary).bytesList)
        _check_numbers(self.ids, count, self.centres, "Aruco ids", f"from 0 to {count - 1}")

    def features(self, low: Float, high: Float) -> Features | None:
        """A dark square per marker, and its white cells."""
        stack, dictionary = Stack(self.ground), _dictionary("Aruco", self.dictionary)
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        half = 0.5 * self.size * np.array([cos - sin, sin + cos])
        for centre, number in zip(self.centres, self.ids, strict=True):
            _marker(
                stack, dictionary, int(number), centre - half, self.size, self.angle,
                (self.dark, self.light), self.ground, 0,
            )  # fmt: skip
        return stack.features()


@checked
@dataclass(frozen=True, repr=False)
class Charuco(Pattern):
    """OpenCV's ChArUco board: a chessboard whose light squares hold markers.

    The square at the upper left is dark, as in OpenCV from 4.6 on; markers are numbered row by row
    from there. ``origin`` (s, t) is the board's lower left corner.

    Examples
    --------
    >>> gs.paint.Charuco(columns=5, rows=4, square=0.02, marker=0.015).corners().shape
    (12, 2)
    """

    columns: Count
    rows: Count
    square: Length
    marker: Length
    dictionary: str = "4X4_50"
    origin: Place = (0.0, 0.0)
    dark: Albedo = Albedo(0.05)
    light: Albedo = Albedo(0.9)
    ground: Albedo = Albedo(0.9)

    def __post_init__(self) -> None:
        require(self.marker < self.square, "Charuco marker", self.marker, "less than the square")
        count = len(_dictionary("Charuco", self.dictionary).bytesList)
        needed, got = self.columns * self.rows // 2, f"{self.dictionary!r} with {count} markers"
        require(needed <= count, "Charuco dictionary", got, f"at least {needed}")

    def board(self) -> Any:
        """The `cv2.aruco.CharucoBoard` that detects it, in the unit of ``square``."""
        dictionary = _dictionary("Charuco", self.dictionary)
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square, self.marker, dictionary
        )

    def corners(self) -> Float:
        """Paint coordinates (M, 2) of the inner corners, in the order of OpenCV's numbers."""
        i, j = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        place = np.stack([i.ravel(), self.rows - j.ravel()], axis=1)
        result: Float = np.array(self.origin) + self.square * place
        return result

    def features(self, low: Float, high: Float) -> Features | None:
        """Squares, and a marker in every light one."""
        stack, dictionary = Stack(self.ground), _dictionary("Charuco", self.dictionary)
        origin = np.array(self.origin)
        i, j = (a.ravel() for a in np.meshgrid(np.arange(self.columns), np.arange(self.rows)))
        corner = origin + self.square * np.stack([i, self.rows - 1 - j], axis=1)
        even = (i + j) % 2 == 0
        stack.add(PATCH, corner[even], self.square, self.dark, self.ground, 0)
        stack.add(PATCH, corner[~even], self.square, self.light, self.ground, 0)
        inset = 0.5 * (self.square - self.marker)
        for number, place in enumerate(corner[~even]):
            _marker(
                stack, dictionary, number, place + inset, self.marker, 0.0,
                (self.dark, self.light), self.light, 1,
            )  # fmt: skip
        return stack.features()


def ring_codes(bits: int) -> tuple[int, ...]:
    """Codes of ``bits`` bits that no turn makes another one: the least number of each ring.

    Rings of equal bits only, which couldn't be told from a plain ring, are left out.
    """
    codes = []
    for code in range(1, (1 << bits) - 1):
        turned = (((code << k) | (code >> (bits - k))) & ((1 << bits) - 1) for k in range(1, bits))
        if all(code <= other for other in turned):
            codes.append(code)
    return tuple(codes)


@checked
@dataclass(frozen=True, eq=False, repr=False)
class RingCodes(Pattern):
    """Circular coded targets as photogrammetry uses them: a disc and a ring of light and dark bits.

    ``diameter`` is that of the central disc; the ring reaches from twice to three times as far. Bit
    k of a code fills the k-th sector from ``angle`` on, counter-clockwise (Schneider and Sinnreich,
    "Optical 3-D measurement systems for quality control in industry", 1992).

    Examples
    --------
    >>> gs.paint.RingCodes(np.zeros((1, 2)), codes=(0b1011,), diameter=0.01).bits
    12
    """

    centres: Float
    codes: tuple[int, ...]
    diameter: Length
    bits: Annotated[int, within(3, 20)] = 12
    angle: Angle = 0.0
    dot: Albedo = Albedo(0.9)
    ground: Albedo = Albedo(0.05)

    def __post_init__(self) -> None:
        set_centres(self)
        of_bits = f"of {self.bits} bits"
        _check_numbers(self.codes, 1 << self.bits, self.centres, "RingCodes codes", of_bits)

    def features(self, low: Float, high: Float) -> Features | None:
        """The discs, and per run of set bits a sector less the same of the ring's inner radius.

        Below all of it is a disc that changes nothing, so that targets that overlap are refused.
        """
        stack = Stack(self.ground)
        stack.add(DISC, self.centres, 1.5 * self.diameter, self.ground, self.ground, 0)
        stack.add(DISC, self.centres, 0.5 * self.diameter, self.dot, self.ground, 1)
        bit = 2.0 * np.pi / self.bits
        for centre, code in zip(self.centres, self.codes, strict=True):
            # of at most half a turn each
            longest = self.bits // 2
            for start, count in _runs(int(code), self.bits, longest):
                begin, width = self.angle + start * bit, count * bit
                for layer, reach in enumerate((1.5, 1.0)):
                    albedo, under = (self.dot, self.ground)[:: 1 - 2 * layer]
                    stack.add(
                        SECTOR, centre[None], reach * self.diameter, albedo, under, 1 + layer,
                        angle=begin, width=width,
                    )  # fmt: skip
        return stack.features()


def _runs(code: int, bits: int, longest: int) -> list[tuple[int, int]]:
    """First bit and number of bits of the runs of ones, each of at most ``longest`` bits."""
    runs: list[tuple[int, int]] = []
    for k in range(bits):
        if not code >> k & 1:
            continue
        if runs and sum(runs[-1]) == k and runs[-1][1] < longest:
            runs[-1] = (runs[-1][0], runs[-1][1] + 1)
        else:
            runs.append((k, 1))
    return runs
