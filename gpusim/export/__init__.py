"""Files that other programs read: images, meshes, surfaces, truth."""

from __future__ import annotations

from gpusim.export.files import atomic_path, atomic_stream, clean_leftovers, safe_name
from gpusim.export.images import read_image, write_image
from gpusim.export.stl import write_region_stls, write_stl
from gpusim.export.truth import FrameWriter, TruthWriter
from gpusim.export.vtu import write_pvd, write_vtu

__all__ = [
    "FrameWriter",
    "TruthWriter",
    "atomic_path",
    "atomic_stream",
    "clean_leftovers",
    "read_image",
    "safe_name",
    "write_image",
    "write_pvd",
    "write_region_stls",
    "write_stl",
    "write_vtu",
]
