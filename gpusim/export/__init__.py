"""Files that other programs read: images, meshes, surfaces, truth.

Its modules:

- `images`: Images as PNG and TIFF, without loss.
- `radiance`: Linear radiance as OpenEXR and float TIFF.
- `frame_writers`: What writes the frames of each kind of video file.
- `video`: Video out: frames go to a sink one by one.
- `meshes`: Surfaces as STL, solids and results as VTU.
- `layers`: The truth layers: what each one holds, and how it is stored.
- `truth`: truth.h5: the exact fields behind every pixel.
- `body_state`: A body in one frame, from which its fields follow.
- `field_catalogue`: All fields of bodies, truth and measurements by name: title, unit, values.
- `calibrated_cameras`: Cameras of a calibration, and those of calibration files and scenes.
- `correlation`: Measured displacements and strains as CSV, NPZ and HDF5.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gpusim.export.images import read_image as read_image
    from gpusim.export.images import write_image as write_image
    from gpusim.export.meshes import write_pvd as write_pvd
    from gpusim.export.meshes import write_region_stls as write_region_stls
    from gpusim.export.meshes import write_stl as write_stl
    from gpusim.export.meshes import write_vtu as write_vtu
    from gpusim.export.radiance import write_radiance as write_radiance
    from gpusim.export.truth import FrameWriter as FrameWriter
    from gpusim.export.truth import TruthWriter as TruthWriter
    from gpusim.export.video import VideoSink as VideoSink
    from gpusim.files.atomic_files import atomic_path as atomic_path
    from gpusim.files.atomic_files import atomic_stream as atomic_stream
    from gpusim.files.atomic_files import clean_leftovers as clean_leftovers
    from gpusim.files.atomic_files import safe_name as safe_name

# HDF5 and mesh formats take a tenth of a second to import, which most runs don't need
_HOMES = {
    "files.atomic_files": ("atomic_path", "atomic_stream", "clean_leftovers", "safe_name"),
    "export.images": ("read_image", "write_image"),
    "export.meshes": ("write_pvd", "write_region_stls", "write_stl", "write_vtu"),
    "export.radiance": ("write_radiance",),
    "export.truth": ("FrameWriter", "TruthWriter"),
    "export.video": ("VideoSink",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
__all__ = sorted(_HOME_OF)


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(importlib.import_module(f"gpusim.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module 'gpusim.export' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
