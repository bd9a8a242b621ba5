"""Pictures of the gallery that runs of the examples leave."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


def vibrating(example: str, amplitude_mm: float, size: tuple[int, int], part: float) -> list[Any]:
    """Pictures (H, W), one after the other, of an example in its lowest mode: a ``part`` of a
    period, that a whole one can be played again and again."""
    document = gs.load_scene(ROOT / "examples" / f"{example}.toml").document
    del document["camera"][0]["shutter"], document["video"]
    document["camera"][0]["resolution_px"] = [*size]
    modal = {"type": "modal", "count": 1, "amplitude_mm": amplitude_mm}
    with tempfile.TemporaryDirectory() as folder:
        shape = gs.Scene.from_document({**document, "analysis": modal, "camera": []})
        rate = max(one["frequency_Hz"] or 0.0 for one in gs.run(shape, folder).modes)
    document["analysis"] = modal | {"duration_s": (part - 0.5 / PHASES) / rate}
    document["video"] = {"frame_rate_Hz": PHASES * rate}
    (camera,) = (one["name"] for one in document["camera"])
    with tempfile.TemporaryDirectory() as folder:
        gs.run(gs.Scene.from_document(document), folder)
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
