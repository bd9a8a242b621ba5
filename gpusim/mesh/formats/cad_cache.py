"""Meshes of CAD files, kept in the user's cache folder: what plans, runs and views of a part need
is meshed once.

A mesh is known by the file's content, what was asked for, and the versions of Gmsh and gpusim. One
that is damaged is made anew, and the oldest go. ``GPUSIM_NO_CACHE=1`` switches it off.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from os import PathLike
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from gpusim._version import __version__
from gpusim.errors import GpusimError
from gpusim.files.atomic_files import atomic_stream, clean_leftovers
from gpusim.files.cache_files import cache_folder, open_cached
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.formats.cad import mesh_cad
from gpusim.mesh.mesh import Mesh

MOST_MESHES = 100
MOST_BYTES = 1_000_000_000
"""Of all of them; a larger mesh isn't kept."""
_MAPPINGS = ("cells", "node_sets", "face_sets", "cell_sets")


def cached_cad_mesh(path: str | PathLike[str] | InputFile, **options: Any) -> Mesh:
    """As `gpusim.mesh.mesh_cad`, whose options these are; the mesh is read if it was made before.

    Raises InputError likewise.
    """
    file = read_input(path, "a CAD file")
    place = _place(file, options)
    if place is None:
        return mesh_cad(file, **options)
    with suppress(
        OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, RecursionError,
        MemoryError, BadZipFile, NotImplementedError, GpusimError,
    ):  # fmt: skip
        return _read(place)
    grid = mesh_cad(file, **options)
    with suppress(OSError, GpusimError):  # no room, or no permission: it is made again
        _keep(grid, place)
    return grid


def is_kept(path: str | PathLike[str] | InputFile, **options: Any) -> bool:
    """Whether `cached_cad_mesh` has made this mesh before, and has kept it."""
    place = _place(read_input(path, "a CAD file"), options)
    return place is not None and place.is_file()


def _place(file: InputFile, options: dict[str, Any]) -> Path | None:
    """Where the mesh is kept; None: nowhere."""
    folder = cache_folder()
    try:
        versions = __version__, version("gmsh")
    except PackageNotFoundError:  # some other Gmsh, of which nothing is known
        return None
    asked = {name: value for name, value in options.items() if name != "time_limit"}
    text = json.dumps([versions, file.sha256, file.suffix, asked], sort_keys=True, default=vars)
    name = f"{hashlib.sha256(text.encode()).hexdigest()}.npz"
    return None if folder is None else folder / "meshes" / name


def _read(place: Path) -> Mesh:
    """Raises one error or another if there is no whole mesh."""
    with open_cached(place, MOST_BYTES) as stream:
        size = os.fstat(stream.fileno()).st_size
        with np.load(stream, allow_pickle=False) as stored:
            if sum(entry.file_size for entry in stored.zip.infolist()) > size:
                raise ValueError  # more than was written
            heads = json.loads(str(stored["heads"]))
            if heads["name"] != place.name:
                raise ValueError
            mappings = {
                of: {name: stored[f"{of}{number}"] for number, name in enumerate(heads[of])}
                for of in _MAPPINGS
            }
            grid = Mesh(stored["points"], **mappings)
    with suppress(OSError):
        os.utime(place)  # it is in use
    return grid


def _keep(grid: Mesh, place: Path) -> None:
    """Write a mesh and let go of the oldest. Raises OSError or GpusimError if that can't be."""
    heads: dict[str, Any] = {"name": place.name}
    arrays = {"points": grid.points}
    for of in _MAPPINGS:
        heads[of] = list(getattr(grid, of))
        arrays |= {f"{of}{k}": array for k, array in enumerate(getattr(grid, of).values())}
    if sum(array.nbytes for array in arrays.values()) > 0.9 * MOST_BYTES:
        return
    with atomic_stream(place) as stream:
        np.savez(stream, allow_pickle=False, heads=np.array(json.dumps(heads)), **arrays)
    clean_leftovers(place.parent)
    known = [(path.lstat(), path) for path in place.parent.glob("*.npz")]
    kept_bytes = 0
    for number, (status, path) in enumerate(sorted(known, key=lambda one: -one[0].st_mtime_ns)):
        kept_bytes += status.st_size
        if number >= MOST_MESHES or kept_bytes > MOST_BYTES:
            path.unlink(missing_ok=True)
