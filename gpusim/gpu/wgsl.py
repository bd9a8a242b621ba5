"""WGSL as the single source: loading, ``#import``, and reflection of bindings and structs.

The files in ``shaders/`` are legal WGSL plus one extra line form, ``#import lib/numeric/index``,
which stands for the text of that file (once per module, however often it is named). Bindings,
struct layouts, override constants and workgroup sizes are read from the text, so that no second
list of them exists anywhere. The parser covers the subset of WGSL that gpusim's own shaders use and
refuses the rest by name.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from gpusim.errors import InputError

COLOR_FILES = ("lib/light/color", "lib/raster/planes")
"""Of which there are a ``_grey`` and an ``_rgb`` one."""

_IMPORT = re.compile(r"^#import\s+([\w/]+)\s*$", re.MULTILINE)
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_STRUCT = re.compile(r"\bstruct\s+(\w+)\s*\{(.*?)\}", re.DOTALL)
_MEMBER = re.compile(r"(?:@\w+(?:\([^)]*\))?\s*)*(\w+)\s*:\s*([\w<>, ]+?)\s*$")
_BINDING = re.compile(
    r"@group\((\d+)\)\s*@binding\((\d+)\)\s*var(?:<\s*([\w\s,]+?)\s*>)?\s+(\w+)\s*:\s*([^;]+);"
)
_OVERRIDE = re.compile(r"\boverride\s+(\w+)\s*(?::\s*\w+)?\s*(=)?")
_NUMBER = re.compile(r"\b(?:const|override)\s+(\w+)(?:\s*:\s*\w+)?\s*=\s*(\d+)[ui]?\s*;")
_BRACE = re.compile(r"[{}]")
_FUNCTION = re.compile(r"((?:@\w+(?:\([^)]*\))?\s*)*)\bfn\s+(\w+)\s*\(")
_STAGE = re.compile(r"@(compute|vertex|fragment)\b")
_WORD = re.compile(r"\b[A-Za-z_]\w*\b")

# size, alignment and NumPy form of the host-shareable types in use (WGSL specification, 14.4)
_SCALARS = {"f32": "<f4", "i32": "<i4", "u32": "<u4", "f64": "<f8"}
_VECTORS = {
    f"vec{n}{suffix}": (code, n)
    for n in (2, 3, 4)
    for suffix, code in (("f", "<f4"), ("i", "<i4"), ("u", "<u4"))
}


@dataclass(frozen=True)
class Binding:
    """One resource variable of a module."""

    name: str
    group: int
    index: int
    space: str  # "storage", "uniform" or "" for textures
    writable: bool
    type: str


@dataclass(frozen=True)
class EntryPoint:
    """An entry function: its stage, the literal workgroup size (if compute) and what it uses."""

    name: str
    stage: str
    workgroup: tuple[str, ...]
    bindings: tuple[str, ...]


@dataclass(frozen=True)
class Module:
    """A shader file with its imports resolved, and everything reflected from it.

    ``structs``: those that can lie in a buffer, as NumPy dtypes with the same offsets, size and
    padding; others are left out.
    """

    name: str
    code: str
    bindings: dict[str, Binding]
    structs: dict[str, np.dtype[np.void]]
    overrides: dict[str, bool]  # name -> has a default
    constants: dict[str, int] = field(default_factory=dict)  # whole-number consts and defaults
    entries: dict[str, EntryPoint] = field(default_factory=dict)

    def workgroup_size(self, entry: str, constants: dict[str, float]) -> tuple[int, int, int]:
        """The workgroup size of ``entry`` with override ``constants`` put in."""
        sizes = []
        for text in self.entries[entry].workgroup:
            if text.isdigit():
                sizes.append(int(text))
            elif text in constants:
                sizes.append(int(constants[text]))
            elif text in self.constants:
                sizes.append(self.constants[text])
            else:
                where, got = f"workgroup size of {self.name}.{entry}", f"{text!r} without a value"
                expected = "a number, a const with one, or an override with a value"
                raise InputError(f"{where}; got {got}; expected {expected}")
        sizes += [1] * (3 - len(sizes))
        return sizes[0], sizes[1], sizes[2]


def shader_folder() -> Path:
    """The folder with the WGSL files: inside the installed package, else in the checkout."""
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "shaders", package.parent / "shaders"):
        if folder.is_dir():
            return folder
    raise InputError(f"shaders: not found; expected a folder 'shaders' in or beside {package}")


@cache
def load(name: str, real: str, extra: Path | None = None) -> Module:
    """Load ``shaders/<name>.wgsl``.

    Parameters
    ----------
    name : stem with folder, such as ``"fem/krylov/cg"``; with ``@rgb`` behind it, what has variants
        for grey and for coloured light (`COLOR_FILES`) is compiled for the latter.
    real : what ``#import lib/numeric/real`` stands for: ``"f64"`` or ``"double_single"``.
    extra : a folder that is searched before gpusim's own.

    Raises
    ------
    InputError
        No such file, an import that doesn't exist, or a construct that reflection doesn't cover.
    """
    folders = (shader_folder(),) if extra is None else (extra, shader_folder())
    stem, _, color = name.partition("@")
    variants = {"lib/numeric/real": real, **dict.fromkeys(COLOR_FILES, color or "grey")}
    text = _expand(stem, variants, set(), f"shader {name}", folders)
    return _reflect(name, text)


def _expand(
    name: str, variants: dict[str, str], seen: set[str], where: str, folders: tuple[Path, ...]
) -> str:
    if name in variants:
        name = f"{name}_{variants[name]}"
    if name in seen:
        return ""
    seen.add(name)
    paths = [folder / f"{name}.wgsl" for folder in folders]
    path = next((path for path in paths if path.is_file()), None)
    if path is None:
        expected = " or ".join(str(path) for path in paths)
        raise InputError(f"{where}: no such shader file; got {name!r}; expected {expected}")
    source = path.read_text(encoding="utf-8")

    def imported(match: re.Match[str]) -> str:
        return _expand(match.group(1), variants, seen, f"import in {name}", folders)

    return _IMPORT.sub(imported, source)


def _reflect(name: str, code: str) -> Module:
    plain = _COMMENT.sub("", code)
    structs: dict[str, np.dtype[np.void]] = {}
    for match in _STRUCT.finditer(plain):
        if "@builtin" in match.group(2) or "@location" in match.group(2):
            continue  # stage interfaces never lie in a buffer
        # one that reflection can't lay out may serve inside functions; a binding of it is refused
        with suppress(_NoLayout):
            structs[match.group(1)] = _struct_dtype(match, structs, name)
    bindings = {}
    for group, index, access, variable, kind in _BINDING.findall(plain):
        words = [word.strip() for word in access.split(",")] if access else [""]
        bindings[variable] = Binding(
            variable, int(group), int(index), words[0], "read_write" in words, kind.strip()
        )
    form = "'@group(g) @binding(b) var<…> name: type;'"
    if len(bindings) != len(re.findall(r"@binding\b", plain)):
        fault = f"a resource isn't of the form {form}, or two have one name"
        raise InputError(f"{name}: {fault}; got {sorted(bindings)}")
    functions = _functions(plain, name)
    entries = {}
    for function, (attributes, _) in functions.items():
        stage = _STAGE.search(attributes)
        if stage is None:
            continue
        size = re.search(r"@workgroup_size\(([^)]*)\)", attributes)
        used = _reachable(function, functions)
        entries[function] = EntryPoint(
            function,
            stage.group(1),
            tuple(part.strip().rstrip("u") for part in size.group(1).split(",")) if size else (),
            tuple(variable for variable in bindings if variable in used),
        )
    return Module(
        name,
        code,
        bindings,
        structs,
        {match[0]: bool(match[1]) for match in _OVERRIDE.findall(plain)},
        {key: int(value) for key, value in _NUMBER.findall(plain)},
        entries,
    )


def _functions(plain: str, module: str) -> dict[str, tuple[str, str]]:
    """Name -> (attributes, text from the parameter list to the closing brace)."""
    found = {}
    for match in _FUNCTION.finditer(plain):
        depth = 0
        for brace in _BRACE.finditer(plain, match.end()):
            depth += 1 if brace.group() == "{" else -1
            if depth <= 0:
                break
        else:
            raise InputError(f"{module}: the braces of function {match.group(2)} don't match")
        found[match.group(2)] = (match.group(1), plain[match.end() : brace.end()])
    return found


def _reachable(entry: str, functions: dict[str, tuple[str, str]]) -> set[str]:
    """Every identifier used by ``entry`` or by a function that it calls, directly or not."""
    words: set[str] = set()
    queue, done = [entry], set()
    while queue:
        function = queue.pop()
        done.add(function)
        here = set(_WORD.findall(functions[function][1]))
        words |= here
        queue += [w for w in here if w in functions and w not in done]
    return words


class _NoLayout(InputError):
    """A type that can't lie in a buffer, or whose layout reflection doesn't know."""


def type_layout(
    kind: str, structs: dict[str, np.dtype[np.void]], where: str
) -> tuple[np.dtype, int]:
    """NumPy dtype and alignment in bytes of a WGSL type."""
    kind = re.sub(r"vec(\d)<\s*(f|i|u)32\s*>", r"vec\1\2", kind.replace(" ", ""))
    if kind in _SCALARS:
        dtype = np.dtype(_SCALARS[kind])
        return dtype, dtype.itemsize
    if kind in _VECTORS:
        code, count = _VECTORS[kind]
        return np.dtype((code, (count,))), 8 if count == 2 else 16
    if kind in structs:
        return structs[kind], _alignment(structs[kind])
    array = re.fullmatch(r"array<(.+),(\d+)u?>", kind)
    if array:
        inner, align = type_layout(array.group(1), structs, where)
        stride = -(-inner.itemsize // align) * align
        if stride != inner.itemsize:
            raise _NoLayout(f"{where}: array of {array.group(1)} has padding between elements")
        return np.dtype((inner.base, (int(array.group(2)), *inner.shape))), align
    covered = "32-bit scalars, vectors, arrays of them and structs declared before their use"
    raise _NoLayout(f"{where}: type {kind!r} isn't one that reflection covers ({covered})")


def _alignment(dtype: np.dtype[np.void]) -> int:
    metadata = dtype.metadata
    return int(metadata["alignment"]) if metadata else 16


def _struct_dtype(
    match: re.Match[str], structs: dict[str, np.dtype[np.void]], module: str
) -> np.dtype[np.void]:
    names, formats, offsets, offset, largest = [], [], [], 0, 4
    for text in re.split(r",(?![^<]*>)", match.group(2)):
        if not text.strip():
            continue
        member = _MEMBER.fullmatch(text.strip())
        if member is None or re.search(r"@(?:size|align)\b", text):
            raise _NoLayout(f"{module}: struct {match.group(1)}: can't read member {text!r}")
        dtype, align = type_layout(member.group(2), structs, f"{module}.{match.group(1)}")
        offset = -(-offset // align) * align
        names.append(member.group(1))
        formats.append(dtype)
        offsets.append(offset)
        offset += dtype.itemsize
        largest = max(largest, align)
    size = -(-offset // largest) * largest
    spec = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
    return np.dtype(spec, metadata={"alignment": largest})  # type: ignore[call-overload,no-any-return]
