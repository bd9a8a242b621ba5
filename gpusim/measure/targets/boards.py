"""What a calibration looks at: flat boards with points of known places, found in images.

Board coordinates: x to the right, y down, z into the board, as somebody sees who looks at it; the
first inner corner (or dot) is the origin. They make a right-handed frame like a camera's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.targets.crossings import Crossings
from gpusim.validation import require, require_one_of


@dataclass(frozen=True)
class _Fields:
    """A board of ``columns`` x ``rows`` fields of side ``square``."""

    columns: int
    rows: int
    square: float

    @property
    def corners(self) -> tuple[int, int]:
        """Inner corners across and down."""
        return self.columns - 1, self.rows - 1


@dataclass(frozen=True)
class Chessboard(_Fields):
    """A board of ``columns`` x ``rows`` square fields of side ``square`` (any unit).

    Counted are fields, not inner corners: 9 x 8 fields have 8 x 7 inner corners. The field at the
    upper left is dark; if columns + rows is even, a board looks the same upside down, and cameras
    can't agree on its origin (`unique`).

    Examples
    --------
    >>> board = gs.measure.Chessboard(columns=7, rows=6, square=0.015)
    >>> board.corners, board.unique, board.points().shape
    ((6, 5), True, (30, 3))
    """

    def __post_init__(self) -> None:
        for name, count in (("columns", self.columns), ("rows", self.rows)):
            if not (count == int(count) and 4 <= count <= 1000):
                raise InputError(f"Chessboard {name}; got {count}; expected 4 to 1000 fields")
        if not (np.isfinite(self.square) and self.square > 0):
            raise InputError(f"Chessboard square; got {self.square}; expected a length above 0")

    @property
    def unique(self) -> bool:
        """Whether its upper side can be told from its lower one."""
        return (self.columns + self.rows) % 2 == 1

    @property
    def turns(self) -> Turns | None:
        """How it may be turned and look the same; None if it can be told which way up it is."""
        if self.unique:
            return None
        across, down = self.corners
        middle = 0.5 * self.square * (across - 1), 0.5 * self.square * (down - 1)
        return Turns(middle, self.columns == self.rows)

    def points(self) -> Float:
        """(N, 3) float64, inner corners row by row."""
        across, down = self.corners
        x, y = np.meshgrid(np.arange(across), np.arange(down), indexing="xy")
        flat = [x.ravel(), y.ravel(), np.zeros(x.size)]
        return np.stack(flat, axis=1, dtype=np.float64) * self.square


@dataclass(frozen=True)
class CharucoBoard(_Fields):
    """``columns`` x ``rows`` squares of side ``square``, markers of side ``marker`` (same unit).

    ``dictionary`` as OpenCV names it, without DICT_. The square at the upper left is dark.

    Examples
    --------
    >>> gs.measure.CharucoBoard(columns=4, rows=3, square=0.04, marker=0.026).corners
    (3, 2)
    """

    marker: float
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        if not (self.columns >= 3 and self.rows >= 3):
            raise InputError(f"CharucoBoard; got {self.columns} x {self.rows}; expected 3 x 3 up")
        got = f"marker {self.marker}, square {self.square}"
        require(0 < self.marker < self.square < np.inf, "CharucoBoard", got, "0 < marker < square")
        markers = len(check_dictionary(self.dictionary, "CharucoBoard dictionary").bytesList)
        needed = self.columns * self.rows // 2
        got = f"{self.dictionary} of {markers} markers"
        expected = f"at least {needed} for {self.columns} x {self.rows} squares"
        require(needed <= markers, "CharucoBoard dictionary", got, expected)

    def detector(self) -> Any:
        """OpenCV's detector of this board."""
        dictionary = check_dictionary(self.dictionary, "CharucoBoard dictionary")
        size = self.columns, self.rows
        return cv2.aruco.CharucoDetector(
            cv2.aruco.CharucoBoard(size, self.square, self.marker, dictionary)
        )


Board = Chessboard | CharucoBoard


def check_dictionary(name: str, what: str) -> Any:
    """OpenCV's dictionary of that name, without DICT_. Raises InputError for others."""
    names = sorted(n[5:] for n in dir(cv2.aruco) if n.startswith("DICT_"))
    require_one_of(what, name, names)
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


@dataclass(frozen=True)
class Turns:
    """A board that looks the same when it is turned about its ``middle``: by half, or, a
    ``square`` one, by a quarter."""

    middle: tuple[float, float]
    square: bool


@dataclass(frozen=True, eq=False)
class Sighting:
    """The points of a target that were found in one image.

    Attributes
    ----------
    board : (N, 3) float64, their places on the target.
    image : (N, 2) float64, px.
    sigma : (N,) float64, standard uncertainty of a coordinate from the fits, px.
    contrast, blur : (N,) float64, grey levels and px.
    resolution : (width, height) of the image, px.
    missed : points of the target that were not found.
    problem : why nothing was found, or "".
    turns : how the target may be turned and look the same, so that its places are one of several
        readings; None if it can be told.

    Examples
    --------
    >>> board = gs.measure.Chessboard(columns=7, rows=6, square=0.015)
    >>> seen = gs.measure.find_chessboard(gs.export.read_image("board-0.png"), board)
    >>> len(seen), seen.missed, seen.problem
    (30, 0, '')
    """

    board: Float
    image: Float
    sigma: Float
    contrast: Float
    blur: Float
    resolution: tuple[int, int]
    missed: int
    problem: str = ""
    turns: Turns | None = None
    __repr__ = field_summary

    def __len__(self) -> int:
        return len(self.image)

    @staticmethod
    def none(resolution: tuple[int, int], missed: int, problem: str) -> Sighting:
        """Nothing was found."""
        empty = np.zeros(0)
        return Sighting(
            np.zeros((0, 3)), np.zeros((0, 2)), empty, empty, empty, resolution, missed, problem
        )

    @staticmethod
    def fitted(
        places: Float, fit: Crossings, ok: Bool, resolution: tuple[int, int],
        total: int, turns: Turns | None = None,
    ) -> Sighting:  # fmt: skip
        """Those of the corners at ``places`` (N, 3) that are ``ok``, of so many in ``total``."""
        return Sighting(
            places[ok], fit.points[ok], fit.sigma[ok], fit.contrast[ok], fit.blur[ok], resolution,
            total - int(np.count_nonzero(ok)), turns=turns,
        )  # fmt: skip


@dataclass(frozen=True)
class TargetStatistics:
    """How well a target was seen in a set of images.

    ``images``, ``found`` (with at least four points) and ``share`` of the points found in those;
    ``sigma`` and ``blur`` are medians in px; ``covered`` is the share of a 10 x 10 grid over the
    image that has a point; ``problems`` counts the reasons of the images without.

    Examples
    --------
    >>> board = gs.measure.Chessboard(columns=7, rows=6, square=0.015)
    >>> seen = gs.measure.find_chessboard(gs.export.read_image("board-0.png"), board)
    >>> gs.measure.target_statistics([seen]).share
    1.0
    """

    images: int
    found: int
    share: float
    sigma: float
    blur: float
    covered: float
    problems: dict[str, int]
    __repr__ = field_summary


def target_statistics(sightings: Sequence[Sighting]) -> TargetStatistics:
    """Statistics over the images of one camera. Raises InputError for an empty list.

    Examples
    --------
    >>> board = gs.measure.Chessboard(columns=7, rows=6, square=0.015)
    >>> seen = gs.measure.find_chessboard(gs.export.read_image("board-0.png"), board)
    >>> gs.measure.target_statistics([seen]).found
    1
    """
    require(bool(sightings), "target_statistics", "no sightings", "at least one image")
    good = [s for s in sightings if len(s) >= 4]
    problems: dict[str, int] = {}
    for s in sightings:
        if len(s) < 4:
            problems[s.problem or "too few points"] = problems.get(s.problem, 0) + 1
    if not good:
        nan = float("nan")
        return TargetStatistics(len(sightings), 0, nan, nan, nan, 0.0, problems)
    size = np.array(good[0].resolution, dtype=np.float64)
    points = np.concatenate([s.image for s in good])
    cell = np.clip(np.floor(10 * (points + 0.5) / size), 0, 9).astype(int)
    total = sum(len(s) + s.missed for s in good)
    return TargetStatistics(
        images=len(sightings),
        found=len(good),
        share=len(points) / total,
        sigma=float(np.median(np.concatenate([s.sigma for s in good]))),
        blur=float(np.median(np.concatenate([s.blur for s in good]))),
        covered=len(np.unique(cell[:, 0] * 10 + cell[:, 1])) / 100.0,
        problems=problems,
    )
