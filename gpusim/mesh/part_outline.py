"""The outline of a part: its sizes and faces, for a first scene.

Faces are told apart as on a drawing: planes by where they look, round ones by axis and radius.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gpusim.arrays.array_types import Float
from gpusim.mesh.boundary import Faces, boundary_faces
from gpusim.mesh.mesh import Mesh
from gpusim.mesh.selection import select_faces
from gpusim.validation import by_number

_ELEMENTS, _TETRAHEDRON = 40_000, 0.12  # so many of about this volume, if their edge is 1
_SIDE = 0.8  # of what looks along an axis: a plane of that area is shown in its place
_FLAT, _CIRCULAR = 1e-6, 1e-3  # of normals; of a radius


@dataclass(frozen=True, eq=False)
class PartFace:
    """Faces with a ``name``: that of a set, or what looks along an axis ("-y").

    ``kind`` in words; ``normal`` out of what is plane or looks along an axis, else None;
    ``centre``, m; ``area``, m2.
    """

    name: str
    kind: str
    normal: Float | None
    centre: Float
    area: float


@dataclass(frozen=True, eq=False)
class PartOutline:
    """Corners of the bounding box, ``low`` and ``high`` (m); ``volume`` (m3); area of the ``skin``
    (m2); its ``faces`` by the sets of the file, and what looks along each axis, ``sides``."""

    low: Float
    high: Float
    volume: float
    skin: float
    faces: tuple[PartFace, ...]
    sides: tuple[PartFace, ...]

    @property
    def axis(self) -> int:
        """Along which it is longest: 0, 1, 2."""
        return int(np.argmax(self.high - self.low))

    @property
    def element_size(self) -> float:
        """Fine enough for thickness and length, as far as 40,000 tetrahedra go (m)."""
        fine = min(1.2 * self.volume / self.skin, float((self.high - self.low).max()) / 15.0)
        return max(fine, float(np.cbrt(self.volume / (_TETRAHEDRON * _ELEMENTS))))

    def end(self, sign: int) -> PartFace | None:
        """The plane that closes it at that end (-1, 1) of its longest axis, if one does."""
        place = (self.high if sign > 0 else self.low)[self.axis]
        near = _FLAT * float((self.high - self.low).max())
        for face in self.faces:
            across = face.normal is not None and face.normal[self.axis] * sign > 1.0 - _FLAT
            if across and abs(face.centre[self.axis] - place) <= near:
                return face
        return None

    def broadside(self) -> PartFace:
        """The largest plane along the part, or the side to which clearly more of it looks; of two
        equal ones that along an axis, not against it: seen from there, a plate isn't mirrored."""
        along = [face for face in (*self.faces, *self.sides)
                 if face.normal is not None and abs(face.normal[self.axis]) < 0.5]  # fmt: skip
        # a side takes what looks there of roundings and holes, too, which a set doesn't
        weight = dict.fromkeys(self.faces, 1.0)

        def rank(face: PartFace) -> tuple[float, float]:
            area = float(f"{face.area * weight.get(face, _SIDE):.6g}")
            return area, 0.0 if face.normal is None else round(float(face.normal.sum()), 6)

        return max(along, key=rank)


def part_outline(mesh: Mesh) -> PartOutline:
    """Of what a mesh fills (m), coarse as it may be.

    Examples
    --------
    >>> from gpusim.mesh.part_outline import part_outline
    >>> part = part_outline(gs.mesh.box(size=(0.3, 0.2, 0.1), divisions=(1, 1, 1)))
    >>> part.end(1).name, part.end(1).kind, round(part.broadside().area, 6)
    ('x_max', 'plane that looks +x', 0.06)
    """
    skin = boundary_faces(mesh)
    low, high = mesh.bounds
    # the divergence theorem, about a point that is near
    volume = float(((skin.centroids - low) * skin.area_vectors).sum()) / 3.0
    named: dict[bytes, str] = {}
    for name in by_number(mesh.face_sets):  # by the file's own name, if it has one too
        pairs = mesh.face_sets[name].tobytes()
        if pairs not in named or named[pairs].startswith("face_"):
            named[pairs] = name
    faces = (_face(name, select_faces(mesh, name=name)) for name in named.values())
    ordered = sorted(faces, key=lambda face: -face.area)
    return PartOutline(low, high, volume, float(skin.areas.sum()), tuple(ordered), (*_sides(skin),))


def piece_count(mesh: Mesh) -> int:
    """How many bodies its cells make, joined through the nodes that they share."""
    ends = [np.broadcast_arrays(block[:, :1], block[:, 1:]) for _, _, block in mesh.blocks()]
    first, other = (np.concatenate([one[k].ravel() for one in ends]) for k in (0, 1))
    links = coo_matrix((np.ones(len(first)), (first, other)), shape=(mesh.node_count,) * 2)
    return int(connected_components(links, directed=False)[0]) - len(mesh.dangling_nodes)


def _sides(skin: Faces) -> Iterator[PartFace]:
    for axis, name in enumerate("xyz"):
        for sign, word in ((-1.0, f"-{name}"), (1.0, f"+{name}")):
            looking = skin[sign * skin.normals[:, axis] > np.cos(np.deg2rad(30.0))]  # as `where`
            yield _face(word, looking, sign * np.eye(3)[axis])


def _face(name: str, faces: Faces, normal: Float | None = None) -> PartFace:
    area = float(faces.areas.sum())
    centre = faces.areas @ faces.centroids / area if area else np.zeros(3)
    mean = faces.area_vectors.sum(axis=0) / area if area else np.zeros(3)
    if normal is None and float(np.linalg.norm(mean)) > 1.0 - _FLAT:
        normal = mean
    hollow = float(((faces.centroids - centre) * faces.area_vectors).sum()) < 0.0
    if normal is None:
        kind = _round(faces.points[faces.node_numbers()], hollow)
    else:
        axis = int(np.argmax(np.abs(normal)))
        level = abs(normal[axis]) > 1.0 - _FLAT
        way = f"{'+' if normal[axis] > 0.0 else '-'}{'xyz'[axis]}" if level else normal.round(3)
        kind = f"plane that looks {way}"
    return PartFace(name, kind, normal, centre, area)


def _round(points: Float, hollow: bool) -> str:
    """Words for a face through these points: a cylinder about x, y or z, or another one."""
    for axis, name in enumerate("xyz"):
        flat = np.delete(points, axis, axis=1)
        flat -= flat.mean(axis=0)
        # a circle by least squares: 2 a x + 2 b y + c = x^2 + y^2
        fit = np.c_[2.0 * flat, np.ones(len(flat))]
        (a, b, c), *_ = np.linalg.lstsq(fit, (flat**2).sum(axis=1), rcond=None)
        radius = float(np.sqrt(max(c + a * a + b * b, 0.0)))
        off = np.abs(np.hypot(flat[:, 0] - a, flat[:, 1] - b) - radius).max()
        if radius > 0.0 and off <= _CIRCULAR * radius:
            what = "hollow" if hollow else "round"
            return f"{what}, radius {1e3 * radius:.4g} mm about {name}"
    return "curved"
