"""A glTF file's JSON, and the numbers and bytes that its buffers hold."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Set
from contextlib import contextmanager
from typing import Any, NoReturn
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile

__all__ = ["GltfDocument", "gltf_document", "whole"]

# extensions that a file may require: they are read, or say nothing of shape and base colour
_READ = {
    "KHR_lights_punctual",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
}
_COMPONENTS: dict[int, np.dtype[Any]] = {
    5120: np.dtype("i1"), 5121: np.dtype("u1"), 5122: np.dtype("<i2"), 5123: np.dtype("<u2"),
    5125: np.dtype("<u4"), 5126: np.dtype("<f4"),
}  # fmt: skip
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@contextmanager
def gltf_document(file: InputFile) -> Iterator[GltfDocument]:
    """The document in a .gltf or .glb; whatever goes wrong meanwhile is the file's fault.

    Raises InputError that names the file.
    """
    try:
        yield GltfDocument(file)
    except InputError:
        raise
    except (
        ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError, TypeError,
        ValueError,
    ) as error:  # fmt: skip
        reason = " ".join(repr(str(error))[1:-1].split())[:200]
        raise InputError(
            f"{file.path}: damaged, or no glTF; got {type(error).__name__}: {reason}"
        ) from None


def whole(number: Any) -> int:
    """A whole number of the JSON, which may be written as 2.0; raises ValueError for another."""
    if not isinstance(number, int | float) or number != int(number):
        raise ValueError(f"{str(number)[:40]!r} where a whole number is expected")
    return int(number)


class GltfDocument:
    """A file that is glTF 2.0 and requires nothing that isn't read; its objects by number."""

    def __init__(self, file: InputFile) -> None:
        self.file = file
        text, self._chunk = self._container()
        self.json: dict[str, Any] = json.loads(InputFile(file.path, text).text("JSON in UTF-8"))
        self._buffers: dict[int, memoryview] = {}
        asset = self.json["asset"]
        for key, version in (
            ("version", asset["version"]),
            ("minVersion", asset.get("minVersion")),
        ):
            if version is not None and not str(version).startswith("2."):
                self.fail(f"asset.{key}; got {str(version)[:40]!r}; expected '2.0'")
        self._refuse(set(self.json.get("extensionsRequired", ())) - _READ, "extensionsRequired")

    def fail(self, problem: str) -> NoReturn:
        raise InputError(f"{self.file.path}: {problem}")

    def refuse_extensions(self, thing: dict[str, Any], name: str, read: Set[str]) -> None:
        """Refuse an object with other extensions than those that are ``read``, or mean nothing."""
        self._refuse(thing.get("extensions", {}).keys() - read, name)

    def _refuse(self, extensions: Set[str], name: str) -> None:
        if extensions:
            self.fail(
                f"{name}: got {', '.join(sorted(extensions))[:200]!r}, which gpusim doesn't read; "
                "expected a file saved without"
            )

    def _container(self) -> tuple[bytes, bytes | None]:
        """The JSON of a .gltf or of a .glb's first chunk, and the chunk of binary data."""
        data = self.file.data
        if data[:4] != b"glTF":
            return data, None
        version, length = (int.from_bytes(data[at : at + 4], "little") for at in (4, 8))
        if version != 2:
            self.fail(f"got version {version} of binary glTF; expected 2")
        chunks: dict[bytes, bytes] = {}
        begin = 12
        while begin + 8 <= length:
            end = begin + 8 + int.from_bytes(data[begin : begin + 4], "little")
            if end > len(data):
                self.fail(f"got {len(data)} bytes; expected {max(end, length)}: cut off")
            chunks.setdefault(data[begin + 4 : begin + 8], data[begin + 8 : end])
            begin = end
        return chunks.get(b"JSON", b""), chunks.get(b"BIN\0")

    def item(self, kind: str, number: Any) -> dict[str, Any]:
        """The object of that number in the list ``kind``: "nodes", "accessors" …"""
        items, place = self.json.get(kind, []), whole(number)
        if not 0 <= place < len(items):
            self.fail(f"names number {place} of {kind}; got {len(items)}, from 0")
        thing: dict[str, Any] = items[place]
        return thing

    def bytes_of(self, uri: str) -> bytes | None:
        """What a data URI holds; None for the name of a file."""
        head, _, body = uri.partition(",")
        if not head.startswith("data:"):
            return None
        return base64.b64decode(body) if head.endswith(";base64") else unquote_to_bytes(body)

    def view(self, number: Any) -> memoryview:
        """The bytes of a buffer view."""
        view = self.item("bufferViews", number)
        name = f"bufferViews[{whole(number)}]"
        self.refuse_extensions(view, name, set())
        data = self._buffer(whole(view["buffer"]))
        begin, length = whole(view.get("byteOffset", 0)), whole(view["byteLength"])
        if not 0 <= begin <= begin + length <= len(data):
            self.fail(f"{name}; got {length} bytes from {begin} on, of a buffer of {len(data)}")
        return data[begin : begin + length]

    def _buffer(self, number: int) -> memoryview:
        if number not in self._buffers:
            buffer, name = self.item("buffers", number), f"buffers[{number}]"
            self.refuse_extensions(buffer, name, set())
            uri = buffer.get("uri")
            data = self._chunk if number == 0 and uri is None else self.bytes_of(uri or "")
            if data is None and uri:
                data = self.file.beside(unquote(uri), "a glTF file's buffer").data
            length = whole(buffer["byteLength"])
            if data is None or not 0 <= length <= len(data):
                self.fail(f"{name}.byteLength; got {length}, of {len(data or b'')} bytes")
            self._buffers[number] = memoryview(data)[:length]
        return self._buffers[number]

    def count(self, number: Any) -> int:
        """How many elements an accessor has."""
        count = whole(self.item("accessors", number)["count"])
        if count < 1:
            self.fail(f"accessors[{whole(number)}]; got {count} elements; expected some")
        return count

    def numbers(self, number: Any, name: str, types: Set[str]) -> npt.NDArray[Any]:
        """An accessor's elements (n, columns), integers or floats; ``name`` is what they are for.

        Those that are normalised lie in -1 to 1.
        """
        accessor = self.item("accessors", number)
        self.refuse_extensions(accessor, name, set())
        if accessor["type"] not in types:
            self.fail(f"{name}; got {str(accessor['type'])[:40]!r}; expected {sorted(types)}")
        kind, columns = _COMPONENTS[whole(accessor["componentType"])], _COLUMNS[accessor["type"]]
        shape = self.count(number), columns
        values: npt.NDArray[Any] = np.zeros(shape, kind)
        if "bufferView" in accessor:
            values = self._elements(accessor, name, kind, shape)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            count, places = whole(sparse["count"]), sparse["indices"]
            rows = self._elements(
                places, name, _COMPONENTS[whole(places["componentType"])], (count, 1)
            )
            values = values.copy()
            values[rows[:, 0]] = self._elements(sparse["values"], name, kind, (count, columns))
        if accessor.get("normalized"):
            values = np.maximum(values / float(np.iinfo(kind).max), -1.0)
        return values

    def _elements(
        self, place: dict[str, Any], name: str, kind: np.dtype[Any], shape: tuple[int, int]
    ) -> npt.NDArray[Any]:
        data, size = self.view(place["bufferView"]), kind.itemsize * shape[1]
        stride = whole(self.item("bufferViews", place["bufferView"]).get("byteStride", 0)) or size
        begin = whole(place.get("byteOffset", 0))
        end = begin + stride * (shape[0] - 1) + size
        if begin < 0 or stride < size or end > len(data):
            self.fail(
                f"{name}; got {shape[0]} elements of {size} bytes, {stride} apart, from byte "
                f"{begin} to {end} of {len(data)}; expected them within"
            )
        return np.ndarray(shape, kind, data, begin, (stride, kind.itemsize))
