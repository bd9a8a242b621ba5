"""Corners of the calibration board, found as soon as an image is taken and kept beside it."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from gpusim import measure
from gpusim.errors import InputError
from gpusim.export.files import atomic_stream
from gpusim.pipeline.images import Photographer, image_path
from gpusim.scene import Scene
from gpusim.scene import model as m

__all__ = ["Board", "board_of", "read_corners", "take_target"]

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


def take_target(photographer: Photographer, camera: m.Camera, pose: int) -> list[Path]:
    """Photograph the calibration target; find its corners if something is measured by them."""
    files, scene = photographer.take(camera, pose), photographer.scene
    board = board_of(scene)
    if scene.measures_space and board is not None and photographer.image is not None:
        image = photographer.image
        if isinstance(board, measure.CharucoBoard):
            seen = measure.find_charuco(image, board)
        else:
            window = photographer.window
            seen = measure.find_chessboard(image, board, window.box if window else None)
        files.append(_corners_path(files[0]))
        with atomic_stream(files[-1]) as stream:
            np.savez(
                stream, allow_pickle=False, **{f.name: getattr(seen, f.name) for f in fields(seen)}
            )
    return files


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
