"""Pictures of the gallery that runs of the examples leave."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

import gpusim as gs
from gpusim.report.html import fitting

ROOT = Path(__file__).resolve().parent.parent
MAPS_SIZE = 1000, 760  # at most
PHASES = 16
Picture = npt.NDArray[np.uint8]
"""Red, green, blue, by the curve of sRGB."""


def maps(
    example: str, figure: str, work: Callable[..., gs.Report] = gs.run, part: float = 1.0
) -> Picture:
    """A figure of the report of an example, by `gpusim.run` or other ``work``; the upper ``part``
    of it."""
    with tempfile.TemporaryDirectory() as folder:
        work(gs.load_scene(ROOT / "examples" / f"{example}.toml"), folder)
        return small(Path(folder, "figures", figure), part)


def one_period(scene: gs.Scene, body: str, amplitude_mm: float) -> list[Picture]:
    """Small pictures of a body in its lowest mode by the scene's camera, each exposed from one to
    the next, so that they can be played again and again."""
    (camera,) = (one.name for one in scene.cameras)
    modal = {"type": "modal", "count": 1, "amplitude_mm": amplitude_mm}
    with tempfile.TemporaryDirectory() as folder:
        report = gs.run(scene.replace("analysis", modal).replace("camera", []), folder)
    (rate,) = (one["frequency_Hz"] for one in report.modes if one["body"] == body)
    document = scene.document
    document["analysis"] = modal | {"duration_s": (PHASES - 0.5) / PHASES / rate}
    document["video"] = {"frame_rate_Hz": PHASES * rate, "exposure_us": 0.99e6 / PHASES / rate}
    document["camera"][0]["resolution_px"] = [360, 240]
    with tempfile.TemporaryDirectory() as folder:
        gs.run(gs.Scene.from_document(document, files=scene.files), folder)
        return list(gs.read_video(Path(folder, "video", f"{camera}.mkv")))


def exposures(example: str, camera: str, width: int) -> Picture:
    """All frames of an example in one picture: the darkest that each pixel sees."""
    scene = gs.load_scene(ROOT / "examples" / f"{example}.toml", {"measure": []})
    with tempfile.TemporaryDirectory() as folder:
        gs.run(scene, folder)
        paths = sorted(Path(folder, "images", camera).glob("*.png"))
        image = np.minimum.reduce([cv2.imread(str(path)) for path in paths])
    size = width, round(width * len(image) / image.shape[1])
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)[..., ::-1], np.uint8)


def small(path: Path, part: float) -> Picture:
    """A figure, or the upper part of it, as large as a page shows it sharply."""
    image = cv2.imread(str(path))
    image = image[: round(part * len(image))]
    size = fitting(image.shape, *MAPS_SIZE)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)[..., ::-1], np.uint8)
