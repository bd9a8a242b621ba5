"""What measurements are given: pictures, and the board's corners found in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.gpu import Device
from gpusim.measure.targets.board_detection import find_board
from gpusim.measure.targets.boards import Board, Sighting
from gpusim.pipeline.measurements.results import MM
from gpusim.pipeline.pictures.image_window import Window
from gpusim.scene import Scene
from gpusim.scene.description import model as m


def board_of(scene: Scene) -> Board | None:
    """The board (mm) that the scene's calibration shows; None if it shows another thing."""
    calibration = scene.calibration
    if calibration is None:
        return None
    prop = next(p for p in scene.props if p.name == calibration.board)
    paint = prop.paints[0] if prop.paints else None
    if isinstance(paint, m.CheckerTable):
        return measure.Chessboard(paint.columns, paint.rows, MM * paint.cell)
    if isinstance(paint, m.CharucoTable):
        return measure.CharucoBoard(
            paint.columns, paint.rows, MM * paint.square, MM * paint.marker, paint.dictionary
        )
    return None


def find_corners(scene: Scene, image: npt.NDArray[Any], window: Window | None) -> dict[str, Any]:
    """The board in a picture of the calibration, as arrays to be kept; it is within ``window``."""
    board = board_of(scene)
    assert board is not None
    seen = find_board(image, board, window.box if window else None)
    # how the board may be turned is known from the scene
    return {f.name: getattr(seen, f.name) for f in fields(seen) if f.name != "turns"}


def read_corners(scene: Scene, file: InputFile) -> measure.Sighting:
    """What was found of the board in a pose. Raises InputError for a damaged file."""
    try:
        with np.load(file.stream(), allow_pickle=False) as stored:
            values = dict(stored)
        width, height = (int(v) for v in values.pop("resolution"))
        missed, problem = int(values.pop("missed")), str(values.pop("problem"))
        board = board_of(scene)
        turns = board.turns if isinstance(board, measure.Chessboard) else None
        return measure.Sighting(
            **values, resolution=(width, height), missed=missed, problem=problem, turns=turns
        )
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile) as error:
        expected = "corners of the calibration board"
        raise InputError(f"{file.path}: damaged ({error}); expected {expected}") from None


def calibrated(
    spec: m.StereoTable | m.CorrelationTable,
    scene: Scene,
    corners: Callable[[str, int], measure.Sighting],
) -> tuple[Board, measure.Calibration]:
    """The board, and the cameras of ``spec`` as its pictures give them. Raises InputError without
    such pictures, GpusimError for a camera that can't be calibrated."""
    what, calibration, board = f"measure {spec.name!r}", scene.calibration, board_of(scene)
    if calibration is None or not set(spec.views) <= set(calibration.cameras):
        missing = f"no images of a target for {', '.join(spec.views)}"
        raise InputError(f"{what}: {missing}; expected [calibration]")
    if board is None:
        where = f"{what}: calibration board {calibration.board!r}"
        raise InputError(f"{where}; got another paint; expected a checker or charuco")
    poses = range(len(calibration.poses))
    sightings = {name: [corners(name, pose) for pose in poses] for name in spec.views}
    return board, measure.calibrate(sightings, lens=spec.lens)


@dataclass(frozen=True)
class Sources:
    """``image`` gives a camera's picture in a frame, ``corners`` what was found of the board in a
    calibration pose. ``device``: what correlates; None for the NumPy twins."""

    image: Callable[[str, int], npt.NDArray[Any]]
    corners: Callable[[str, int], Sighting]
    device: Device | None = None
