"""Names of the cases of `scripts/gpu_check.py`, by scale; nothing of gpusim is imported here."""

from __future__ import annotations

FE = {
    "full": ("cube-345k", "cube-971k", "beam-300k", "bracket-660k", "uneven-100k"),
    "quick": ("cube-100k", "beam-100k", "bracket-53k", "uneven-10k"),
}
IMAGES = {
    "full": ("crane", "crane-lit", "speckle", "board", "faces-300k-lit"),
    "quick": ("crane", "crane-lit", "speckle", "board", "faces-100k-lit"),
}
