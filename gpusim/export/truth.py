"""truth.h5: the exact fields behind every pixel, and the nodal solution.

::

    /                          attributes: schema, version, regions, pixel_convention, …
    /mesh/points               (N, 3) float64 m          /mesh/cells/<type>   (M, nodes) int64
    /mesh/displacement/<0000>  (N, 3) float64 m, Lagrangian
    /camera/<name>             attributes width, height; K, distortion, camera_from_world
    /camera/<name>/frame/<0000>/<layer>   (H, W) or (H, W, C), see `gpusim.export.layers`

Layers are chunked 256x256, shuffled and deflated; a chunk that holds no data is not stored and
reads as the fill value, so a frame costs what it covers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import h5py
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.export.layers import LAYERS, ChunkedLayer
from gpusim.files.atomic_files import PathLike, atomic_path, safe_name
from gpusim.files.hdf5_file import writing_hdf5
from gpusim.validation import require, require_one_of

_SCHEMA = 1


class FrameWriter:
    """One frame of one camera; layers appear when they are first written to.

    Examples
    --------
    >>> with gs.export.TruthWriter("truth.h5") as truth:
    ...     truth.write_camera("cam", width=4, height=3, K=np.eye(3), camera_from_world=np.eye(4))
    ...     truth.frame("cam", 0).write_block("depth", 0, 0, np.ones((3, 4)))
    """

    def __init__(self, group: h5py.Group, shape: tuple[int, int]) -> None:
        self._group = group
        self._shape = shape
        self._layers: dict[str, ChunkedLayer] = {}

    def write_block(
        self, layer: str, row0: int, col0: int, values: npt.NDArray[np.generic]
    ) -> None:
        """Write a rectangle whose upper left pixel is (``row0``, ``col0``).

        ``values`` is (h, w) or (h, w, C) of any real dtype that fits the layer's. Raises InputError
        if it doesn't fit into the frame.
        """
        self._layer(layer).write_block(row0, col0, values)

    def write_sparse(
        self,
        layer: str,
        rows: npt.NDArray[np.integer],
        cols: npt.NDArray[np.integer],
        values: npt.NDArray[np.generic],
    ) -> None:
        """Write single pixels: ``rows``, ``cols`` (M,) integer, ``values`` (M,) or (M, C).

        A pixel named twice keeps its last value. Raises InputError if one is outside the frame.
        """
        self._layer(layer).write_sparse(rows, cols, values)

    def _layer(self, name: str) -> ChunkedLayer:
        if name not in self._layers:
            require_one_of("layer", name, LAYERS)
            self._layers[name] = ChunkedLayer(self._group, LAYERS[name], self._shape)
        return self._layers[name]


class TruthWriter:
    """Writes truth.h5 as a context manager; the file appears when the block ends well.

    Parameters
    ----------
    path
        The file to write, usually ``OUT/truth.h5``.
    regions
        Names of the paint regions; the layer ``region`` holds indices into them.
    attributes
        Further text or numbers for the file's attributes (version, scene digest, adapter).

    Raises
    ------
    InputError
        Wrong shapes or names, or a place that can't be written to.
    GpusimError
        The disk is full.

    Examples
    --------
    >>> with gs.export.TruthWriter("truth.h5", regions=("side",)) as truth:
    ...     truth.write_mesh(np.eye(4, 3), {"tet4": np.array([[0, 1, 2, 3]])})
    """

    def __init__(
        self,
        path: PathLike,
        *,
        regions: Sequence[str] = (),
        attributes: Mapping[str, str | int | float] | None = None,
    ) -> None:
        self._path = Path(path)
        self._regions = tuple(regions)
        self._attributes = dict(attributes or {})
        self._stack = ExitStack()
        self._open_file: h5py.File | None = None

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            part = stack.enter_context(atomic_path(self._path))
            file = stack.enter_context(writing_hdf5(part, track_order=True))
            file.attrs["schema"] = _SCHEMA
            file.attrs["regions"] = np.array(self._regions, dtype=h5py.string_dtype())
            file.attrs["pixel_convention"] = (
                "rows down, columns right; an integer coordinate is a pixel centre"
            )
            file.attrs["frame_0000"] = "the reference frame is frame 0000 of each camera"
            file.attrs.update(self._attributes)
            self._open_file = file
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open_file = None
        self._stack.__exit__(kind, error, trace)

    def write_mesh(self, points: Float, cells: Mapping[str, npt.NDArray[np.integer]]) -> None:
        """Write nodes (N, 3) float64 m in the reference configuration and cells (M, nodes)."""
        _check("points", points, (None, 3))
        mesh = self._file.create_group("mesh")
        _nodal(mesh, "points", points)
        for kind, array in cells.items():
            _check(f"cells[{kind!r}]", array, (None, None))
            mesh.create_dataset(f"cells/{kind}", data=array.astype(np.int64), **_packing(array))

    def write_nodal_displacement(
        self,
        step: int,
        displacement: Float,
        **when: float,
    ) -> None:
        """Write u (N, 3) float64 m of one step; the mesh must have been written.

        ``when`` says what the step is: load_factor, time, phase_deg, or mode; and time_s.
        """
        require("mesh" in self._file, "nodal displacement", "no mesh", "write_mesh before")
        _check("displacement", displacement, self._file["mesh/points"].shape)
        group = self._file["mesh"].require_group("displacement")
        data = _nodal(group, _frame_name(step), displacement)
        data.attrs.update(when)

    def write_camera(
        self,
        name: str,
        *,
        width: int,
        height: int,
        K: Float,
        camera_from_world: Float,
        distortion: Float | Sequence[float] = (),
        line_time: float = 0.0,
        exposure_time: float = 0.0,
    ) -> None:
        """Write a camera: K (3, 3) px, camera_from_world (3, 4) or (4, 4) m, OpenCV distortion; how
        long a row is exposed, and how much later the next one is (s)."""
        what, pose_what = f"camera {name!r}", f"camera {name!r}: camera_from_world"
        require(min(width, height) >= 1, what, f"{width} x {height} px", "1 or more")
        shape = camera_from_world.shape
        require(shape in ((3, 4), (4, 4)), pose_what, f"shape {shape}", "(3, 4) or (4, 4)")
        _check(f"{what}: K", K, (3, 3))
        _check(pose_what, camera_from_world, (None, 4))
        full = np.vstack([camera_from_world[:3], [0.0, 0.0, 0.0, 1.0]])
        coefficients = np.asarray(distortion, np.float64).reshape(-1)
        _check(f"{what}: distortion", coefficients, (None,))
        group = self._file.create_group(f"camera/{safe_name(name)}")
        group.attrs.update(width=width, height=height, line_time_s=line_time,
                           exposure_time_s=exposure_time)  # fmt: skip
        group.create_dataset("K", data=K).attrs["unit"] = "px"
        pose = group.create_dataset("camera_from_world", data=full)
        pose.attrs.update(unit="m", frame="camera: x right, y down, z forward")
        lens = group.create_dataset("distortion", data=coefficients)
        lens.attrs["convention"] = "OpenCV: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 taux tauy"

    def take_cameras(self, stream: BinaryIO, names: Iterable[str]) -> None:
        """Write cameras with their frames as they lie packed in another such file.

        Raises InputError for a camera that isn't there.
        """
        with h5py.File(stream, "r") as source:
            for path in (f"camera/{safe_name(name)}" for name in names):
                require(path in source, "cameras of another truth file", "none", f"a {path}")
                source.copy(path, self._file.require_group("camera"))

    def frame(
        self,
        camera: str,
        index: int,
        **when: float,
    ) -> FrameWriter:
        """Return the writer of frame ``index`` of a camera that has been written; ``when`` as
        `write_nodal_displacement` has it."""
        path = f"camera/{safe_name(camera)}"
        require(path in self._file, "frame", f"camera {camera!r}", "write_camera before")
        group = self._file[path]
        frame = group.require_group("frame").create_group(_frame_name(index), track_order=True)
        frame.attrs.update(when)
        return FrameWriter(frame, (int(group.attrs["height"]), int(group.attrs["width"])))

    @property
    def _file(self) -> h5py.File:
        if self._open_file is None:
            raise InputError("truth file: it is closed; expected use inside its 'with' block")
        return self._open_file


def _frame_name(index: int) -> str:
    require(index >= 0, "frame", index, "0 or more")
    return f"{index:04d}"


def _check(name: str, values: npt.NDArray[np.generic], shape: Sequence[int | None]) -> None:
    fits = values.ndim == len(shape) and all(
        wanted in (None, size) for size, wanted in zip(values.shape, shape, strict=True)
    )
    if not fits:
        wanted_text = ", ".join("*" if size is None else str(size) for size in shape)
        raise InputError(f"{name}: got shape {values.shape}; expected ({wanted_text})")
    known = values.dtype.kind in "iuf" and np.isfinite(values).all()
    require(known, name, f"{values.dtype} with bad values", "finite numbers")


def _nodal(group: h5py.Group, name: str, values: Float) -> h5py.Dataset:
    """A dataset of the nodes' places or displacements (N, 3), m."""
    data = group.create_dataset(name, data=values.astype(np.float64), **_packing(values))
    data.attrs.update(unit="m", frame="world", convention="Lagrangian")
    return data


def _packing(values: npt.NDArray[np.generic]) -> dict[str, object]:
    """Compress arrays worth it; small ones stay contiguous."""
    if values.size < 4096:
        return {}
    return {"compression": "gzip", "compression_opts": 1, "shuffle": True}
