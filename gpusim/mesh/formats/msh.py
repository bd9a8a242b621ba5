"""Gmsh's .msh files, versions 2.2 and 4.1, as text or binary."""

from __future__ import annotations

import re

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.ragged import expand
from gpusim.arrays.unique import unique_rows
from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.mesh.file_content.cell_blocks import RawBlock, RawMesh, index_of
from gpusim.mesh.file_content.numbering import GMSH_KINDS, NODES, dimension_of, from_gmsh_order
from gpusim.mesh.formats.msh_numbers import MshNumbers, MshSource
from gpusim.validation import require

# Physical groups by (dimension, tag).
Names = dict[tuple[int, int], str]
Block = tuple[str, Long, list[tuple[int, Long]]]

# Sections that are neither nodes nor elements, and say nothing of where they are or belong to.
_HARMLESS = {
    "Comments", "Periodic", "Parametrizations", "NodeData", "ElementData", "ElementNodeData",
    "InterpolationScheme",
}  # fmt: skip
_KIND_NAMES = ("point", "line", "surface", "volume")


def read_msh(file: InputFile) -> RawMesh:
    """Read a .msh file. A physical group without a name is called "surface_3" by its tag.

    Raises InputError for another version, a file that is cut off, and contents that aren't what
    the format says, each with the section it is in.
    """
    return _Reader(file).read()


class _Reader(MshSource):
    def __init__(self, file: InputFile) -> None:
        super().__init__(file)
        self.names: Names = {}
        self.physical: dict[tuple[int, int], Long] = {}

    def read(self) -> RawMesh:
        version = self._header()
        points = np.zeros((0, 3))
        tags = np.zeros(0, dtype=np.int64)
        blocks: list[Block] = []
        seen: set[str] = set()
        while (name := self._next_section()) is not None:
            if name in seen:
                self.fail("it is there twice; expected one")
            if name == "PhysicalNames":
                self._physical_names()
            elif name == "Entities" and version == "4.1":
                if "Elements" in seen:
                    self.fail("it comes after $Elements, whose groups it holds; expected it before")
                self._entities(MshNumbers(self))
            elif name == "Nodes":
                points, tags = (self._nodes41 if version == "4.1" else self._nodes22)()
            elif name == "Elements":
                blocks = (self._elements41 if version == "4.1" else self._elements22)()
            elif name in ("PartitionedEntities", "GhostElements"):
                self.fail("a partitioned mesh; expected the whole mesh in one part")
            elif name in _HARMLESS:
                self._skip(name)
                continue
            else:
                self.fail(
                    "unknown; expected PhysicalNames, Entities, Nodes, Elements, "
                    f"{', '.join(sorted(_HARMLESS))}"
                )
            seen.add(name)
            self._end(name)
        for name in ("Nodes", "Elements"):
            if name not in seen:
                raise InputError(f"{self.source}: no section ${name}; expected one: cut off?")
        twice = np.flatnonzero(np.diff(np.sort(tags)) == 0)
        if twice.size:
            raise InputError(f"{self.source}: node {np.sort(tags)[twice[0]]} is there twice")
        return RawMesh(points, tuple(self._raw(block, tags) for block in blocks))

    # -- sections --------------------------------------------------------------------------

    def _header(self) -> str:
        words: list[str] = []
        if self.data.lstrip()[:1] == b"$":
            name = self._next_section()
            while name == "Comments":
                self._skip(name)
                name = self._next_section()
            words = self.line().split() if name == "MeshFormat" else []
        got = f"{self.data[:12]!r} at its beginning"
        require(len(words) == 3, f"{self.source}: not a Gmsh mesh", got, "$MeshFormat")
        version, mode, size = words
        if version not in ("2", "2.2", "4.1"):
            raise InputError(
                f"{self.source}: Gmsh mesh of version {version}; expected 2.2 or 4.1 "
                "(Gmsh saves those: Mesh.MshFileVersion)"
            )
        if mode not in ("0", "1") or size != "8":
            self.fail(f"file type {mode}, data size {size}; expected 0 or 1, and 8")
        self.binary = mode == "1"
        if self.binary:
            one = self.data[self.at : self.at + 4]
            if one == b"\x00\x00\x00\x01":
                self.fail("a binary file of a big-endian machine; expected little-endian")
            if one != b"\x01\x00\x00\x00":
                self.fail(f"got {one!r} where a binary file has the number 1")
            self.at += 4
        self._end("MeshFormat")
        return "4.1" if version == "4.1" else "2.2"

    def _next_section(self) -> str | None:
        line = self.text_line()
        if not line:
            return None
        if not re.fullmatch(r"\$(?!End)\w{1,40}", line, re.ASCII):
            self.fail(f"got {line[:40]!r} after it; expected a section")
        self.section = line[1:]
        return self.section

    def _skip(self, name: str) -> None:
        mark = self.data.find(b"$End" + name.encode(), self.at)
        if mark < 0:
            self.fail(f"no $End{name}: the file is cut off")
        self.at = mark
        self.line()

    def _end(self, name: str) -> None:
        line = self.text_line()
        if line != f"$End{name}":
            self.fail(f"got {line[:40]!r}; expected $End{name}: cut off, or wrong counts?")

    def _physical_names(self) -> None:
        for _ in range(self._count(self.line())):
            words = self.line().split(maxsplit=2)
            if len(words) != 3 or not (words[0].isdigit() and words[1].isdigit()):
                self.fail(f"got {' '.join(words)[:40]!r}; expected dimension, tag and name")
            self.names[int(words[0]), int(words[1])] = words[2].strip('"')

    def _count(self, text: str) -> int:
        if not text.isdigit():
            self.fail(f"got {text[:40]!r}; expected a count")
        return int(text)

    # -- version 4.1 -----------------------------------------------------------------------

    def _entities(self, numbers: MshNumbers) -> None:
        for dimension, count in enumerate(numbers.sizes(4)):
            for _ in range(count):
                (tag,) = numbers.ints(1)
                numbers.floats(3 if dimension == 0 else 6)
                self.physical[dimension, int(tag)] = numbers.ints(int(numbers.sizes(1)[0]))
                if dimension:
                    numbers.ints(int(numbers.sizes(1)[0]))
        numbers.done()

    def _nodes41(self) -> tuple[Float, Long]:
        numbers = MshNumbers(self)
        blocks, total, _, _ = numbers.sizes(4)
        tags: list[Long] = []
        points: list[Float] = []
        for _ in range(blocks):
            dimension, _, parametric = numbers.ints(3)
            count = int(numbers.sizes(1)[0])
            tags.append(numbers.sizes(count))
            columns = 3 + (int(dimension) if parametric else 0)
            points.append(numbers.floats(columns * count).reshape(-1, columns)[:, :3])
        numbers.done()
        found = sum(map(len, tags))
        if found != total:
            self.fail(f"got {found} nodes; expected {total}, as its first line says")
        return np.concatenate(points or [np.zeros((0, 3))]), np.concatenate(tags or [_NONE])

    def _elements41(self) -> list[Block]:
        numbers = MshNumbers(self)
        blocks, total, _, _ = numbers.sizes(4)
        found: list[Block] = []
        labels: list[Long] = []
        for _ in range(blocks):
            dimension, entity, type_ = (int(n) for n in numbers.ints(3))
            count = int(numbers.sizes(1)[0])
            kind = self._kind(type_)
            rows = numbers.sizes(count * (1 + NODES[kind])).reshape(count, -1)
            labels.append(rows[:, 0])
            groups = self.physical.get((dimension, entity), _NONE)
            every = np.arange(count)
            # a negative tag is a group that the entity belongs to in the other direction
            found.append((kind, rows[:, 1:], [(abs(int(group)), every) for group in groups]))
        numbers.done()
        cells = sum(len(nodes) for _, nodes, _ in found)
        if cells != total:
            self.fail(f"got {cells} elements; expected {total}, as its first line says")
        self._refuse_twice(np.concatenate(labels or [_NONE]))
        return found

    def _refuse_twice(self, labels: Long) -> None:
        ordered = np.sort(labels)
        twice = ordered[1:][ordered[1:] == ordered[:-1]]
        if twice.size:
            self.fail(
                f"{twice.size} element numbers used twice; got element {twice[0]}; expected each "
                "number once"
            )

    # -- version 2.2 -----------------------------------------------------------------------

    def _nodes22(self) -> tuple[Float, Long]:
        count = self._count(self.line())
        if self.binary:
            layout = np.dtype([("tag", "<i4"), ("x", "<f8", 3)])
            rows = self.take(layout, count)
            return rows["x"].astype(np.float64), rows["tag"].astype(np.int64)
        numbers = MshNumbers(self)
        table = numbers.floats(4 * count).reshape(count, 4)
        numbers.done()
        return table[:, 1:], numbers.whole(table[:, 0])

    def _elements22(self) -> list[Block]:
        count = self._count(self.line())
        numbers = MshNumbers(self)
        flat = numbers.rest()
        # text has number, type and number of tags of each element; binary data have type, number
        # of elements and of tags before so many of them
        behind = 1 if self.binary else 3
        runs: list[tuple[int, int, int, int, int]] = []
        done = 0
        while done < count:
            head = flat[numbers.at : numbers.at + 3].tolist()
            if len(head) < 3:
                self.fail(
                    "it ends before its elements do: the file is cut off, or its counts wrong"
                )
            type_, rows, tags = head if self.binary else (head[1], 1, head[2])
            width = behind + tags + NODES[self._kind(type_, tags)]
            numbers.at += 3 if self.binary else 0
            if rows < 1 or numbers.at + rows * width > len(flat):
                self.fail(
                    f"it ends before its elements do, {rows} of type {type_}: the file is cut off"
                )
            runs.append((numbers.at, rows, width, type_, tags))
            numbers.at += rows * width
            done += rows
        self.at += 4 * numbers.at if self.binary else 0
        numbers.done()
        if done != count:
            self.fail(f"got {done} elements; expected {count}, as its first line says")
        begin, each, widths, types, tags_of = np.array(runs, np.int64).reshape(-1, 5).T
        run, row = expand(each)
        first = begin[run] + row * widths[run]
        return self._blocks22(flat, np.stack([first, types[run], tags_of[run]], axis=1))

    def _blocks22(self, flat: Long, records: Long) -> list[Block]:
        """One block a kind, an element once: it is repeated for each of its groups."""
        first, types, tags = records.T
        start = first + (1 if self.binary else 3)
        blocks: list[Block] = []
        named: list[Long] = []  # number of each row, and which of the different elements it is
        for type_ in dict.fromkeys(types.tolist()):
            rows = np.flatnonzero(types == type_)
            nodes = flat[(start + tags)[rows, None] + np.arange(NODES[GMSH_KINDS[type_]])]
            once, element = unique_rows(nodes)
            named.append(np.stack([flat[first[rows]], sum(map(len, named)) + element], axis=1))
            physical = np.where(tags[rows] > 0, flat[start[rows]], 0)
            groups = [int(tag) for tag in np.unique(physical) if tag]
            if len(groups) > 1:
                nodes = nodes[once]
            else:
                element = np.arange(len(rows))
            members = [(tag, element[physical == tag]) for tag in groups]
            blocks.append((GMSH_KINDS[type_], nodes, members))
        if named:
            self._refuse_different(np.concatenate(named))
        return blocks

    def _refuse_different(self, named: Long) -> None:
        ordered = named[np.lexsort(named.T[::-1])]
        wrong = (ordered[1:, 0] == ordered[:-1, 0]) & (ordered[1:, 1] != ordered[:-1, 1])
        if wrong.any():
            self.fail(
                f"element number {ordered[1:][wrong][0, 0]} names different nodes; expected each "
                "number once"
            )

    # -- numbers to blocks -----------------------------------------------------------------

    def _kind(self, type_: int, tags: int = 0) -> str:
        if tags < 0:
            self.fail(f"an element with {tags} tags; expected 0 or more")
        if type_ not in GMSH_KINDS:
            self.fail(
                f"element type {type_}; expected first or second order, one of "
                f"{', '.join(f'{n} ({k})' for n, k in GMSH_KINDS.items())}"
            )
        return GMSH_KINDS[type_]

    def _raw(self, block: Block, tags: Long) -> RawBlock:
        kind, nodes, groups = block
        self.section = "Elements"
        numbers = index_of(tags, nodes)
        wrong = np.argwhere(numbers < 0)
        if len(wrong):
            self.fail(f"a {kind} names node {nodes[tuple(wrong[0])]}, which isn't there")
        dimension = dimension_of(kind)
        named: dict[str, Long] = {}
        for tag, rows in groups:
            name = self.names.get((dimension, tag), f"{_KIND_NAMES[dimension]}_{tag}")
            named[name] = np.union1d(named.get(name, _NONE), rows)
        return RawBlock(kind, from_gmsh_order(kind, numbers), named)


_NONE = np.zeros(0, dtype=np.int64)
