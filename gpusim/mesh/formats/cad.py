"""CAD files (STEP, BREP, STL) meshed by Gmsh, which is an optional dependency.

Gmsh and Open CASCADE die or hang on some damaged files: they work in a process of their own.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input
from gpusim.mesh.file_content.cell_blocks import RawBlock, RawMesh, assemble, index_of
from gpusim.mesh.file_content.numbering import GMSH_KINDS, NODES, from_gmsh_order
from gpusim.mesh.formats.element_sizes import CadOptions, SizeBox, check_sizes, set_sizes
from gpusim.mesh.mesh import Mesh
from gpusim.parallel.machine import memory_limit
from gpusim.parallel.processes import CHILD_SECONDS, call_in_child
from gpusim.validation import require, require_one_of

CAD_SUFFIXES = (".step", ".stp", ".brep", ".stl")


# What Open CASCADE calls a shape that has no name.
_NAMELESS = ("Open CASCADE STEP translator", "SOLID", "COMPOUND", "NONE")
_STL_ANGLE = 40.0  # degrees; a sharper bend between triangles is an edge of the body
_TETRAHEDRON = 0.12  # volume of a regular one with edges of length 1
_ON_FACES = 3.46  # tetrahedra in a layer, by the area of both its sides: three per two triangles
_MAX_ELEMENTS = 1e8
_BYTES_PER_ELEMENT = 300  # of what Gmsh takes
_LIBRARIES = "libgl1 libglu1-mesa libxcursor1 libxft2 libxinerama1 libxrender1 libgomp1"


Parts = dict[int, list[str]]
"""Volumes or surfaces of the geometry, by tag, with the names of the sets that they belong to."""


def mesh_cad(
    path: str | PathLike[str] | InputFile,
    *,
    size: float,
    order: int = 1,
    hexahedra: bool = False,
    hex_dominant: bool = False,
    curvature: int = 0,
    sizes: Mapping[str, float] | None = None,
    boxes: Sequence[SizeBox] = (),
    scale: float = 1.0,
    time_limit: float = CHILD_SECONDS,
) -> Mesh:
    """Mesh the solids of a ``.step``/``.stp``, ``.brep`` or closed ``.stl`` file.

    Parameters
    ----------
    size
        Greatest element size, in the unit of the result.
    order
        1 (tet4, hex8) or 2 (tet10, hex20; midside nodes lie on the
        curved faces of STEP and BREP).
    hexahedra
        Hexahedra only: structured if every solid has six sides, else each tetrahedron is cut into
        four (conforming everywhere, but of low quality).
    hex_dominant
        Structured hexahedra in the solids with six sides, tetrahedra in the others, pyramids
        between them.
    curvature
        Elements around a full circle where the surface is curved; 0: ``size`` alone decides. Not
        for STL, whose surface is flat triangles.
    sizes
        Element size at a named face or in a named solid (names as below).
    boxes
        Regions with a smaller size.
    scale
        Factor on the coordinates. Those of a STEP file are millimetres, whatever its own unit; of
        the others as in the file.
    time_limit
        Seconds after which it is given up.

    Each CAD face is a face set "face_1", "face_2", … by its number in the file, and one by its
    name if the file names it; with several solids, or named ones, there are cell sets "solid_1", …
    and by name. Touching solids share their nodes. The same file and options give the same mesh.

    Raises
    ------
    InputError
        gmsh or its libraries are missing, a file that is absent, of another kind or can't be
        meshed, or that Gmsh dies on, doesn't get done with in time, or takes more than 80 % of the
        memory for; a file without solids, unknown names in ``sizes``, sizes that aren't positive.

    Examples
    --------
    >>> cube = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> gs.export.write_stl("cube.stl", cube.points, gs.mesh.boundary_faces(cube).nodes).name
    'cube.stl'
    >>> gs.mesh_cad("cube.stl", size=1000.0, scale=1e-3).bounds[1]
    array([1., 1., 1.])
    """
    name = path.path if isinstance(path, InputFile) else Path(path)
    suffix = name.suffix.lower() or "no ending"
    require_one_of(f"{name}: unknown kind of CAD file", suffix, CAD_SUFFIXES)
    file = read_input(path, "a CAD file")
    if not file.data:
        raise InputError(f"{file.path}: the file is empty; expected a CAD file")
    require(time_limit > 0.0, "mesh_cad: time_limit", time_limit, "seconds > 0")
    options = CadOptions(
        size, order, hexahedra, hex_dominant, curvature, dict(sizes or {}), tuple(boxes), scale
    )
    _check_options(file, options)
    check_gmsh(str(file.path))
    raw = call_in_child(f"{file.path}: can't be meshed", time_limit, _raw_mesh, file, options)
    return assemble(raw, str(file.path))


def _check_options(file: InputFile, ask: CadOptions) -> None:
    require(ask.order in (1, 2), "mesh_cad: order", ask.order, "1 or 2")
    if file.suffix == ".stl":
        _refuse_nonfinite_corners(file)
    fits = not ask.curvature or file.suffix != ".stl"
    what = f"{file.path}: curvature for a surface of flat triangles"
    require(fits, what, ask.curvature, "0 (or the part as STEP or BREP)")
    if ask.hexahedra and ask.hex_dominant:
        raise InputError("mesh_cad: hexahedra and hex_dominant; got both; expected one of them")
    check_sizes(ask)


def check_gmsh(file: str) -> None:
    """Raises InputError for a CAD file unless gmsh is installed; it isn't loaded.

    Examples
    --------
    >>> gs.mesh.check_gmsh("part.step")
    """
    if find_spec("gmsh") is None:
        raise InputError(
            f"{file}: a CAD file needs gmsh, which is not installed; expected it: {_pip()}"
        )


def _pip() -> str:
    return f"{sys.executable or 'python'} -m pip install gmsh"


def _raw_mesh(file: InputFile, options: CadOptions) -> RawMesh:
    """The work of the child, which has a Gmsh of its own."""
    gmsh = _gmsh()
    gmsh.initialize([], readConfigFiles=False, run=False, interruptible=False)
    numbers = {
        # errors are asked for after each step: one thrown would leave the mesher in mid-work
        "General.AbortOnError": 0,
        "General.Terminal": 0, "General.NumThreads": 1, "Mesh.RandomSeed": 1,
        "Geometry.OCCImportLabels": 1, "Mesh.SaveAll": 1,
        "Mesh.SecondOrderIncomplete": 1, "Mesh.HighOrderOptimize": 1,
        # an STL's surface is flat triangles: its midside nodes stay on straight edges
        "Mesh.SecondOrderLinear": int(file.suffix == ".stl"),
    }  # fmt: skip
    for option, value in numbers.items():
        gmsh.option.setNumber(option, value)
    try:
        with file.on_disk() as copy:
            _load(gmsh, file, copy)
        _refuse_errors(gmsh, file.path)
        volumes, surfaces = _parts(gmsh, 3), _parts(gmsh, 2, _face_names(file))
        require(bool(volumes), f"{file.path}: no solid", f"{len(surfaces)} faces", "a closed body")
        _refuse_too_many(gmsh, file, options.size, options.scale)
        named: dict[str, list[tuple[int, int]]] = {}
        for dimension, parts in ((3, volumes), (2, surfaces)):
            for tag, names in parts.items():
                for name in names:
                    named.setdefault(name, []).append((dimension, tag))
        set_sizes(gmsh, options, named)
        _generate(gmsh, options)
        _refuse_errors(gmsh, file.path)
        return _collect(gmsh, volumes, surfaces, options.scale)
    except InputError:
        raise
    except Exception as error:  # Gmsh's own have no type of their own
        text = " ".join(str(error).split())
        raise InputError(f"{file.path}: Gmsh can't mesh it; got {text[:200]}") from None


def _gmsh() -> Any:
    try:
        import gmsh
    except (OSError, ImportError) as error:
        raise InputError(
            f"mesh_cad: gmsh can't be loaded; got {error}; expected its libraries, on "
            f"Debian: apt install {_LIBRARIES}; if they are there, gmsh anew: {_pip()}"
        ) from None
    return gmsh


def _refuse_errors(gmsh: Any, file: Path) -> None:
    """Gmsh's last error since the session or the last mesh began, if there was one."""
    text = " ".join(str(gmsh.logger.getLastError()).split())
    if text:
        raise InputError(f"{file}: Gmsh can't mesh it; got {text[:200]}")


def _refuse_too_many(gmsh: Any, file: InputFile, size: float, scale: float) -> None:
    """Gmsh would work for days, or until the memory is full."""
    if file.suffix == ".stl":
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        place = np.zeros((int(max(tags)) + 1, 3))
        place[tags.astype(np.int64)] = np.reshape(coordinates, (-1, 3))
        corners = gmsh.model.mesh.getElementsByType(2)[1].reshape(-1, 3).astype(np.int64)
        triangles = place[corners]
        volume = abs(float(np.linalg.det(triangles).sum())) / 6.0
        sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        area = 0.5 * float(np.linalg.norm(sides, axis=1).sum())
    else:
        volume, area = (
            sum(gmsh.model.occ.getMass(*entity) for entity in gmsh.model.getEntities(dimension))
            for dimension in (3, 2)
        )
    size = size / scale  # in the file's unit
    # of a part that is thinner than its elements the faces decide
    count = max(volume / (_TETRAHEDRON * size**3), _ON_FACES * area / size**2)
    most = min(_MAX_ELEMENTS, memory_limit() / _BYTES_PER_ELEMENT)
    least = max((volume / (_TETRAHEDRON * most)) ** (1 / 3), (_ON_FACES * area / most) ** 0.5)
    if not count <= most:
        raise InputError(
            f"{file.path}: size; got {size:g} in the file's unit, which makes about "
            f"{count:.1g} elements; expected at least {least:.2g}"
        )


def _refuse_nonfinite_corners(file: InputFile) -> None:
    """Gmsh takes a corner at NaN for some other corner."""
    content = file.data
    facets = np.frombuffer(content[84:], np.uint8)
    if len(content) > 84 and len(facets) == 50 * int.from_bytes(content[80:84], "little"):
        numbers = facets.reshape(-1, 50)[:, 12:48].copy().view("<f4")
        lost = int((~np.isfinite(numbers)).any(axis=1).sum())
    else:
        lost = len(re.findall(rb"vertex[^\n]*(?:nan|inf)", content, re.IGNORECASE))
    require(not lost, f"{file.path}: corners", f"{lost} that aren't finite", "coordinates")


def _load(gmsh: Any, file: InputFile, copy: Path) -> None:
    """Geometry of the file, of which there is a copy on the disk, in the current model."""
    if file.suffix == ".stl":
        gmsh.merge(str(copy))
        gmsh.model.mesh.classifySurfaces(np.deg2rad(_STL_ANGLE), True, True, np.pi)
        gmsh.model.mesh.createGeometry()
        surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
        if surfaces:
            gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop(surfaces)])
        gmsh.model.geo.synchronize()
        return
    gmsh.model.occ.importShapes(str(copy))
    solids = gmsh.model.occ.getEntities(3)
    if len(solids) > 1:
        gmsh.model.occ.fragment(solids, [])  # touching faces become one
    gmsh.model.occ.synchronize()


def _face_names(file: InputFile) -> list[str]:
    """Names of the faces of a STEP file with one shell, in its order, which is that of Open
    CASCADE; Gmsh leaves them out. Empty for other files."""
    text = file.data.decode("latin-1") if file.suffix in (".step", ".stp") else ""
    shells = re.findall(r"_SHELL\s*\(\s*'[^']*'\s*,\s*\(([^)]*)\)", text)
    names = dict(re.findall(r"(#\d+)\s*=\s*ADVANCED_FACE\s*\(\s*'([^']*)'", text))
    return [names.get(one.strip(), "") for one in shells[0].split(",")] if len(shells) == 1 else []


def _parts(gmsh: Any, dimension: int, names: Sequence[str] = ()) -> Parts:
    """``names``: of the parts in their order, where they are as many."""
    word = "solid" if dimension == 3 else "face"
    parts: Parts = {}
    entities = gmsh.model.getEntities(dimension)
    for number, (_, tag) in enumerate(entities, start=1):
        label = str(gmsh.model.getEntityName(dimension, tag)).rsplit("/", maxsplit=1)[-1].strip()
        if not label and len(names) == len(entities):
            label = names[number - 1].strip()
        parts[tag] = [f"{word}_{number}"]
        if label and not label.startswith(_NAMELESS):
            parts[tag].append(label)
    return parts


def _generate(gmsh: Any, ask: CadOptions) -> None:
    mesh = gmsh.model.mesh
    if ask.hexahedra or ask.hex_dominant:
        mesh.setTransfiniteAutomatic(recombine=True)
        mesh.generate(3)
        kinds = {GMSH_KINDS.get(int(type_)) for type_ in mesh.getElementTypes(3)}
        if ask.hexahedra and kinds != {"hex8"}:
            mesh.clear()
            mesh.removeConstraints()
            gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2)
            gmsh.option.setNumber("Mesh.MeshSizeFactor", 2.0)  # every edge is halved afterwards
            mesh.generate(3)
    else:
        mesh.generate(3)
    if ask.order == 2:
        mesh.setOrder(2)


def _collect(gmsh: Any, volumes: Parts, surfaces: Parts, scale: float) -> RawMesh:
    """The elements of volumes and surfaces."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    tags = np.asarray(tags, dtype=np.int64)
    order = np.argsort(tags, kind="stable")
    points = np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[order] * scale
    blocks = []
    # a lone solid needs no set unless the file names it
    plain = len(volumes) == 1
    for dimension, parts in ((3, volumes), (2, surfaces)):
        for tag, names in parts.items():
            types, _, nodes = gmsh.model.mesh.getElements(dimension, tag)
            sets = names[1:] if dimension == 3 and plain else names
            for type_, flat in zip(types, nodes, strict=True):
                kind = GMSH_KINDS.get(int(type_), f"Gmsh type {type_}")
                if kind not in NODES:
                    raise InputError(f"mesh_cad: got elements of {kind}; expected order 1 or 2")
                rows = index_of(tags[order], np.asarray(flat, dtype=np.int64))
                rows = rows.reshape(-1, NODES[kind])
                groups = dict.fromkeys(sets, np.arange(len(rows)))
                blocks.append(RawBlock(kind, from_gmsh_order(kind, rows), groups))
    return RawMesh(points, tuple(blocks))
