"""Shapes in glTF files made by hand: what the format says, or one error that names the file."""

from __future__ import annotations

import base64
import json
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.mesh import read_surface, read_textured
from tests.support.gltf_files import SQUARE, TRIANGLES, GltfFile, glb, pictured, square


def bounds(path: Path) -> tuple[list[float], list[float]]:
    points, _ = read_surface(path)
    return points.min(axis=0).tolist(), points.max(axis=0).tolist()


def normals(path: Path) -> list[list[float]]:
    """Of the faces, times twice their areas."""
    points, faces = read_surface(path)
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.round(np.cross(b - a, c - a), 6).tolist()


@pytest.mark.parametrize("kind", ["i1", "u1", "<i2", "<u2"])
@pytest.mark.parametrize("normalized", [True, False])
def test_quantised_positions(kind: str, normalized: bool, tmp_path: Path) -> None:
    """The extension's formulas: c / 127, c / 255, c / 32767, c / 65535, or the number itself."""
    most = int(np.iinfo(kind).max)
    least = -most if kind in ("i1", "<i2") else 0
    file = GltfFile()
    points = np.array([[least, 0, 0], [most, 0, 0], [most, most, 0]], kind)
    one = file.primitive(index=None)
    one["attributes"]["POSITION"] = file.numbers(
        points, stride=4 * -(-3 * points.itemsize // 4), normalized=normalized
    )
    file.json["nodes"] = [{"mesh": 0, "scale": [0.5, 0.5, 0.5], "translation": [3, 0, 0]}]
    file.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    scale = 0.5 if normalized else 0.5 * most
    low, high = bounds(file.save(tmp_path / "q.glb"))
    np.testing.assert_allclose(low, [3.0 + scale * np.sign(least), 0, 0], atol=1e-12)
    np.testing.assert_allclose(high, [3.0 + scale, scale, 0], atol=1e-12)


def test_lists_strips_and_fans(tmp_path: Path) -> None:
    """Each covers the square once, wound alike; the strip goes round in a Z."""
    for mode, index in [
        (4, TRIANGLES), (5, np.array([0, 1, 3, 2], "u1")), (6, np.array([0, 1, 2, 3], "<u4")),
    ]:  # fmt: skip
        path = square(index=index, mode=mode).save(tmp_path / f"{mode}.glb")
        assert normals(path) == [[0, 0, 1], [0, 0, 1]], mode
    bare = square(points=SQUARE[[0, 1, 2]], index=None, uv=None)
    assert normals(bare.save(tmp_path / "bare.glb")) == [[0, 0, 1]]


def test_nodes_place_meshes(tmp_path: Path) -> None:
    """Scale, then turn, then shift, by parents too; a mirrored square still looks where it did."""
    file = square()
    half = np.sqrt(0.5)
    file.json["nodes"] = [
        {"translation": [10, 0, 0], "children": [1, 2]},
        {"mesh": 0, "rotation": [half, 0, 0, half], "scale": [2, 4, 1]},  # a quarter about x
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 3, 0, 0, 0, 0, 1, 0, 5, 0, 7, 1]},
        {"mesh": 0, "translation": [1000, 0, 0]},  # of no scene
    ]
    path = file.save(tmp_path / "a.glb")
    low, high = bounds(path)
    np.testing.assert_allclose(low, [9, -1.5, -2], atol=1e-7)
    np.testing.assert_allclose(high, [15.5, 1.5, 7], atol=1e-7)
    # y goes to z, so that z, where the square looked, goes to -y
    np.testing.assert_allclose(normals(path), 2 * [[0, -8, 0]] + 2 * [[0, 0, 3]], atol=1e-5)
    del file.json["scenes"], file.json["scene"]
    assert bounds(file.save(tmp_path / "b.glb"))[1][0] == 1000.5


def test_interleaved_numbers_and_other_files(tmp_path: Path) -> None:
    """Strides; buffers in data URIs and in files, whose names are percent-encoded."""
    file = GltfFile()
    one = file.primitive()
    one["attributes"]["POSITION"] = file.numbers(SQUARE, stride=20)
    file.save(tmp_path / "a.glb")
    (tmp_path / "träger 1.bin").write_bytes(file.data + b"more")
    encoded = base64.b64encode(file.data).decode()
    for uri in ("tr%C3%A4ger%201.bin", "träger 1.bin", f"data:application/gltf;base64,{encoded}"):
        file.json["buffers"] = [{"byteLength": len(file.data), "uri": uri}]
        (tmp_path / "a.gltf").write_text(json.dumps(file.json))
        for name in ("a.glb", "a.gltf"):
            assert bounds(tmp_path / name) == ([-0.5, -0.5, 0], [0.5, 0.5, 0]), uri


Change = Callable[[GltfFile], Any]
REFUSED: dict[str, tuple[Change, str]] = {
    "Draco": (
        lambda f: f.json["meshes"][0]["primitives"][0].update(
            extensions={"KHR_draco_mesh_compression": {"bufferView": 0}}
        ),
        r"meshes\[0\].primitives\[0\]: got 'KHR_draco_mesh_compression', which gpusim doesn't read",
    ),
    "instances": (
        lambda f: f.json["nodes"][0].update(extensions={"EXT_mesh_gpu_instancing": {}}),
        r"nodes\[0\]: got 'EXT_mesh_gpu_instancing'",
    ),
    "meshopt": (
        lambda f: f.json["bufferViews"][0].update(extensions={"EXT_meshopt_compression": {}}),
        r"bufferViews\[0\]: got 'EXT_meshopt_compression'",
    ),
    "sparse": (
        lambda f: f.json["accessors"][0].update(sparse={"count": 1}), "POSITION; got a sparse"
    ),
    "zeros": (lambda f: f.json["accessors"][0].pop("bufferView"), "POSITION; got a sparse acc"),
    "required": (
        lambda f: f.json.update(extensionsRequired=["XX_unknown", "KHR_texture_transform"]),
        "extensionsRequired: got 'XX_unknown'",
    ),
    "morph": (
        lambda f: f.json["meshes"][0].update(weights=[0, 0.5]),
        r"nodes\[0\]: weights of morph targets",
    ),
    "morph of a node": (
        lambda f: f.json["nodes"][0].update(weights=[1]),
        r"nodes\[0\]: weights of morph targets",
    ),
    "skin": (lambda f: f.json["nodes"][0].update(skin=0), r"nodes\[0\]: a skin"),
    "lines": (
        lambda f: f.json["meshes"][0]["primitives"][0].update(mode=1),
        r"got mode 1 with 6 corners; expected triangles",
    ),
    "version": (
        lambda f: f.json.update(asset={"version": "1.0"}), "version '1.0', at least '2.0'; exp"
    ),
    "least version": (
        lambda f: f.json["asset"].update(minVersion="3.0"), "version '2.0', at least '3.0'"
    ),
    "index": (
        lambda f: f.json["meshes"][0]["primitives"][0].update(
            indices=f.numbers(np.array([0, 1, 4], "<u2"))
        ),
        "indices; got 4; expected 0 to 3",
    ),
    "a node twice": (
        lambda f: f.json.update(nodes=[{"children": [1, 1]}, {"mesh": 0}]),
        r"nodes\[1\] is met twice",
    ),
    "a circle": (
        lambda f: f.json.update(nodes=[{"children": [1]}, {"children": [0]}]),
        r"nodes\[0\] is met twice",
    ),
    "a node that isn't there": (
        lambda f: f.json.update(nodes=[{"children": [-1]}]), "number -1 of nodes; got 1, from 0"
    ),
    "view beyond": (
        lambda f: f.json["bufferViews"][0].update(byteLength=10**9),
        r"bufferViews\[0\]; got 1000000000 bytes from 0 on, of a buffer of 92",
    ),
    "negative view": (
        lambda f: f.json["bufferViews"][0].update(byteLength=-4), r"bufferViews\[0\]; got -4 bytes"
    ),
    "negative offset": (
        lambda f: f.json["bufferViews"][0].update(byteOffset=-4), "got 48 bytes from -4 on"
    ),
    "stride too small": (
        lambda f: f.json["bufferViews"][0].update(byteStride=4), "4 elements of 12 bytes, 4 apart"
    ),
    "stride too large": (
        lambda f: f.json["bufferViews"][0].update(byteStride=252), "252 apart, from byte 0 to 768"
    ),
    "type": (lambda f: f.json["accessors"][0].update(type="VEC2"), "POSITION; got 'VEC2'"),
    "half a number": (lambda f: f.json["accessors"][0].update(count=3.5), "'3.5' where a whole"),
    "no numbers": (lambda f: f.json["accessors"][0].update(count=0), "got 0 elements"),
    "words": (lambda f: f.json.update(nodes="abc"), "damaged, or no glTF"),
    "no positions": (
        lambda f: f.json["meshes"][0]["primitives"][0].update(attributes={}), "POSITION"
    ),
    "too large": (
        lambda f: f.json["nodes"][0].update(scale=[1e300, 1, 1]), "a coordinate isn't finite"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_would_change_the_shape_is_refused(name: str, tmp_path: Path) -> None:
    change, words = REFUSED[name]
    file = square()
    change(file)
    path = file.save(tmp_path / "a.glb")
    with pytest.raises(InputError, match=words) as caught:
        read_surface(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_damaged_containers(tmp_path: Path) -> None:
    good = square().glb()
    text = json.dumps(square().json).encode()
    data = b"data:application/octet-stream;base64,"
    cases = {
        b"glTF" + (1).to_bytes(4, "little") + good[8:]: "got version 1 of binary glTF; expected 2",
        good[:-40]: f"got {len(good) - 40} bytes; expected {len(good)}: cut off",
        good[:6]: "damaged, or no glTF",
        glb("Träger".encode("latin-1"), b""): "got byte 2 that is no UTF-8",
        glb(b"[" * 100_000, b""): "damaged, or no glTF; got RecursionError",
        glb(b'{"asset": {"version": "2.0"}}', b""): "no triangles",
        glb(text[:-1] + b', "buffers": [{"byteLength": 93}]}', square().data): "byteLength; got 93",
        glb(text[:-1] + b', "buffers": [{"byteLength": -1}]}', square().data): "byteLength; got -1",
        text[:-1] + b', "buffers": [{"byteLength": 92, "uri": "' + data + b'AAAA"}]}':
            r"buffers\[0\].byteLength; got 92, of 3 bytes",
        text[:-1] + b', "buffers": [{"byteLength": 92, "uri": "' + data + b'A"}]}': "damaged",
        text[:-1] + b', "buffers": [{"byteLength": 92, "uri": "away.bin"}]}': r"away\.bin: not f",
    }  # fmt: skip
    for content, words in cases.items():
        path = tmp_path / "a.glb"
        path.write_bytes(content)
        with pytest.raises(InputError, match=words) as caught:
            read_surface(path)
        assert str(tmp_path) in str(caught.value)


def test_many_nodes_are_read_at_once(tmp_path: Path) -> None:
    """30,000 nodes in a chain, each with the square."""
    file = square()
    file.json["nodes"] = [
        {"mesh": 0, "translation": [0, 0, 1], "children": [n + 1]} for n in range(30_000)
    ]
    del file.json["nodes"][-1]["children"]
    path = file.save(tmp_path / "a.glb")
    began = time.monotonic()
    points, faces = read_surface(read_input(path))
    assert len(points) == 120_000 and len(faces) == 60_000 and points[:, 2].max() == 30_000.0
    assert time.monotonic() - began < 20.0  # 1.5 s on two cores


@pytest.mark.parametrize("kind", ["faces", "points", "zeros"])
def test_faces_are_counted_before_they_are_made(kind: str, tmp_path: Path) -> None:
    """20,000 nodes of a mesh of 10,000 faces: 2e8; zeros cost a file nothing."""
    file = square()
    one, words = file.json["meshes"][0]["primitives"][0], "got 200,000,000 faces of 80,000 points"
    if kind == "faces":
        one["indices"] = file.numbers(np.tile(TRIANGLES, 5000))
    elif kind == "points":
        one["attributes"] = {"POSITION": file.numbers(np.tile(SQUARE, (1000, 1)))}
        words = "got 40,000 faces of 80,000,000 points"
    else:
        del file.json["accessors"][one["indices"]]["bufferView"]
        file.json["accessors"][one["indices"]]["count"] = 30_000_000_000
        words = "got 200,000,000,000,000 faces"
    file.json["nodes"] = [{"mesh": 0} for _ in range(20_000)]
    file.json["scenes"] = [{"nodes": list(range(20_000))}]
    path = file.save(tmp_path / "a.glb")
    tracemalloc.start()
    with pytest.raises(InputError, match=f"{words}.*expected at most 10,000,000"):
        read_surface(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6


def places_in(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where in a JSON there is a value."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    inner = [places_in(v, (*at, k)) for k, v in items if isinstance(v, dict | list)]
    keys = value if isinstance(value, dict) else range(len(value))
    return [(*at, key) for key in keys] + [place for found in inner for place in found]


@pytest.mark.parametrize(
    "value", [None, -1, 7, 0.5, 1e300, 10**400, float("nan"), True, "", "\x1b[2J", [], [[]], {}],
    ids=lambda value: repr(value)[:8],
)  # fmt: skip
def test_any_value_may_be_wrong(value: Any, tmp_path: Path) -> None:
    """Each value of the JSON in turn: a surface, or one error that names the file."""
    whole, path = pictured(), tmp_path / "a.glb"
    one = whole.json["meshes"][0]["primitives"][0]
    one["attributes"]["COLOR_0"] = whole.numbers(np.tile([0.5, 1, 1], (4, 1)).astype("<f4"))
    texture = whole.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    transform = {"offset": [0, 1], "rotation": 0.5, "scale": [2, 1], "texCoord": 0}
    texture["extensions"] = {"KHR_texture_transform": transform}
    whole.json["nodes"] = [
        {"children": [1], "rotation": [0, 0, 0, 1], "scale": [1, 2, 1], "translation": [1, 0, 0]},
        {"mesh": 0, "matrix": np.eye(4).ravel().tolist()},
    ]
    whole.json["extensionsRequired"] = ["KHR_texture_transform"]
    whole.json["buffers"] = [{"byteLength": len(whole.data)}]
    text = json.dumps(whole.json)
    path.write_bytes(glb(text.encode(), whole.data))
    assert len(read_textured(path).faces) == 2
    for *way, key in places_in(whole.json):
        document = json.loads(text)
        inner = document
        for step in way:
            inner = inner[step]
        inner[key] = value
        path.write_bytes(glb(json.dumps(document).encode(), whole.data))
        try:
            read_textured(path)
        except InputError as error:
            assert str(error).startswith(f"{path}: ") and "\x1b" not in str(error)
            assert len(str(error)) < 600
