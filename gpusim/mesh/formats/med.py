"""MED files (Salome, Code_Aster): one mesh of one computing step, with its groups.

Format: MED 2 to 4, as the MED library lays it out in HDF5 (names of the file in capitals:
ENS_MAA meshes, NOE nodes, COO coordinates, MAI cells, NOD their nodes, FAS families, GRO groups).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.files.hdf5_file import Hdf5Object, read_hdf5
from gpusim.files.input_file import InputFile
from gpusim.mesh.file_content.cell_blocks import RawBlock, RawMesh
from gpusim.mesh.file_content.faults import file_faults
from gpusim.mesh.file_content.numbering import MED_KINDS, NODES, right_handed_cells
from gpusim.mesh.file_content.text import padded_text

# numbers and names of nodes and cells, which groups don't refer to
_HARMLESS = {"NUM", "NOM", "GLB", "FAM"}
_NO_PROFILE = "MED_NO_PROFILE_INTERNAL"


def read_med(file: InputFile) -> RawMesh:
    """Nodes, cells, and families' groups. Fields are passed over.

    Raises InputError, naming the file and the place in it: several meshes or steps, a mesh that
    isn't unstructured or not of Cartesian coordinates in space, profiles, damage.
    """
    objects = read_hdf5(file, "ENS_MAA/.*|FAS/.*")
    with file_faults(file, "complete MED file"):
        return _Reader(str(file.path), objects).read()


class _Reader:
    def __init__(self, source: str, objects: Mapping[str, Hdf5Object]) -> None:
        self.source, self.objects = source, objects

    def fail(self, problem: str) -> NoReturn:
        raise InputError(f"{self.source}: {problem}")

    def inside(self, path: str) -> list[str]:
        """Names of what a group holds."""
        start = f"{path}/"
        return [
            name[len(start) :]
            for name in self.objects
            if name.startswith(start) and "/" not in name[len(start) :]
        ]

    def array(self, path: str) -> npt.NDArray[Any]:
        data = self.objects[path].data if path in self.objects else None
        if data is None:
            self.fail(f"no numbers {path}; expected them: not a MED file, cut off or damaged?")
        return data

    def attribute(self, path: str, name: str, default: Any = None) -> Any:
        return self.objects[path].attributes.get(name, default)

    def read(self) -> RawMesh:
        meshes = self.inside("ENS_MAA")
        if len(meshes) != 1:
            self.fail(f"got {len(meshes)} meshes {', '.join(meshes)[:100]}; expected one in a file")
        mesh = f"ENS_MAA/{meshes[0]}"
        for name, wanted, what in (
            ("ESP", 3, "dimensions of space"),
            ("REP", 0, "as the kind of coordinates; 0 is Cartesian"),
            ("TYP", 0, "as the type of mesh; 0 is unstructured"),
        ):
            got = self.attribute(mesh, name, wanted)
            if got != wanted:
                self.fail(f"{mesh}: {name}: got {got}; expected {wanted} {what}")
        step = mesh
        if "NOE" not in self.inside(mesh):
            steps = self.inside(mesh)
            if len(steps) != 1:
                self.fail(f"{mesh}: {len(steps)} computing steps; expected one")
            step = f"{mesh}/{steps[0]}"
        for part in self.inside(step):
            if part not in ("NOE", "MAI"):
                self.fail(f"{step}: got {part}; expected NOE and MAI: nodes, and cells by nodes")
        flat = self.array(f"{step}/NOE/COO").astype(np.float64)
        if flat.ndim != 1 or len(flat) % 3:
            self.fail(f"{step}/NOE/COO: got shape {flat.shape}; expected x, y, z of all nodes")
        points = flat.reshape(3, -1).T
        self.refuse_others(f"{step}/NOE", "COO")
        families = [self.families(f"FAS/{meshes[0]}/{kind}") for kind in ("NOEUD", "ELEME")]
        blocks = [
            self.block(f"{step}/MAI", name, points, families[1])
            for name in self.inside(f"{step}/MAI")
        ]
        return RawMesh(points, tuple(blocks), self.groups(f"{step}/NOE", families[0], len(points)))

    def refuse_others(self, path: str, main: str) -> None:
        profile = padded_text(self.attribute(path, "PFL", _NO_PROFILE))
        if profile != _NO_PROFILE:
            self.fail(f"{path}: profile {profile!r}; expected all nodes and cells")
        for name in self.inside(path):
            if name != main and name not in _HARMLESS:
                self.fail(f"{path}: got {name}; expected {main}, {', '.join(sorted(_HARMLESS))}")

    def block(
        self, cells: str, name: str, points: Float, families: dict[int, list[str]]
    ) -> RawBlock:
        path = f"{cells}/{name}"
        if name not in MED_KINDS:
            count = int(self.attribute(f"{path}/NOD", "NBR", 1)) if f"{path}/NOD" in self.objects \
                else 1  # fmt: skip
            return RawBlock(f"MED {name}", np.zeros((max(count, 0), 0), np.int64))
        kind, width = MED_KINDS[name], NODES[MED_KINDS[name]]
        self.refuse_others(path, "NOD")
        flat = self.array(f"{path}/NOD")
        if flat.ndim != 1 or len(flat) % width or flat.dtype.kind not in "iu":
            self.fail(f"{path}/NOD: got {flat.dtype} {flat.shape}; expected {width} nodes a cell")
        nodes = flat.astype(np.int64).reshape(width, -1).T - 1
        if nodes.size and nodes.min() >= 0 and nodes.max() < len(points):
            nodes = right_handed_cells(kind, points, nodes)
        return RawBlock(kind, nodes, self.groups(path, families, len(nodes)))

    def families(self, path: str) -> dict[int, list[str]]:
        """Number of a family -> its groups."""
        found: dict[int, list[str]] = {}
        for name in self.inside(path):
            family = f"{path}/{name}"
            letters = f"{family}/GRO/NOM"
            number = int(self.attribute(family, "NUM"))
            if letters in self.objects:
                rows = np.ascontiguousarray(self.array(letters)).view(np.uint8).reshape(-1, 80)
                found[number] = [padded_text(row.tobytes()) for row in rows]
        return found

    def groups(self, path: str, families: dict[int, list[str]], count: int) -> dict[str, Long]:
        """Group -> rows of the nodes, or of the cells of a type."""
        if f"{path}/FAM" not in self.objects:
            return {}
        tags = self.array(f"{path}/FAM")
        if tags.shape != (count,):
            self.fail(f"{path}/FAM: got {tags.shape} numbers; expected ({count},)")
        rows: dict[str, list[Long]] = {}
        for number, names in families.items():
            for name in names:
                rows.setdefault(name, []).append(np.flatnonzero(tags == number))
        every = {name: np.unique(np.concatenate(parts)) for name, parts in rows.items()}
        return {name: found for name, found in every.items() if len(found)}
