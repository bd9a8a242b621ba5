"""The files that examples in docstrings read: a scene, a deck, and small pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import gpusim as gs
from tests.support.deck_texts import deck, step
from tests.support.small_scene import small_scene

CORNERS = 0.15 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
K = np.array([[800.0, 0, 79.5], [0, 800, 59.5], [0, 0, 1]])
FACING = np.diag([1.0, -1.0, -1.0, 1.0])  # looks along -z, y of the image down


def picture(paint: gs.paint.Paint, *, eye: npt.ArrayLike, shift: float = 0.0) -> npt.NDArray[Any]:
    """160 x 120 px, 8 bits, of a plate in z = 0 that is moved by ``shift`` along x.

    From a distance of 1, a pixel is 1/800 wide on the plate.
    """
    pose = FACING.copy()
    pose[:3, 3] = -FACING[:3, :3] @ np.asarray(eye, np.float64)
    return exposed(paint, gs.Camera(160, 120, K, camera_from_world=pose), shift)


def exposed(paint: gs.paint.Paint, camera: gs.Camera, shift: float = 0.0) -> npt.NDArray[Any]:
    plate = gs.Surface(CORNERS + np.array([shift, 0, 0]), [[0, 1, 2, 3]], paint, reference=CORNERS)
    return gs.Sensor(bits=8).expose(gs.render([plate], camera, backend="numpy"))


def write_example_files(folder: Path) -> None:
    (folder / "bar.toml").write_text(small_scene().to_toml(), encoding="utf-8")
    (folder / "bricks.inp").write_text(deck(step("*CLOAD", "RIGHT, 1, 1.")), encoding="utf-8")
    speckle = gs.paint.Speckle(diameter=0.006, coverage=0.5, softness=0.0012, seed=1)
    checkers = gs.paint.Markers(np.array([[0.1, 0.15], [0.2, 0.15]]), size=0.025)
    dots = gs.paint.Dots(diameter=0.0125, pitch=0.04, columns=3, rows=2, origin=(0.11, 0.13))
    charuco = gs.paint.Charuco(4, 3, square=0.04, marker=0.026, origin=(0.07, 0.09))
    board = gs.paint.Checker(0.015, columns=7, rows=6, origin=(0.0975, 0.105))
    pictures = {
        "before": picture(speckle, eye=(0, 0, 1)),
        "after": picture(speckle, eye=(0, 0, 1), shift=0.25 / 800),
        "left": picture(speckle, eye=(0, 0, 1)),
        "right": picture(speckle, eye=(0.02, 0, 1)),
        "left-1": picture(speckle, eye=(0, 0, 1), shift=0.001),
        "right-1": picture(speckle, eye=(0.02, 0, 1), shift=0.001),
        "markers": picture(checkers, eye=(0, 0, 1)),
        "markers-1": picture(checkers, eye=(0, 0, 1), shift=1.5 / 800),
        "dots": picture(dots, eye=(0, 0, 1)),
        "charuco": picture(charuco, eye=(0, 0, 1)),
    }
    for number, eye in enumerate([(0, 0, 1.0), (0.4, 0, 0.8), (-0.3, 0.3, 0.9), (0, -0.5, 0.7)]):
        camera = gs.Camera.from_lens((16, 12), 80, (160, 120), eye, (0, 0, 0), up=(0, 1, 0))
        pictures[f"board-{number}"] = exposed(board, camera)
    for name, image in pictures.items():
        gs.export.write_image(folder / f"{name}.png", image)
    film = (np.full((57, 33), number, np.uint16) for number in range(5))
    gs.write_video(folder / "film.mkv", film, frame_rate=2000.0)
