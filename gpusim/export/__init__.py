"""Files that other programs read: images, meshes, surfaces, truth.

Its modules:

- `images`: Images as PNG and TIFF, without loss.
- `radiance`: Linear radiance as OpenEXR and float TIFF.
- `frame_writers`: What writes the frames of each kind of video file.
- `video`: Video out: frames go to a sink one by one.
- `meshes`: Surfaces as STL, solids and results as VTU.
- `layers`: The truth layers: what each one holds, and how it is stored.
- `columns`: Columns of a table as CSV and Parquet.
- `truth`: truth.h5: the exact fields behind every pixel.
- `body_state`: A body in one frame, from which its fields follow.
- `field_catalogue`: All fields of bodies, truth and measurements by name: title, unit, values.
- `calibrated_cameras`: Cameras of a calibration, and those of calibration files and scenes.
- `correlation`: Measured displacements and strains as CSV, NPZ and HDF5.
"""

import typing as _typing

from gpusim.public_names import public_names as _public_names

if _typing.TYPE_CHECKING:
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
    "gpusim.export.images": "read_image write_image",
    "gpusim.export.meshes": "write_pvd write_region_stls write_stl write_vtu",
    "gpusim.export.radiance": "write_radiance",
    "gpusim.export.truth": "FrameWriter TruthWriter",
    "gpusim.export.video": "VideoSink",
    "gpusim.files.atomic_files": "atomic_path atomic_stream clean_leftovers safe_name",
}
__all__, __getattr__, __dir__ = _public_names(__name__, _HOMES)
