"""Rules for the shaders: a twin for every stage, nothing in storage that is misread silently."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import gpusim
from gpusim.gpu import twin_checks
from gpusim.gpu.wgsl import shader_folder

PACKAGE = Path(gpusim.__file__).parent
ENTRY = re.compile(r"@(?:compute|vertex|fragment)\b")
IMPORT = re.compile(r"^#import\s+(\S+)", re.MULTILINE)
COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
STORAGE = re.compile(r"var\s*<\s*storage\b[^>]*>\s*(\w+)\s*:\s*([^;]+);")
STRUCT = re.compile(r"\bstruct\s+(\w+)\s*\{([^}]*)\}")


def shader_texts() -> dict[str, str]:
    """Every shader by stem (``fem/krylov/cg``), comments taken out."""
    root = shader_folder()
    found = {
        path.relative_to(root).with_suffix("").as_posix(): COMMENT.sub(
            "", path.read_text(encoding="utf-8")
        )
        for path in sorted(root.rglob("*.wgsl"))
    }
    assert found, f"no shaders under {root}"
    return found


def head_of(text: str) -> str:
    """A shader's first comment, in one line."""
    (head,) = re.findall(r"\A(?://[^\n]*\n)*", text)
    return " ".join(line.removeprefix("//").strip() for line in head.splitlines())


def twin_of(name: str) -> Path:
    """The module of a shader's NumPy form: the one that its head names, or that of its stem."""
    head = head_of((shader_folder() / f"{name}.wgsl").read_text(encoding="utf-8"))
    said = re.search(r"NumPy form\b.*?\bgpusim/(\S+\.py)|\bgpusim/(\S+\.py)", head)
    return PACKAGE / (said.group(1) or said.group(2) if said else f"{name}.py")


def names_defined(path: Path) -> set[str]:
    """``shares_of`` and ``EdgeFunctions.hidden``: functions, classes, methods of a module."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
            inner = node.body if isinstance(node, ast.ClassDef) else []
            found |= {f"{node.name}.{v.name}" for v in inner if isinstance(v, ast.FunctionDef)}
    return found


def head_faults(text: str) -> list[str]:
    """Modules that a shader's head names and that aren't there, nor the function named in them."""
    faults = []
    for name, place in re.findall(r"(?:`([\w.]+)` in )?\bgpusim/(\S+?\.py)", head_of(text)):
        if not (PACKAGE / place).is_file():
            faults.append(f"no module gpusim/{place}")
        elif name and name not in names_defined(PACKAGE / place):
            faults.append(f"no {name} in gpusim/{place}")
    return faults


def test_heads_name_what_there_is() -> None:
    root = shader_folder()
    assert [
        f"{path.relative_to(root)}: {fault}"
        for path in sorted(root.rglob("*.wgsl"))
        for fault in head_faults(path.read_text(encoding="utf-8"))
    ] == []


@pytest.mark.parametrize(
    "place",
    ["gpusim/optics/shadow/brute.py", "`shares` in gpusim/optics/shadow/brute_force.py"],
)
def test_a_wrong_head_is_seen(place: str) -> None:
    assert len(head_faults(f"// Shares.\n// The NumPy form is {place}.\nfn f() {{}}\n")) == 1


def test_every_stage_has_a_module_and_a_registered_twin_check() -> None:
    texts = shader_texts()
    imported = {name for text in texts.values() for name in IMPORT.findall(text)}
    checked = {name.split(".")[0] for name in twin_checks()}
    faults = []
    for name, text in texts.items():
        if name.startswith("lib/"):
            continue
        if not ENTRY.search(text):
            if name not in imported:
                faults.append(f"{name}.wgsl has no entry point and nobody imports it")
        elif not twin_of(name).is_file():
            faults.append(f"{name}.wgsl has no gpusim/{name}.py, nor names another module")
        elif name not in checked:
            faults.append(f"{name}.wgsl has no twin check that `gpusim doctor` runs")
    assert faults == []
    assert checked <= set(texts), "a check without a shader"


def structs_with_vec3(texts: dict[str, str]) -> set[str]:
    """Names of structs that hold a vec3 or mat?x3, directly or through another struct."""
    bodies = {name: body for text in texts.values() for name, body in STRUCT.findall(text)}
    bad: set[str] = set()
    while True:
        pattern = "|".join([r"vec3", r"mat\dx3", *(rf"{name}\b" for name in bad)])
        more = {name for name, body in bodies.items() if re.search(rf"\b(?:{pattern})", body)}
        if more <= bad:
            return bad
        bad |= more


def storage_faults(texts: dict[str, str]) -> list[str]:
    bad = structs_with_vec3(texts)
    pattern = re.compile("|".join([r"\bvec3", r"\bmat\dx3", *(rf"\b{name}\b" for name in bad)]))
    return [
        f"{stem}.wgsl: {name}: {kind.strip()}"
        for stem, text in texts.items()
        for name, kind in STORAGE.findall(text)
        if pattern.search(kind)
    ]


def test_no_vec3_in_storage() -> None:
    # An (N,3) buffer read as array<vec3f> is misread silently: vec3 is padded to 16 bytes.
    assert storage_faults(shader_texts()) == []


@pytest.mark.parametrize(
    "text",
    [
        "@group(0) @binding(0) var<storage, read> x: array<vec3f>;",
        "struct P { p: vec3<f32>, } @group(0) @binding(0) var<storage> x: array<P>;",
        "struct P { p: mat4x3f } struct Q { p: P } @group(0) @binding(0) var<storage> x: Q;",
    ],
)
def test_a_vec3_in_storage_is_seen(text: str) -> None:
    assert len(storage_faults({"area/stage": text})) == 1
