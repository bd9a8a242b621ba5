"""Base colours of glTF files' materials, their pictures, and how these lie on the triangles."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.files.input_file import InputFile
from gpusim.mesh.formats.gltf.document import GltfDocument, gltf_document, whole
from gpusim.mesh.formats.gltf.primitives import (
    PlacedPrimitive,
    joined_faces,
    placed_primitives,
)

Look = dict[str, Any]
"""Fields of a `gpusim.mesh.formats.textures.FileMaterial`."""

MOST_LOOKS = 1000
"""Materials, or colours of vertices: each becomes a paint."""

_WRAPS = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
_GLOSS, _TRANSFORM = "KHR_materials_pbrSpecularGlossiness", "KHR_texture_transform"


def textured_gltf(file: InputFile) -> tuple[Float, Long, Float, Int, list[Look]]:
    """Points and faces of `gltf_faces`, with how they look.

    Behind them texture coordinates (F, 3, 2) from the picture's lower left corner, NaN where there
    are none, which look (F,) each face has, -1 none, and the looks. Raises InputError as
    `gltf_faces`.
    """
    places, numbers = [np.zeros((0, 3, 2))], [np.zeros(0, np.int32)]
    looks: list[Look] = []
    known: dict[tuple[float | None, ...], int] = {}
    pictures: dict[int | None, Look] = {}
    with gltf_document(file) as document:
        primitives = list(placed_primitives(document))
        for one in primitives:
            number = one.primitive.get("material")
            material = {} if number is None else document.item("materials", number)
            factor, texture = _base_color(document, material, number)
            places.append(_coordinates(document, one, texture)[one.corners].reshape(-1, 3, 2))
            tints, which = _tints(document, one)
            chosen = np.full(len(tints), -1, np.int32)
            plain = number is None and "COLOR_0" not in one.primitive["attributes"]
            for row, tint in enumerate(tints.tolist() if not plain else ()):
                key = number, *tint
                if key not in known:
                    known[key] = len(looks)
                    name = str(material.get("name") or f"material-{number or 0}")
                    color = tuple((factor * tint).tolist())
                    if number not in pictures:
                        pictures[number] = _picture(document, texture)
                    looks.append({"name": name, "color": color, **pictures[number]})
                chosen[row] = known[key]
            if len(looks) > MOST_LOOKS:
                document.fail(
                    f"got more than {MOST_LOOKS} materials and colours of vertices; expected fewer"
                )
            numbers.append(np.tile(chosen[which], len(one.places)))
        points, faces = joined_faces(primitives)
    return points, faces, np.concatenate(places), np.concatenate(numbers), looks


def _base_color(
    document: GltfDocument, material: dict[str, Any], number: Any
) -> tuple[Float, dict[str, Any]]:
    """Red, green and blue (3,), and the description of the texture, if there is one."""
    gloss = material.get("extensions", {}).get(_GLOSS)
    model, kind = material.get("pbrMetallicRoughness", {}), "baseColor"
    if gloss is not None:
        model, kind = gloss, "diffuse"
    factor = np.array(model.get(f"{kind}Factor", [1.0, 1.0, 1.0, 1.0]), np.float64)
    if factor.shape != (4,) or not ((factor >= 0.0) & (factor <= 1.0)).all():
        document.fail(f"materials[{number}], {kind}Factor; got {factor}; expected 4 from 0 to 1")
    return factor[:3], model.get(f"{kind}Texture", {})


def _attribute(
    document: GltfDocument, one: PlacedPrimitive, kind: str, types: set[str]
) -> npt.NDArray[Any] | None:
    """An attribute of a primitive's points (P, columns), if it has it."""
    number = one.primitive["attributes"].get(kind)
    if number is None:
        return None
    name, count = f"{one.name}, {kind}", document.count(number)
    if count != len(one.points):
        document.fail(f"{name}; got {count} for {len(one.points)} points")
    return document.numbers(number, name, types)


def _tints(document: GltfDocument, one: PlacedPrimitive) -> tuple[Float, Long]:
    """Different colours of vertices (n, 3), and which (T,) of them a triangle has."""
    colors = _attribute(document, one, "COLOR_0", {"VEC3", "VEC4"})
    if colors is None:
        return np.ones((1, 3)), np.zeros(len(one.triangles), np.int64)
    corners = np.clip(colors[:, :3].astype(np.float64), 0.0, 1.0)[one.triangles]
    if not (corners == corners[:, :1]).all():
        document.fail(
            f"{one.name}, COLOR_0: colours that change within a triangle aren't read; expected one "
            "for the three corners of each, or a picture"
        )
    tints, which = np.unique(corners[:, 0], axis=0, return_inverse=True)
    return tints, which.reshape(-1)


def _coordinates(document: GltfDocument, one: PlacedPrimitive, texture: dict[str, Any]) -> Float:
    """Texture coordinates of a primitive's points (P, 2); glTF's v runs downwards."""
    extensions = texture.get("extensions", {})
    document.refuse(extensions, f"{one.name}, its texture", {_TRANSFORM})
    transform = extensions.get(_TRANSFORM, {})
    kind = whole(transform.get("texCoord", texture.get("texCoord", 0)))
    uv = _attribute(document, one, f"TEXCOORD_{kind}", {"VEC2"})
    if uv is None:
        return np.full((len(one.points), 2), np.nan)
    scale, offset = (
        np.array(transform.get(key, [without] * 2), np.float64).reshape(2)
        for key, without in (("scale", 1.0), ("offset", 0.0))
    )
    angle = float(transform.get("rotation", 0.0))
    # counter-clockwise as seen, with v downwards: the extension's own listing has it reversed
    # (glTF issue 1563), its example and implementations don't
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    result: Float = (uv * scale) @ turn.T + offset
    result[:, 1] = 1.0 - result[:, 1]
    return result


def _picture(document: GltfDocument, texture: dict[str, Any]) -> Look:
    """The picture of a texture, and how it goes on beyond its sides."""
    if not texture:
        return {}
    entry = document.item("textures", texture["index"])
    sampler = document.item("samplers", entry["sampler"]) if "sampler" in entry else {}
    wrap = tuple(_WRAPS[whole(sampler.get(key, 10497))] for key in ("wrapS", "wrapT"))
    source = entry.get("source")
    for extension in entry.get("extensions", {}).values():  # another kind of file, if it is alone
        source = extension.get("source") if source is None else source
    image = document.item("images", source)
    uri = image.get("uri", "")
    data = document.view(image["bufferView"]) if "bufferView" in image else document.bytes_of(uri)
    if data is not None:
        path = Path(f"{document.file.path}, image {whole(source)}")
        return {"picture": InputFile(path, bytes(data)), "wrap": wrap}
    name = unquote(uri)
    if not os.path.isfile(document.file.path.parent / name):
        return {"missing": name or "a picture without a name"}
    return {"picture": document.file.beside(name, "a picture"), "wrap": wrap}
