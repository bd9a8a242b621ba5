"""Reflection: what the layer reads out of WGSL is what the device makes of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.gpu.uniform import pack
from gpusim.gpu.wgsl import Module, load

ENTRY = "@compute @workgroup_size(1)\nfn main() {{ {body} }}\n"


def reflect(folder: Path, text: str) -> Module:
    (folder / "lab.wgsl").write_text(text, encoding="utf-8")
    return load("lab", "f64", folder)


def test_imports_come_once_and_in_order(tmp_path: Path) -> None:
    (tmp_path / "one.wgsl").write_text("#import two\nconst ONE: u32 = TWO;\n", encoding="utf-8")
    (tmp_path / "two.wgsl").write_text("#import one\nconst TWO: u32 = 2u;\n", encoding="utf-8")
    module = reflect(
        tmp_path,
        "#import one\n#import two\n#import lib/numeric/index\n" + ENTRY.format(body="_ = ONE;"),
    )
    assert module.code.count("const TWO") == module.code.count("const ONE") == 1
    assert module.code.index("TWO: u32") < module.code.index("ONE: u32")
    assert "fn linear_id" in module.code and "#import" not in module.code


def test_real_is_chosen_by_the_device(tmp_path: Path) -> None:
    (tmp_path / "which.wgsl").write_text("#import lib/numeric/real\n", encoding="utf-8")
    assert "alias real = f64;" in load("which", "f64", tmp_path).code
    assert "alias real = vec2f;" in load("which", "double_single", tmp_path).code


@pytest.mark.parametrize("text", ["#import common/nowhere\n", "#import nowhere\n"])
def test_an_import_that_is_missing_is_named(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"import in lab: no such shader file; got '.*nowhere'"):
        reflect(tmp_path, text)


def test_a_shader_that_is_missing_is_named() -> None:
    with pytest.raises(InputError, match="shader fem/nothing: no such shader file"):
        load("fem/nothing", "f64")


def test_constants_overrides_and_workgroup_sizes(tmp_path: Path) -> None:
    module = reflect(
        tmp_path,
        """
        const WIDE = 32u;  // const NOT = 5;
        const TALL: u32 = 3;
        override block: u32;
        override depth: u32 = 4u;
        override scale: f32 = 0.5;
        @compute @workgroup_size(WIDE, TALL) fn fixed() { }
        @compute @workgroup_size(block, 2, depth) fn chosen() { }
        @compute @workgroup_size(7) fn literal() { }
        """,
    )
    assert module.overrides == {"block": False, "depth": True, "scale": True}
    assert module.workgroup_size("fixed", {}) == (32, 3, 1)
    assert module.workgroup_size("chosen", {"block": 16}) == (16, 2, 4)
    assert module.workgroup_size("chosen", {"block": 16, "depth": 2}) == (16, 2, 2)
    assert module.workgroup_size("literal", {}) == (7, 1, 1)
    with pytest.raises(InputError, match="'block' without a value"):
        module.workgroup_size("chosen", {})
    assert "NOT" not in module.constants


def test_each_entry_knows_the_bindings_that_it_reaches(tmp_path: Path) -> None:
    module = reflect(
        tmp_path,
        """
        @group(0) @binding(0) var<storage, read> a: array<f32>;
        @group(0) @binding(1) var<storage, read_write> b: array<f32>;
        @group(0) @binding(2) var<storage, read_write> c: array<f32>;
        /* fn unused() { c[0] = a[0]; } */
        fn deep() -> f32 { return a[0]; }
        fn middle() -> f32 { if (true) { return deep(); } return 0.0; }
        @compute @workgroup_size(1) fn first() { b[0] = middle(); } // c
        @compute @workgroup_size(1) fn second() { c[0] = 1.0; }
        """,
    )
    assert module.entries["first"].bindings == ("a", "b")
    assert module.entries["second"].bindings == ("c",)
    assert not module.bindings["a"].writable and module.bindings["b"].writable


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("@binding(0) @group(0) var<storage> x: array<f32>;", "resource isn't of the form"),
        ("@compute @workgroup_size(1) fn main() { if (true) { }", "braces of function main"),
        ("fn main();", "braces of function main"),
    ],
)
def test_what_the_parser_cannot_read_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        reflect(tmp_path, text)


# --- structs --------------------------------------------------------------------------------

STRUCTS = """
struct Inner {
    a: f32,
    b: vec2f,
}
struct Probe {
    f: f32, v2: vec2f,       // padding before v2
    i: i32,
    v3: vec3f,               // padding before v3; w fills its last word
    w: f32,
    u: u32,
    v3i: vec3<i32>,
    v4: vec4u,
    inner: Inner,
    rows: array<vec4f, 3>,
    @align(4) last: vec2<u32>,
}
""".replace("@align(4) ", "")
# offsets by hand, from the alignment table of the WGSL specification
OFFSETS = {
    "f": 0, "v2": 8, "i": 16, "v3": 32, "w": 44, "u": 48, "v3i": 64, "v4": 80, "inner": 96,
    "rows": 112, "last": 160,
}  # fmt: skip
WORDS = {
    "f": ["p.f"],
    "v2": ["p.v2.x", "p.v2.y"],
    "i": ["p.i"],
    "v3": ["p.v3.x", "p.v3.y", "p.v3.z"],
    "w": ["p.w"],
    "u": ["p.u"],
    "v3i": ["p.v3i.x", "p.v3i.y", "p.v3i.z"],
    "v4": ["p.v4.x", "p.v4.y", "p.v4.z", "p.v4.w"],
    "inner": ["p.inner.a", "p.inner.b.x", "p.inner.b.y"],
    "rows": [f"p.rows[{i}].{c}" for i in range(3) for c in "xyzw"],
    "last": ["p.last.x", "p.last.y"],
}


def probe_values() -> dict[str, object]:
    return {
        "f": 1.5,
        "v2": (2.25, -3.0),
        "i": -7,
        "v3": (4.0, 5.5, -6.0),
        "w": 1e-30,
        "u": 4_000_000_000,
        "v3i": (-1, 2, -2_000_000_000),
        "v4": [9, 10, 11, 12],
        "inner": {"a": 13.0, "b": (14.0, 15.0)},
        "rows": np.arange(100.0, 112.0).reshape(3, 4),
        "last": np.array([22, 23]),
    }


def flat_words(values: dict[str, object]) -> np.ndarray[tuple[int], np.dtype[np.uint32]]:
    words: list[int] = []

    def add(value: object, kind: type[np.generic]) -> None:
        if isinstance(value, dict):
            for part in value.values():
                add(part, kind)
        elif isinstance(value, (list, tuple, np.ndarray)):
            for part in value:
                add(part, kind)
        else:
            words.append(int(np.array(value, kind).view(np.uint32)[()]))

    kinds = {"i": np.int32, "v3i": np.int32, "u": np.uint32, "v4": np.uint32, "last": np.uint32}
    for name, value in values.items():
        add(value, kinds.get(name, np.float32))
    return np.array(words, np.uint32)


@pytest.mark.parametrize("space", ["uniform", "storage"])
def test_every_field_of_a_struct_arrives(space: str, tmp_path: Path) -> None:
    words = [word for part in WORDS.values() for word in part]
    copies = "\n".join(f"out[{k}] = bitcast<u32>({word});" for k, word in enumerate(words))
    variable = "var<uniform>" if space == "uniform" else "var<storage, read>"
    (tmp_path / "lab.wgsl").write_text(
        f"{STRUCTS}\n@group(0) @binding(0) {variable} p: Probe;\n"
        "@group(0) @binding(1) var<storage, read_write> out: array<u32>;\n"
        + ENTRY.format(body=copies),
        encoding="utf-8",
    )
    device = Device(shaders=tmp_path)
    kernel = device.kernel("lab")
    dtype = kernel.layout.module.structs["Probe"]
    assert {name: dtype.fields[name][1] for name in dtype.names or ()} == OFFSETS  # type: ignore[index]
    assert dtype.itemsize == 176
    out = device.empty(4 * len(words), "out")
    values = probe_values()
    given: object = values
    if space == "storage":
        given = device.buffer(np.asarray(pack(values, dtype, "probe")).reshape(1), "probe")
    with device.recording("lab") as recording:
        recording.dispatch(kernel, kernel.bind(p=given, out=out), groups=(1,))
    np.testing.assert_array_equal(out.read(np.uint32), flat_words(values))


@pytest.mark.parametrize(
    "member",
    ["m: mat4x4f", "x: bool", "x: array<vec3f, 2>", "x: f16", "x: array<f32>", "@align(32) x: f32"],
)
def test_a_struct_without_a_known_layout_is_refused_when_bound(member: str, tmp_path: Path) -> None:
    module = reflect(
        tmp_path,
        f"struct Bad {{ {member} }}\nstruct Good {{ y: f32 }}\n"
        "@group(0) @binding(0) var<uniform> bad: Bad;\n",
    )
    assert set(module.structs) == {"Good"}


def test_a_struct_inside_functions_may_be_anything(tmp_path: Path) -> None:
    (tmp_path / "lab.wgsl").write_text(
        "struct Local { m: mat3x3f, ok: bool }\n"
        "@group(0) @binding(0) var<storage, read_write> out: array<f32>;\n"
        + ENTRY.format(body="var l: Local; l.ok = true; out[0] = select(0.0, 3.0, l.ok);"),
        encoding="utf-8",
    )
    device = Device(shaders=tmp_path)
    out = device.empty(4, "out")
    kernel = device.kernel("lab")
    with device.recording("lab") as recording:
        recording.dispatch(kernel, kernel.bind(out=out), groups=(1,))
    assert out.read(np.float32).tolist() == [3.0]
