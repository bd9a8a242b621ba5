"""How glTF files look: pictures, colours, and how they lie, as the format says."""

from __future__ import annotations

import io
import json
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image as Pillow

import gpusim as gs
from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.mesh import read_textured
from gpusim.pipeline.scene_objects.surfaces import build_prop
from gpusim.scene import Scene
from gpusim.view.content.loading import load_content
from tests.support.gltf_files import (
    BLUE,
    CORNERS,
    GREEN,
    RED,
    SQUARE,
    WHITE,
    GltfFile,
    four_colors,
    pictured,
    png,
    square,
)  # fmt: skip

YELLOW = (1.0, 1.0, 0.0)
UPRIGHT = [[RED, GREEN], [BLUE, WHITE]]


def prop_of(path: Path, *paints: dict[str, Any], **more: Any) -> dict[str, Any]:
    base = {"type": "image", "mapping": "uv", "albedo": 0.5}
    painted = [{**base, **paint} for paint in paints or ({"name": "look"},)]
    more |= {"unit": "m"} if path.suffix == ".obj" else {}
    return {"name": "p", "type": "mesh", "file": str(path), "paint": painted, **more}


def scene_of(prop: dict[str, Any]) -> Scene:
    camera = {
        "name": "c", "sensor_mm": [10.0, 10.0], "resolution_px": [64, 64], "focal_mm": 10.0,
        "position_mm": [0.0, 0.0, 1000.0], "target_mm": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0],
    }  # fmt: skip
    return Scene.from_document({"schema": 1, "name": "t", "camera": [camera], "prop": [prop]})


def surface_of(path: Path, *paints: dict[str, Any]) -> gs.Surface:
    scene = scene_of(prop_of(path, *paints))
    return build_prop(scene.props[0], scene.input)


def seen(path: Path, n: int, *paints: dict[str, Any]) -> npt.NDArray[Any]:
    """Radiance (n, n, 3) at the middles of n x n fields of the square, which fills the picture."""
    eye, target, up = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    camera = gs.Camera.from_lens((0.01, 0.01), 0.01, (16 * n, 16 * n), eye, target, up)
    radiance = gs.render([surface_of(path, *paints)], camera).radiance
    if radiance.ndim == 2:
        radiance = np.repeat(radiance[..., None], 3, axis=2)
    return np.asarray(radiance[8::16, 8::16], np.float64)


def strips(folder: Path, colors: list[Any], names: list[str]) -> Path:
    """Upright strips from left to right, each of a material of its own."""
    file, count = GltfFile(), len(colors)
    file.json["materials"] = []
    for number, (color, name) in enumerate(zip(colors, names, strict=True)):
        points = SQUARE.copy()
        points[:, 0] = (points[:, 0] + 0.5 + number) / count - 0.5
        file.primitive(points, material=number)
        base = {"baseColorFactor": [*color, 1.0]}
        file.json["materials"].append({"name": name, "pbrMetallicRoughness": base})
    return file.save(folder / "strips.glb")


@pytest.mark.parametrize(
    "names",
    [["A", "B", "B", "C"], ["", "", "", ""], ["none", "none", "x", "material-2"],
     ["B", "B 2", "B", "B 2"], ["look", "look/B", "B", "B"]],
)  # fmt: skip
def test_names_of_materials_needn_t_differ(names: list[str], tmp_path: Path) -> None:
    colors = [RED, GREEN, BLUE, YELLOW]
    path = strips(tmp_path, colors, names)
    np.testing.assert_allclose(seen(path, 4), [colors] * 4, atol=1e-6)


def test_names_that_an_obj_has(tmp_path: Path) -> None:
    """Faces without a material, and a material that is called "none"."""
    (tmp_path / "a.mtl").write_text("newmtl none\nKd 0 1 0\nnewmtl red\nKd 1 0 0\n")
    corners = "".join(f"v {x} {y} 0\n" for x in (-0.5, -0.2, 0.2, 0.5) for y in (-0.5, 0.5))
    faces = "f 1 3 4 2\nusemtl none\nf 3 5 6 4\nusemtl red\nf 5 7 8 6\n"
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" + corners + faces)
    surface = surface_of(tmp_path / "a.obj")
    paints = [list(surface.paints.values())[number] for number in surface.regions]
    assert [paint.albedo for paint in paints] == [0.5, GREEN, RED]  # type: ignore[attr-defined]


def test_a_paint_may_be_called_unpainted(tmp_path: Path) -> None:
    path = strips(tmp_path, [RED, GREEN], ["a", "b"])
    np.testing.assert_allclose(seen(path, 2, {"name": "unpainted"}), [[RED, GREEN]] * 2, atol=1e-6)


def test_colours_are_as_exact_as_the_file(tmp_path: Path) -> None:
    for color in ([0.0015, 0.001, 0.0005], [0.2, 0.4, 0.6]):
        path = square({"baseColorFactor": [*color, 1.0]}).save(tmp_path / "a.glb")
        np.testing.assert_allclose(seen(path, 1), [[color]], rtol=1e-6)
        file = square({})
        gloss = {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [*color, 1.0]}}
        file.json["materials"] = [{"extensions": gloss}]
        np.testing.assert_allclose(seen(file.save(path), 1), [[color]], rtol=1e-6)


@pytest.mark.parametrize("kind", ["<f4", "u1", "<u2"])
def test_colours_of_vertices_multiply(kind: str, tmp_path: Path) -> None:
    """One colour for each of two triangles: above the diagonal from the lower left, and below."""
    full = 1.0 if kind == "<f4" else float(np.iinfo(kind).max)
    below, above = [0.2, 1.0, 0.6], [1.0, 0.4, 0.0]
    tints = np.array([[*below, 1.0]] * 3 + [[*above, 1.0]] * 3) * full
    for factor in ([0.5, 1.0, 0.25], None):
        file = square(points=SQUARE[[0, 1, 2, 0, 2, 3]], index=None, uv=None)
        one = file.json["meshes"][0]["primitives"][0]
        one["attributes"]["COLOR_0"] = file.numbers(tints.astype(kind), normalized=full > 1.0)
        if factor:
            base = {"baseColorFactor": [*factor, 1.0]}
            file.json["materials"], one["material"] = [{"pbrMetallicRoughness": base}], 0
        found = seen(file.save(tmp_path / "a.glb"), 3)
        for tint, shown in ((below, found[2, 2]), (below, found[1, 2]), (above, found[0, 0])):
            np.testing.assert_allclose(shown, np.multiply(tint, factor or 1.0), rtol=1e-6)
    one["attributes"]["COLOR_0"] = file.numbers(np.eye(6, 3, dtype="<f4"))
    with pytest.raises(InputError, match=r"a\.glb: .*COLOR_0: colours that change within"):
        read_textured(file.save(tmp_path / "a.glb"))


@pytest.mark.parametrize("kind", ["<f4", "u1", "<u2"])
def test_normalised_coordinates(kind: str, tmp_path: Path) -> None:
    uv = CORNERS if kind == "<f4" else (CORNERS * np.iinfo(kind).max).astype(kind)
    file = pictured(uv=None)
    one = file.json["meshes"][0]["primitives"][0]
    one["attributes"]["TEXCOORD_0"] = file.numbers(uv, stride=8, normalized=kind != "<f4")
    np.testing.assert_allclose(seen(file.save(tmp_path / "a.glb"), 2), UPRIGHT, atol=2e-3)


REPEAT = [RED, GREEN, RED, GREEN], [BLUE, WHITE, BLUE, WHITE]
CLAMP = [RED, GREEN, GREEN, GREEN], [BLUE, WHITE, WHITE, WHITE]
MIRROR = [RED, GREEN, GREEN, RED], [BLUE, WHITE, WHITE, BLUE]


@pytest.mark.parametrize(
    ("code", "rows"),
    [
        (10497, [REPEAT[0], REPEAT[1], REPEAT[0], REPEAT[1]]),
        (33071, [CLAMP[0], CLAMP[1], CLAMP[1], CLAMP[1]]),
        (33648, [MIRROR[0], MIRROR[1], MIRROR[1], MIRROR[0]]),
    ],
)
@pytest.mark.parametrize("shift", [0, 2, -4])
def test_pictures_go_on_as_the_sampler_says(
    code: int, rows: Any, shift: int, tmp_path: Path
) -> None:
    """Twice across the square; an even shift changes what is clamped alone."""
    path = pictured(uv=2 * CORNERS + shift, wrapS=code, wrapT=code).save(tmp_path / "a.glb")
    if code == 33071 and shift:
        rows = [[WHITE if shift > 0 else RED] * 4] * 4
    np.testing.assert_allclose(seen(path, 4), rows, atol=2e-3)


def test_sides_go_on_each_in_its_way(tmp_path: Path) -> None:
    path = pictured(uv=2 * CORNERS - 1, wrapS=33071, wrapT=33648).save(tmp_path / "a.glb")
    top, low = [RED, RED, RED, GREEN], [BLUE, BLUE, BLUE, WHITE]
    np.testing.assert_allclose(seen(path, 4), [low, top, top, low], atol=2e-3)


def test_which_coordinates_and_how_they_are_transformed(tmp_path: Path) -> None:
    turned = CORNERS[[1, 2, 3, 0]]  # the picture a quarter counter-clockwise further
    file = pictured({"texCoord": 1})
    attributes = file.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_1"] = file.numbers(turned)
    path = file.save(tmp_path / "a.glb")
    np.testing.assert_allclose(seen(path, 2), [[BLUE, RED], [WHITE, GREEN]], atol=2e-3)
    texture = file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    texture["extensions"] = {"KHR_texture_transform": {"texCoord": 0, "scale": [2, 1]}}
    np.testing.assert_allclose(seen(file.save(path), 4)[::2], REPEAT, atol=2e-3)
    # the extension's own example: the lower left quarter, rotated clockwise by 90 degrees
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[32:, :32] = four_colors(16)
    quarter = {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5]}
    file = pictured({"extensions": {"KHR_texture_transform": quarter}}, picture=png(picture))
    np.testing.assert_allclose(seen(file.save(path), 2), [[BLUE, RED], [WHITE, GREEN]], atol=2e-3)


def test_factors_multiply_pictures_after_they_are_decoded(tmp_path: Path) -> None:
    """The format's own example: 64, 124, 231 by 0.2, 1.0, 0.7."""
    picture = np.full((8, 8, 3), (64, 124, 231), np.uint8)
    file = pictured(picture=png(picture))
    base = file.json["materials"][0]["pbrMetallicRoughness"]
    base["baseColorFactor"] = [0.2, 1.0, 0.7, 1.0]
    path = file.save(tmp_path / "a.glb")
    found = seen(path, 1, {"name": "look", "gamma": "srgb"})
    np.testing.assert_allclose(found, [[[0.0102, 0.202, 0.5593]]], atol=5e-4)  # it rounds
    half = seen(path, 1, {"name": "look", "gamma": "srgb", "dark": 0.1, "light": 0.6})
    plain = seen(path, 1, {"name": "look", "gamma": "srgb", "channels": "grey"})
    assert np.ptp(plain) == 0.0 and 0.05 < plain[0, 0, 0] < 0.3
    want = np.array([0.2, 1.0, 0.7]) * (0.1 + 0.5 * np.array([0.0513, 0.2016, 0.7991]))
    np.testing.assert_allclose(half, [[want]], atol=3e-4)


def test_an_obj_s_colour_multiplies_its_picture(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png(four_colors()))
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 0.5 0.25 1\nmap_Kd a.png\n")
    corners = "".join(f"v {x} {y} 0\nvt {x + 0.5} {y + 0.5}\n" for x, y, _ in SQUARE.tolist())
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{corners}usemtl a\nf 1/1 2/2 3/3 4/4\n")
    want = np.array(UPRIGHT) * (0.5, 0.25, 1.0)
    np.testing.assert_allclose(seen(tmp_path / "a.obj", 2), want, atol=2e-3)


def test_sixteen_bits_stay(tmp_path: Path) -> None:
    grey = np.repeat(np.array([[16384, 49151]], np.uint16), 32, axis=1).repeat(64, axis=0)
    path = pictured(picture=png(grey)).save(tmp_path / "a.glb")
    picture = surface_of(path).paints["look"]
    assert isinstance(picture, gs.paint.Image) and picture.pixels.dtype == np.uint16
    found = seen(path, 2)[..., 0]
    np.testing.assert_allclose(found, [[0.25, 0.75]] * 2, atol=2e-4)
    wide = np.zeros((8, 8, 3), np.uint16)
    wide[:] = 257, 1000, 65535
    gs.export.write_image(tmp_path / "wide.png", wide)
    data = (tmp_path / "wide.png").read_bytes()
    found = seen(pictured(picture=data).save(path), 1)
    np.testing.assert_allclose(found, [[[257 / 65535, 1000 / 65535, 1.0]]], atol=1e-6)


def gltf(file: GltfFile, path: Path, image: str) -> Path:
    """The file as .gltf and .bin, with the name of its picture."""
    file.json["buffers"] = [{"byteLength": len(file.data), "uri": "a.bin"}]
    file.json["images"] = [{"uri": image}]
    path.with_name("a.bin").write_bytes(file.data)
    path.write_text(json.dumps(file.json))
    return path


def test_pictures_beside_the_file(tmp_path: Path) -> None:
    """They belong to the scene; one that isn't there is an error if it is wanted."""
    (tmp_path / "four colours.png").write_bytes(png(four_colors()))
    path = gltf(pictured(), tmp_path / "a.gltf", "four%20colours.png")
    np.testing.assert_allclose(seen(path, 2), UPRIGHT, atol=2e-3)
    scene = scene_of(prop_of(path))
    assert {Path(name).name for name, _ in scene.files} == {"a.gltf", "a.bin", "four colours.png"}
    (tmp_path / "four colours.png").write_bytes(png(four_colors(16)))
    with pytest.raises(InputError, match=r"four colours\.png: was changed"):
        build_prop(scene.props[0], scene.input)
    for name in ("away.png", "http://a.example/b.png", "x" * 5000):
        gltf(pictured(), path, name)
        with pytest.raises(InputError, match=f"'{name}', of material 'paint', isn't there"):
            surface_of(path)
        own = {"name": "look", "file": str(tmp_path / "four colours.png")}
        np.testing.assert_allclose(seen(path, 2, own), UPRIGHT, atol=4e-3)


def test_pictures_that_cannot_be_decoded(tmp_path: Path) -> None:
    whole = png(four_colors())
    for data in (b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(60), whole[: len(whole) // 2], b""):
        file = pictured(picture=data or b"x")
        if data.startswith(b"\xab"):  # by its extension alone
            file.json["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]
        path = file.save(tmp_path / "a.glb")
        with pytest.raises(InputError, match=r"a\.glb, image 0: "):
            surface_of(path)


def test_three_coordinates_for_four_points(tmp_path: Path) -> None:
    path = pictured(uv=CORNERS[:3]).save(tmp_path / "a.glb")
    with pytest.raises(InputError, match=r"a\.glb: .*TEXCOORD_0; got 3 for 4 points"):
        surface_of(path)
    for color in ([2.0, 0, 0, 1], [float("nan"), 0, 0, 1], [1, 1, 1]):
        path = square({"baseColorFactor": color}).save(tmp_path / "a.glb")
        with pytest.raises(InputError, match=r"a\.glb: materials\[0\], baseColorFactor; got"):
            surface_of(path)


def flat_png(side: int) -> bytes:
    """White of side x side, RGB, without ever holding it."""
    data = Pillow.new("RGB", (1, 1), "white")
    stream = io.BytesIO()
    data.save(stream, "png")
    pack = zlib.compressobj(9)
    body = b"".join(pack.compress(b"\0" + b"\xff" * 3 * side) for _ in range(side)) + pack.flush()
    head = side.to_bytes(4, "big") * 2 + b"\x08\x02\0\0\0"

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = zlib.crc32(kind + content).to_bytes(4, "big")
        return len(content).to_bytes(4, "big") + kind + content + check

    return stream.getvalue()[:8] + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def test_pixels_are_counted_before_they_are_decoded(tmp_path: Path) -> None:
    """144 million in 0.4 MB; and a picture that is repeated 10,000 times."""
    path = pictured(picture=flat_png(12_000)).save(tmp_path / "a.glb")
    assert path.stat().st_size < 500_000
    for file, words in (
        (None, "pictures of 144,000,000 pixels; expected at most 67,108,864"),
        (pictured(uv=150 * CORNERS), "64 x 64 150 x 150 times; expected at most 16384 pixels"),
    ):
        if file is not None:
            file.save(path)
        scene = scene_of(prop_of(path))
        tracemalloc.start()
        with pytest.raises(InputError, match=words):
            build_prop(scene.props[0], scene.input)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 50e6


def test_gltf_is_in_metres(tmp_path: Path) -> None:
    """Unless the scene says otherwise; of other files mm stay."""
    path = square({}).save(tmp_path / "a.GLB")
    for more, side in (({}, 1.0), ({"unit": "mm"}, 1e-3)):
        scene = scene_of(prop_of(path, **more))
        assert np.ptp(build_prop(scene.props[0], scene.input).rest, axis=0)[0] == side
        assert Scene.from_document(scene.document) == scene
    shown = load_content(path).parts[0], load_content(path, "cm").parts[0]
    assert [np.ptp(part.rest[:, 0]) for part in shown] == [1.0, 0.01]
    assert len(read_textured(read_input(path)).points) == 4
