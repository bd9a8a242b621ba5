"""A glTF file's JSON, and the numbers and bytes that its buffers hold."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Set
from contextlib import contextmanager
from typing import Any, NoReturn
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.mesh.file_content.faults import file_faults

# extensions that a file may require: they are read, or say nothing of shape and base colour
_READ = {
    "KHR_lights_punctual", "KHR_materials_pbrSpecularGlossiness", "KHR_materials_unlit",
    "KHR_materials_variants", "KHR_mesh_quantization", "KHR_texture_transform",
}  # fmt: skip
_COMPONENTS: dict[int, np.dtype[Any]] = {
    5120: np.dtype("i1"), 5121: np.dtype("u1"), 5122: np.dtype("<i2"), 5123: np.dtype("<u2"),
    5125: np.dtype("<u4"), 5126: np.dtype("<f4"),
}  # fmt: skip
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@contextmanager
def gltf_document(file: InputFile) -> Iterator[GltfDocument]:
    """The document in a .gltf or .glb; whatever goes wrong meanwhile is the file's fault.

    Numbers out of range become infinite, which is looked for in every file. Raises InputError that
    names the file.
    """
    with file_faults(file, "glTF"), np.errstate(all="ignore"):
        yield GltfDocument(file)


def whole(number: Any) -> int:
    """A whole number of the JSON, which may be written as 2.0; raises ValueError for another."""
    fits = isinstance(number, int | float) and abs(number) <= 2**53
    if not fits or number != int(number):
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
        version, least = str(asset["version"])[:40], str(asset.get("minVersion", "2.0"))[:40]
        if not version.startswith("2.") or least != "2.0":
            self.fail(f"glTF of version {version!r}, at least {least!r}; expected '2.0'")
        self.refuse(self.json.get("extensionsRequired", ()), "extensionsRequired", _READ)

    def fail(self, problem: str) -> NoReturn:
        raise InputError(f"{self.file.path}: {problem}")

    def refuse(self, extensions: Iterable[str], name: str, read: Set[str] = frozenset()) -> None:
        """Refuse other extensions than those that are ``read``, or mean nothing here."""
        if unread := sorted(set(extensions) - read):
            self.fail(
                f"{name}: got {', '.join(unread)[:200]!r}, which gpusim doesn't read; expected a "
                "file saved without"
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
        self.refuse(view.get("extensions", ()), name)
        data = self._buffer(whole(view["buffer"]))
        begin, length = whole(view.get("byteOffset", 0)), whole(view["byteLength"])
        if not 0 <= begin <= begin + length <= len(data):
            self.fail(f"{name}; got {length} bytes from {begin} on, of a buffer of {len(data)}")
        return data[begin : begin + length]

    def _buffer(self, number: int) -> memoryview:
        if number not in self._buffers:
            buffer, name = self.item("buffers", number), f"buffers[{number}]"
            self.refuse(buffer.get("extensions", ()), name)
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
        self.refuse(accessor.get("extensions", ()), name)
        if accessor["type"] not in types:
            self.fail(f"{name}; got {str(accessor['type'])[:40]!r}; expected {sorted(types)}")
        if "sparse" in accessor or "bufferView" not in accessor:
            self.fail(f"{name}; got a sparse accessor, or one without data; expected plain data")
        kind, columns = _COMPONENTS[whole(accessor["componentType"])], _COLUMNS[accessor["type"]]
        place, count, size = accessor["bufferView"], self.count(number), kind.itemsize * columns
        data = self.view(place)
        stride = whole(self.item("bufferViews", place).get("byteStride", 0)) or size
        begin = whole(accessor.get("byteOffset", 0))
        end = begin + stride * (count - 1) + size
        if begin < 0 or stride < size or end > len(data):
            self.fail(
                f"{name}; got {count} elements of {size} bytes, {stride} apart, from byte {begin} "
                f"to {end} of {len(data)}; expected them within"
            )
        values: npt.NDArray[Any] = np.ndarray(
            (count, columns), kind, data, begin, (stride, kind.itemsize)
        )
        if accessor.get("normalized"):
            values = np.maximum(values / float(np.iinfo(kind).max), -1.0)
        return values
