"""The table of truth layers: what each one holds, in which unit, frame and convention.

Layers are stored on the pixel grid of a frame, at the pixel *centre* and unfiltered. "Eulerian"
means: the value belongs to the material point that this pixel of this frame sees. (Nodal fields in
the same file are "Lagrangian": indexed by node.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["LAYERS", "Layer"]


@dataclass(frozen=True)
class Layer:
    """One truth layer. ``components`` is 1 for (H, W), C for (H, W, C); ``fill`` marks no data."""

    name: str
    components: int
    dtype: str
    unit: str
    frame: str
    convention: str
    text: str

    @property
    def fill(self) -> float:
        """NaN for floating point, -1 for integers."""
        return float("nan") if np.dtype(self.dtype).kind == "f" else -1


LAYERS: dict[str, Layer] = {
    layer.name: layer
    for layer in (
        Layer(
            "reference",
            3,
            "float64",
            "m",
            "world",
            "Eulerian",
            "X: where the material point seen by this pixel was in the reference configuration",
        ),
        Layer(
            "displacement",
            3,
            "float32",
            "m",
            "world",
            "Eulerian",
            "u = x - X of the material point seen by this pixel",
        ),
        Layer(
            "depth",
            1,
            "float32",
            "m",
            "camera",
            "Eulerian",
            "planar depth: z along the optical axis, not the length of the ray",
        ),
        Layer(
            "flow",
            2,
            "float32",
            "px",
            "image (x right, y down)",
            "Eulerian",
            "from this pixel to where its material point is in the reference (undeformed) frame",
        ),
        Layer(
            "normal",
            3,
            "float32",
            "1",
            "world",
            "Eulerian",
            "unit outward normal of the deformed surface",
        ),
        Layer(
            "region",
            1,
            "int32",
            "1",
            "index",
            "Eulerian",
            "paint region: index into the attribute 'regions' of the file; -1 background",
        ),
        Layer(
            "element",
            1,
            "int32",
            "1",
            "index",
            "Eulerian",
            "finite element that owns the surface seen by this pixel; -1 background or rigid prop",
        ),
        Layer(
            "visibility",
            1,
            "int8",
            "1",
            "index",
            "Eulerian",
            "1 if this material point is also seen in the reference frame, 0 if not, -1 background",
        ),
        Layer(
            "cameras",
            1,
            "int32",
            "1",
            "bits",
            "Eulerian",
            "bit k: camera k of the file's attribute 'cameras' sees this material point in this"
            " frame too; -1 background",
        ),
    )
}
