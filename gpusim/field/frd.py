"""CalculiX result files (.frd, text): nodes, solids, and the DISP block of every time.

Columns are fixed: " -1", the node (5 or 10 characters), then 12 per value. The blocks' places are
found in one pass through the file; a block's numbers are read when they are needed. Format: manual
of CalculiX GraphiX (K. Wittig), "Result Format".
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.field.field import Field
from gpusim.files.input_file import InputFile
from gpusim.mesh.file_content.cell_blocks import RawBlock, RawMesh, assemble, index_of, solid_nodes
from gpusim.mesh.file_content.numbering import from_upright_first
from gpusim.validation import require

# Element types by number: kind and nodes. GraphiX counts vertical edges before top edges.
_TYPES = {
    1: ("hex8", 8), 2: ("wedge6", 6), 3: ("tet4", 4), 4: ("hex20", 20), 5: ("wedge15", 15),
    6: ("tet10", 10), 7: ("tri3", 3), 8: ("tri6", 6), 9: ("quad4", 4), 10: ("quad8", 8),
    11: ("line2", 2), 12: ("line3", 3),
}  # fmt: skip
_VALUE = 12
_NODES, _CELLS = b"    2C", b"    3C"
"""How the blocks of the mesh begin."""


@dataclass
class _Block:
    """Where the lines of a block begin and end in the file (bytes), and how wide labels are."""

    start: int
    end: int
    width: int
    time: float = 0.0
    components: list[bytes] = field(default_factory=list)


def read_frd(file: InputFile, name: str | None = None) -> Field:
    """The displacements of an .frd file over its times (``name``: of the block, DISP).

    Steps that restart at an earlier time are refused. Raises InputError: binary, cut off, no
    solids, no displacements.
    """
    path = file.path
    parts, results = _index(file)
    wanted = "DISP" if name is None else name
    blocks = results.get(wanted, [])
    what = "no nodes or no elements" if blocks else f"no block {wanted}"
    got = f"results {', '.join(results) or 'none'}"
    expected = "a complete .frd with displacements (*NODE FILE with U)"
    require(len(parts) == 2 and bool(blocks), f"{path}: {what}", got, expected)
    for block in blocks:
        _check_vector(block, wanted, path)
    labels, points = _rows(file.data, parts[_NODES], path)
    raw = RawMesh(points, tuple(_cells(file.data, parts[_CELLS], labels, path)))
    mesh = assemble(raw, str(path))
    used = solid_nodes(raw)

    def step(number: int) -> Float:
        found, values = _rows(file.data, blocks[number], path)
        u = np.full((len(labels), 3), np.nan)
        place = index_of(labels, found)
        u[place[place >= 0]] = values[place >= 0]
        return u[used]

    return Field(mesh, [block.time for block in blocks], step, name=str(path))


def _index(file: InputFile) -> tuple[dict[bytes, _Block], dict[str, list[_Block]]]:
    """One pass over the lines: where nodes and elements are, and the blocks of each result."""
    path = file.path
    parts: dict[bytes, _Block] = {}
    results: dict[str, list[_Block]] = {}
    current: _Block | None = None
    time, width = 0.0, 10
    first = file.data[:6]
    require(first.strip() == b"1C", f"{path}: not an .frd file", f"first bytes {first!r}", "'1C'")
    at = 0
    for number, line in enumerate(file.stream(), start=1):
        key = line[:6]
        if current is not None and key[:3] == b" -3":
            current.end = at
            current = None
        elif current is None:
            if key in (_NODES, _CELLS):
                current = _Block(at + len(line), -1, _label_width(line, path))
                if key in parts:
                    raise InputError(f"{path}:{number}: a second mesh; expected one in a file")
                parts[key] = current
            elif key == b"  100C":
                time, width = _time(line, path), _label_width(line, path)
            elif key[:3] == b" -4" and line[3:13].split():
                current = _Block(at + len(line), -1, width, time)
                name = _text(line[3:13].split()[0])
                results.setdefault(name, []).append(current)
            elif line[:5].strip() not in (b"1", b"9999", b""):  # headers, and the end
                text = _text(line.strip()[:40])
                raise InputError(f"{path}:{number}: got {text!r}; expected a block: damaged?")
        elif key[:3] == b" -5":
            current.start = at + len(line)
            current.components.append(line)
        at += len(line)
    require(current is None, f"{path}: cut off", "a block without its end (-3)", "a whole file")
    return parts, results


def _check_vector(block: _Block, name: str, path: Path) -> None:
    """The first three components are those of a vector: type 2, numbers 1 to 3."""
    kinds = [(line[18:23].strip(), line[23:28].strip()) for line in block.components[:3]]
    got = ", ".join(_text(b" ".join(kind)) for kind in kinds) or "none"
    is_vector = kinds == [(b"2", b"1"), (b"2", b"2"), (b"2", b"3")]
    what, expected = f"{path}: block {name}", "a vector, 2 1, 2 2, 2 3"
    require(is_vector, what, f"components of type and number {got}", expected)


def _text(letters: bytes) -> str:
    return letters.decode("ascii", "replace")


def _label_width(line: bytes, path: Path) -> int:
    code = line[73:75].strip()
    expected = "0 or 1: text (CalculiX writes binary on *NODE OUTPUT)"
    require(code in (b"0", b"1"), f"{path}", f"format {_text(code)!r} of a block", expected)
    return 10 if code == b"1" else 5


def _time(line: bytes, path: Path) -> float:
    expected = "displacements over time or load: modes are no states of a body"
    require(line[56:58].strip() != b"2", f"{path}", "results of a frequency analysis", expected)
    try:
        return float(line[12:24])
    except ValueError:
        raise InputError(f"{path}: time of a result; got {line[12:24]!r}") from None


def _rows(file: bytes, block: _Block, path: Path) -> tuple[Long, Float]:
    """Labels (n,) and the first three values (n, 3) of the lines of a block."""
    data = file[block.start : block.end]
    width = block.width
    length = data.find(b"\n") + 1
    least = 3 + width + 3 * _VALUE
    alike = length > least and len(data) % length == 0
    require(alike, f"{path}: a block of nodes", "lines of unequal length", "equal ones: cut off?")
    letters = np.frombuffer(data, dtype=np.uint8).reshape(-1, length)
    if not (letters[:, :3] == np.frombuffer(b" -1", dtype=np.uint8)).all():
        raise InputError(f"{path}: a block of nodes with lines that don't begin with -1")
    try:
        labels = _column(letters, 3, width).astype(np.int64)
        values = [
            _column(letters, 3 + width + k * _VALUE, _VALUE).astype(np.float64) for k in range(3)
        ]
    except ValueError as error:
        raise InputError(f"{path}: not a number in a block of nodes ({error})") from None
    return labels, np.stack(values, axis=1)


def _column(letters: npt.NDArray[np.uint8], start: int, width: int) -> npt.NDArray[np.bytes_]:
    part = np.ascontiguousarray(letters[:, start : start + width])
    return part.view(f"S{width}")[:, 0]


def _cells(file: bytes, block: _Block, labels: Long, path: Path) -> list[RawBlock]:
    """The elements by type: a line " -1" with number and type, then lines " -2" with nodes."""
    lines = file[block.start : block.end].split(b"\n")
    width = block.width
    rows: dict[str, list[bytes]] = {}
    kind = ""
    for line in lines:
        if line[:3] == b" -1":
            number = line[3 + width : 8 + width].strip()
            if not number.isdigit() or int(number) not in _TYPES:
                raise InputError(f"{path}: element type {_text(number)!r}; expected 1 to 12")
            kind = _TYPES[int(number)][0]
            rows.setdefault(kind, []).append(b"")
        elif line[:3] == b" -2" and kind:
            rows[kind][-1] += line[3:].rstrip(b"\r\n ")
    sizes = dict(_TYPES.values())
    blocks = []
    for kind, texts in rows.items():
        count = sizes[kind]
        joined = b"".join(text.ljust(count * width) for text in texts)
        if len(joined) != len(texts) * count * width:
            raise InputError(f"{path}: an element of type {kind} with more than {count} nodes")
        names = np.frombuffer(joined, dtype=f"S{width}").reshape(-1, count)
        try:
            nodes_of = index_of(labels, names.astype(np.int64))
        except ValueError:
            raise InputError(f"{path}: an element of type {kind} lacks nodes") from None
        blocks.append(RawBlock(kind, from_upright_first(kind, nodes_of)))
    return blocks
