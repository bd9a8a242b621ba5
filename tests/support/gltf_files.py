"""glTF files made by hand: a square of 1 m, with a picture of four colours if one is wanted."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

Array = npt.NDArray[Any]
SQUARE = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]], "<f4")
CORNERS = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")
"""Texture coordinates of SQUARE, v downwards, by which a picture stands upright on it."""
TRIANGLES = np.array([0, 1, 2, 0, 2, 3], "<u2")
RED, GREEN, BLUE, WHITE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)
_CODES = {"|i1": 5120, "|u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125, "<f4": 5126}


def png(pixels: Array) -> bytes:
    """A file of (H, W) or (H, W, 3) of 8 or 16 bits."""
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "png")
    return data.getvalue()


def four_colors(side: int = 32) -> Array:
    """Red and green above blue and white."""
    rows = np.array([[RED, GREEN], [BLUE, WHITE]]) * 255
    return np.repeat(np.repeat(rows, side, axis=0), side, axis=1).astype(np.uint8)


class GltfFile:
    """JSON and one buffer, to be changed by hand before it is written."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}], "meshes": [{"primitives": []}], "accessors": [],
            "bufferViews": [],
        }  # fmt: skip
        self.data = b""

    def view(self, data: bytes, **more: Any) -> int:
        """The number of a new buffer view."""
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more}
        self.json["bufferViews"].append(view)
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def numbers(self, values: Array, stride: int = 0, **more: Any) -> int:
        """The number of a new accessor, of rows ``stride`` bytes apart."""
        columns = values.reshape(len(values), -1)
        size = columns.shape[1] * columns.itemsize
        rows = [row.tobytes() + b"\xff" * (stride - size) for row in columns]
        view = self.view(b"".join(rows), **({"byteStride": stride} if stride else {}))
        kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][columns.shape[1] - 1]
        accessor = {"bufferView": view, "componentType": _CODES[values.dtype.str], "type": kind}
        self.json["accessors"].append({**accessor, "count": len(values), **more})
        return len(self.json["accessors"]) - 1

    def primitive(
        self, points: Array = SQUARE, index: Array | None = TRIANGLES, **more: Any
    ) -> Any:
        """A new primitive of the only mesh."""
        one: dict[str, Any] = {"attributes": {"POSITION": self.numbers(points)}, **more}
        if index is not None:
            one["indices"] = self.numbers(index)
        self.json["meshes"][0]["primitives"].append(one)
        return one

    def picture(self, data: bytes, **sampler: Any) -> dict[str, Any]:
        """The texture of a picture that lies in the file, for a material."""
        image = {"bufferView": self.view(data), "mimeType": "image/png"}
        self.json |= {"images": [image], "samplers": [sampler]}
        self.json["textures"] = [{"source": 0, "sampler": 0}]
        return {"index": 0}

    def glb(self) -> bytes:
        """As binary glTF."""
        self.json["buffers"] = [{"byteLength": len(self.data)}]
        return glb(json.dumps(self.json).encode(), self.data)

    def save(self, path: Path) -> Path:
        """Write a .glb; returns its path."""
        path.write_bytes(self.glb())
        return path


def glb(text: bytes, data: bytes) -> bytes:
    """The container of binary glTF."""
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def square(
    base: dict[str, Any] | None = None, uv: Array | None = CORNERS, **primitive: Any
) -> GltfFile:
    """The square, of a material with this ``pbrMetallicRoughness``."""
    file = GltfFile()
    one = file.primitive(**primitive)
    if uv is not None:
        one["attributes"]["TEXCOORD_0"] = file.numbers(uv)
    if base is not None:
        file.json["materials"] = [{"name": "paint", "pbrMetallicRoughness": base}]
        one["material"] = 0
    return file


def pictured(
    texture: dict[str, Any] | None = None, uv: Array | None = CORNERS,
    picture: bytes | None = None, **sampler: Any,
) -> GltfFile:  # fmt: skip
    """The square with the picture of four colours, and what else its ``texture`` says."""
    file = square({}, uv)
    described = file.picture(png(four_colors()) if picture is None else picture, **sampler)
    file.json["materials"][0]["pbrMetallicRoughness"] = {
        "baseColorTexture": {**described, **(texture or {})}
    }
    return file
