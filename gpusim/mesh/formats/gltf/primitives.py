"""Triangles of glTF files, wherever nodes place them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.files.input_file import InputFile
from gpusim.mesh.formats.gltf.document import GltfDocument, gltf_document, whole

MOST_FACES = 10_000_000
"""Of a file, and as many points: a few bytes place a mesh once more."""

_TRIANGLES, _STRIP, _FAN = 4, 5, 6


@dataclass(frozen=True, eq=False)
class PlacedPrimitive:
    """A primitive: ``triangles`` (T, 3) of its ``points`` (P, 3), and the matrices ``places``
    (N, 4, 4) by which nodes place it."""

    primitive: dict[str, Any]
    name: str
    points: Float
    triangles: Long
    places: Float

    @property
    def corners(self) -> Long:
        """Corners (N, T, 3) of the triangles in each place; mirrored ones are turned over."""
        corners = np.repeat(self.triangles[None], len(self.places), axis=0)
        mirrored = np.linalg.det(self.places[:, :3, :3]) < 0.0
        corners[mirrored] = corners[mirrored][..., ::-1]
        return corners


def gltf_faces(file: InputFile) -> tuple[Float, Long]:
    """Points (P, 3) and faces (F, 4), the last column -1, of a file's scene.

    Raises InputError for a file that is damaged, asks for what isn't read, or has too many faces.
    """
    with gltf_document(file) as document:
        return joined_faces(placed_primitives(document))


def joined_faces(primitives: Iterable[PlacedPrimitive]) -> tuple[Float, Long]:
    """The points and faces of all primitives in all their places, as of `gltf_faces`."""
    points, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for one in primitives:
        turned = one.points @ one.places[:, :3, :3].transpose(0, 2, 1)
        points.append((turned + one.places[:, None, :3, 3]).reshape(-1, 3))
        first = count + len(one.points) * np.arange(len(one.places))
        faces.append((one.corners + first[:, None, None]).reshape(-1, 3))
        count += len(points[-1])
    triangles = np.concatenate(faces)
    return np.concatenate(points), np.column_stack([triangles, np.full(len(triangles), -1)])


def placed_primitives(document: GltfDocument) -> Iterator[PlacedPrimitive]:
    """Every primitive that the scene shows, in an order that stays; counted before any is read."""
    meshes = _places(document)
    faces = points = 0
    for number, places in meshes.items():
        for primitive in document.item("meshes", number)["primitives"]:
            count = document.count(primitive["attributes"]["POSITION"])
            points += len(places) * count
            count = document.count(primitive["indices"]) if "indices" in primitive else count
            listed = whole(primitive.get("mode", _TRIANGLES)) == _TRIANGLES
            faces += len(places) * (count // 3 if listed else count)
    if max(faces, points) > MOST_FACES:
        document.fail(
            f"got {faces:,} faces of {points:,} points, where nodes place them; expected at most "
            f"{MOST_FACES:,} of each"
        )
    for number, places in meshes.items():
        for place, primitive in enumerate(document.item("meshes", number)["primitives"]):
            name = f"meshes[{number}].primitives[{place}]"
            yield _placed(document, primitive, name, np.array(places))


def _places(document: GltfDocument) -> dict[int, list[Float]]:
    """Matrices (4, 4) of the nodes that show a mesh, by its number."""
    nodes, scenes = document.json.get("nodes", []), document.json.get("scenes", [])
    if scenes:
        roots = document.item("scenes", document.json.get("scene", 0)).get("nodes", [])
    else:
        inner = {child for node in nodes for child in node.get("children", ())}
        roots = [number for number in range(len(nodes)) if number not in inner]
    meshes: dict[int, list[Float]] = {}
    waiting = [(whole(root), np.eye(4)) for root in reversed(roots)]
    met: set[int] = set()
    while waiting:
        number, parent = waiting.pop()
        node, name = document.item("nodes", number), f"nodes[{number}]"
        if number in met:
            document.fail(f"{name} is met twice; expected a tree of nodes")
        met.add(number)
        document.refuse(node.get("extensions", ()), name, {"KHR_lights_punctual"})
        matrix = parent @ _matrix(node)
        if "mesh" in node:
            mesh = document.item("meshes", node["mesh"])
            if any(weight != 0 for weight in node.get("weights", mesh.get("weights", ()))):
                document.fail(f"{name}: weights of morph targets aren't read; expected 0")
            if "skin" in node:
                document.fail(f"{name}: a skin bends its mesh, which isn't read; expected none")
            meshes.setdefault(whole(node["mesh"]), []).append(matrix)
        waiting += [(whole(child), matrix) for child in reversed(node.get("children", []))]
    return meshes


def _matrix(node: dict[str, Any]) -> Float:
    """(4, 4): by its columns, or scale, then rotation (a quaternion x, y, z, w), then shift."""
    from scipy.spatial.transform import Rotation  # for one format

    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    result = np.eye(4)
    if "rotation" in node:
        result[:3, :3] = Rotation.from_quat(node["rotation"]).as_matrix()
    if "scale" in node:
        result[:3, :3] *= np.array(node["scale"], np.float64).reshape(3)
    if "translation" in node:
        result[:3, 3] = np.array(node["translation"], np.float64).reshape(3)
    return result


def _placed(
    document: GltfDocument, primitive: dict[str, Any], name: str, places: Float
) -> PlacedPrimitive:
    document.refuse(primitive.get("extensions", ()), name, {"KHR_materials_variants"})
    points = document.numbers(primitive["attributes"]["POSITION"], f"{name}, POSITION", {"VEC3"})
    if "indices" in primitive:
        index = document.numbers(primitive["indices"], f"{name}, indices", {"SCALAR"})[:, 0]
        if index.dtype.kind != "u" or index.max() >= len(points):
            document.fail(f"{name}, indices; got {index.max()}; expected 0 to {len(points) - 1}")
    else:
        index = np.arange(len(points))
    mode = whole(primitive.get("mode", _TRIANGLES))
    first = np.arange(len(index) - 2)
    if mode == _TRIANGLES and len(index) % 3 == 0:
        corners = np.arange(len(index)).reshape(-1, 3)
    elif mode == _STRIP:
        corners = np.column_stack([first, first + 1 + first % 2, first + 2 - first % 2])
    elif mode == _FAN:
        corners = np.column_stack([first + 1, first + 2, np.zeros_like(first)])
    else:
        document.fail(
            f"{name}; got mode {mode} with {len(index)} corners; expected triangles: mode 4 (with "
            "a multiple of 3), 5 or 6"
        )
    triangles = index.astype(np.int64)[corners]
    return PlacedPrimitive(primitive, name, points.astype(np.float64), triangles, places)
