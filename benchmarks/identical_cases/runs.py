"""Whole runs: the examples, smaller."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import numpy.typing as npt

import gpusim as gs
from benchmarks.identical_cases.arrays import Arrays, Case

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def example(name: str, changes: Mapping[str, Any]) -> Arrays:
    """A scene of the examples run."""
    return written(gs.load_scene(EXAMPLES / f"{name}.toml", changes))


def written(scene: gs.Scene) -> Arrays:
    """A scene run into a folder: what it writes but reports and figures."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        gs.run(scene, out)
        result: dict[str, npt.NDArray[Any]] = {}
        for path in sorted(out.rglob("*")):
            relative = path.relative_to(out)
            if "figures" not in relative.parts:
                result |= {f"{relative}{key}": value for key, value in _read(path).items()}
    return result


def _read(path: Path) -> Arrays:
    if path.suffix == ".npz":
        with np.load(path) as stored:
            return {f":{key}": stored[key] for key in stored}
    if path.suffix == ".h5":
        parts: list[tuple[str, Any]] = []
        with h5py.File(path) as file:
            file.visititems(lambda key, item: parts.append((key, item)))
            return {f":{key}": item[()] for key, item in parts
                    if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub"}  # fmt: skip
    if path.suffix in (".png", ".tif", ".tiff"):
        return {"": np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))}
    if path.suffix in (".csv", ".vtu"):
        return {"": np.frombuffer(path.read_bytes(), np.uint8)}
    return {}


EXAMPLE_CHANGES: dict[str, dict[str, Any]] = {
    "bimetal": {"camera.side.resolution_px": [1000, 400]},
    "cantilever": {"camera.side.resolution_px": [1000, 400]},
    "crane": {"camera.front.resolution_px": [702, 468], "body.crane.mesh.element_mm": 6.0,
              "measure": []},
    "damaged_beam": {"camera.front.resolution_px": [1280, 300],
                     "body.beam.mesh.divisions": [100, 1, 6]},
    "lug": {"camera.above.resolution_px": [300, 200]},
    "strip": {"camera.above.resolution_px": [240, 160]},
}  # fmt: skip

CASES: dict[str, Case] = {
    f"example/{name}": partial(example, name, changes) for name, changes in EXAMPLE_CHANGES.items()
}
