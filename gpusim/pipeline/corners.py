"""Corners of the calibration board, found as soon as an image is taken and kept beside it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.errors import InputError
from gpusim.export.files import atomic_stream
from gpusim.pipeline.images import Photographer, image_path
from gpusim.pipeline.window import Window
from gpusim.scene import Scene
from gpusim.scene import model as m

__all__ = ["Board", "Targets", "board_of", "read_corners"]

MM = 1e3
Board = measure.Chessboard | measure.CharucoBoard


def board_of(scene: Scene) -> Board | None:
    """The board (mm) that the scene's calibration shows; None if it shows another thing."""
    calibration = scene.calibration
    if calibration is None:
        return None
    prop = next(p for p in scene.props if p.name == calibration.board)
    paint = prop.paints[0] if prop.paints else None
    if isinstance(paint, m.Checker):
        return measure.Chessboard(paint.columns, paint.rows, MM * paint.cell)
    if isinstance(paint, m.Target) and paint.kind == "charuco":
        values: dict[str, Any] = dict(paint.values)
        return measure.CharucoBoard(
            values["columns"],
            values["rows"],
            MM * values["square"],
            MM * values["marker"],
            values["dictionary"],
        )
    return None


class Targets:
    """Photographs of the calibration target, and the board's corners in them.

    While the corners of one picture are looked for, the next one is taken. ``wanted``: cameras and
    poses in the order in which `take` will be called.
    """

    def __init__(self, photographer: Photographer, wanted: Iterable[tuple[m.Camera, int]]) -> None:
        self.photographer, self._wanted = photographer, deque(wanted)
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="gpusim.corners")
        self._coming: Future[list[Path]] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()

    def take(self) -> list[Path]:
        """Take the next picture and find its corners; returns its files."""
        now = self._coming or self._begin()
        self._coming = self._begin() if self._wanted else None
        return now.result()

    def _begin(self) -> Future[list[Path]]:
        """Photograph; the corners, if something is measured by them, come later."""
        camera, pose = self._wanted.popleft()
        begun: Future[list[Path]] = Future()
        try:
            files, scene = self.photographer.take(camera, pose), self.photographer.scene
        except Exception as error:  # it belongs to the picture that it happened to
            begun.set_exception(error)
            return begun
        board, image = board_of(scene), self.photographer.image
        if not scene.measures_space or board is None or image is None:
            begun.set_result(files)
            return begun
        return self._pool.submit(_with_corners, files, board, image, self.photographer.window)


def _with_corners(
    files: list[Path], board: Board, image: npt.NDArray[Any], window: Window | None
) -> list[Path]:
    """The files of a picture and that of its corners, which is written here."""
    if isinstance(board, measure.CharucoBoard):
        seen = measure.find_charuco(image, board)
    else:
        seen = measure.find_chessboard(image, board, window.box if window else None)
    path = _corners_path(files[0])
    with atomic_stream(path) as stream:
        np.savez(
            stream, allow_pickle=False, **{f.name: getattr(seen, f.name) for f in fields(seen)}
        )
    return [*files, path]


def read_corners(scene: Scene, out: Path, camera: str, pose: int) -> measure.Sighting:
    """What was found of the board in a pose. Raises InputError if nothing was kept."""
    path = _corners_path(image_path(scene, out, camera, pose, "calib-"))
    if not path.is_file():
        raise InputError(f"corners of the calibration board: {path}: not found")
    with np.load(path, allow_pickle=False) as stored:
        values = dict(stored)
    width, height = (int(v) for v in values.pop("resolution"))
    missed, problem = int(values.pop("missed")), str(values.pop("problem"))
    return measure.Sighting(**values, resolution=(width, height), missed=missed, problem=problem)


def _corners_path(image: Path) -> Path:
    return image.with_name(f"{image.stem}-corners.npz")
