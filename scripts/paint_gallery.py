"""Draws docs/paint.png: one rendered picture of every paint.

python scripts/paint_gallery.py
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))  # its sources, not those of a wheel that is installed

import gpusim as gs  # noqa: E402

Array = npt.NDArray[np.float64]
SIDE = 200
OUT = ROOT / "docs" / "paint.png"


def plate(paint: gs.paint.Paint, backend: str) -> npt.NDArray[np.uint8]:
    """A plate of 1 x 1, seen a little from the side."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
    view = gs.Camera.from_lens((24.0, 24.0), 36.0, (SIDE, SIDE), (0.85, -1.6, 0.75), (0.5, 0, 0.49))
    return picture(gs.Surface(points, np.array([[0, 1, 2, 3]]), paint=paint), view, backend)


def tube(backend: str) -> npt.NDArray[np.uint8]:
    """Dots round a cylinder."""
    n = 96
    angle = np.arange(n) * 2.0 * np.pi / n
    ring = np.stack([0.4 * np.cos(angle), 0.4 * np.sin(angle)], axis=1)
    points = np.concatenate([np.c_[ring, np.zeros(n)], np.c_[ring, np.ones(n)]])
    i = np.arange(n)
    faces = np.stack([i, (i + 1) % n, n + (i + 1) % n, n + i], axis=1)
    frame = gs.CylinderFrame.fit(points, faces, np.zeros(3), [0, 0, 1], "tube")
    paint = gs.paint.Dots(0.05, 0.08)
    view = gs.Camera.from_lens((24.0, 24.0), 36.0, (SIDE, SIDE), (0.3, -2.0, 0.9), (0, 0, 0.5))
    return picture(gs.Surface(points, faces, paint=paint, frames={"surface": frame}), view, backend)


def relief(bump: gs.paint.Bump, roughness: float, metallic: float, backend: str) -> Any:
    """A glossy plate with a fine relief under a lamp."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
    view = gs.Camera.from_lens((24.0, 24.0), 36.0, (SIDE, SIDE), (0.85, -1.6, 0.75), (0.5, 0, 0.49))
    paint = gs.paint.Plain(0.6, roughness, metallic, bump)
    lights = [
        gs.AreaLight((0.0, -1.6, 1.0), (0.5, 0.0, 0.5), (0.5, 0.5), 18.0),
        gs.EnvironmentLight(0.6, 0.3, up=(0.0, 0.0, 1.0)),
    ]
    surface = gs.Surface(points, np.array([[0, 1, 2, 3]]), paint=paint)
    radiance = gs.render([surface], view, lights, background=0.25, backend=backend).radiance
    grey = np.clip(radiance / np.percentile(radiance, 99.5), 0.0, 1.0) ** (1.0 / 2.2)
    return np.round(255.0 * grey).astype(np.uint8)


def picture(surface: gs.Surface, view: gs.Camera, backend: str) -> npt.NDArray[np.uint8]:
    radiance = gs.render([surface], view, background=0.25, backend=backend).radiance
    return np.round(255.0 * np.clip(radiance, 0.0, 1.0)).astype(np.uint8)


def main(backend: str = "gpu") -> None:
    """Render, label, and write the sheet."""
    paint = gs.paint
    two = np.array([[0.28, 0.3], [0.7, 0.68]])
    y, x = np.mgrid[:64, :64]
    photo = 0.5 + 0.3 * np.sin(0.35 * x + 0.004 * x * y) + 0.2 * np.cos(0.23 * y)
    sheets: dict[str, npt.NDArray[np.uint8]] = {}
    for name, example in {
        "Plain": paint.Plain(0.7),
        "Checker": paint.Checker(0.1, 8, 8, (0.1, 0.1), ground=0.6),
        "Dots": paint.Dots(0.06, 0.1, 8, 8, (0.15, 0.15)),
        "Markers": paint.Markers(two, 0.3, ground=0.6),
        "Speckle": paint.Speckle(0.03, 0.5, 0.004, seed=2),
        "Image": paint.Image(np.clip(photo, 0, 1), 0.0125, (0.1, 0.1), ground=0.8),
        "Circles": paint.Circles(two, (0.36, 0.26, 0.16, 0.06)),
        "Lines": paint.Lines(0.1, 0.015, "both", 8, 8, (0.1, 0.1)),
        "Star": paint.Star(np.array([[0.5, 0.5]]), 0.85, 36, ground=0.6),
        "Aruco": paint.Aruco(two, (7, 23), 0.36),
        "Charuco": paint.Charuco(6, 6, 0.14, 0.1, "4X4_50", (0.08, 0.08)),
        "RingCodes": paint.RingCodes(two, (0b000110111011, 0b000000100111), 0.13),
    }.items():
        sheets[name] = plate(example, backend)
    sheets["CylinderFrame"] = tube(backend)
    orange = paint.Bump(0.0012, 0.04)
    sheets["Bump"] = relief(orange, 0.3, 0.0, backend)
    brushed = paint.Bump(0.0005, 0.008, (1.0, 0.0, 0.0), 40.0)
    sheets["Bump (brushed)"] = relief(brushed, 0.4, 1.0, backend)
    cells = []
    for name, image in sheets.items():
        label = np.full((22, SIDE), 255, np.uint8)
        cv2.putText(label, name, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 0, 1, cv2.LINE_AA)
        cells.append(np.pad(np.concatenate([label, image]), 3, constant_values=255))
    columns = 5
    blank = np.full_like(cells[0], 255)
    cells += [blank] * (-len(cells) % columns)
    rows = [np.concatenate(cells[k : k + columns], axis=1) for k in range(0, len(cells), columns)]
    cv2.imwrite(str(OUT), np.concatenate(rows), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"wrote {OUT}")


if __name__ == "__main__":
    main()
