"""The bytes of a .msh file: lines, sections' numbers as text or binary, and what is wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.files.input_file import InputFile
from gpusim.mesh.file_content.byte_source import ByteSource


class MshSource(ByteSource):
    """A file and the place in it; ``section`` is the one that errors are about."""

    def __init__(self, file: InputFile) -> None:
        super().__init__(file)
        self.section = "MeshFormat"
        self.binary = False

    @property
    def place(self) -> str:
        return f"section ${self.section}"

    def equal_head_records(self, width: int, most: int) -> Long:
        """(M, width) binary records with the same head, from here on."""
        room = (len(self.data) - self.at) // (4 * width)
        if room < 1:
            self.fail("it ends before its elements do: the file is cut off")
        ahead = np.frombuffer(self.data, "<i4", room * width, self.at).reshape(-1, width)
        rows = _alike(ahead[:, :3], most)
        self.at += 4 * rows * width
        return ahead[:rows].astype(np.int64)


class MshNumbers:
    """The numbers of a section, one after another; text is read in one go."""

    def __init__(self, source: MshSource) -> None:
        self.source = source
        self.at = 0
        self.text: Float | None = None
        if source.binary:
            return
        mark = source.data.find(b"$End", source.at)
        if mark < 0:
            source.fail("no end: the file is cut off")
        words = source.data[source.at : mark].split()
        try:
            self.text = np.array(words, dtype=np.float64)  # whole numbers are exact up to 2^53
        except ValueError as error:
            source.fail(f"{error}; expected numbers")
        source.at = mark

    def peek(self, count: int) -> Float:
        """The next numbers, which stay where they are."""
        assert self.text is not None
        if self.at + count > len(self.text):
            self.source.fail("its numbers end too soon: the file is cut off, or its counts wrong")
        return self.text[self.at : self.at + count]

    def floats(self, count: int) -> Float:
        if self.text is None:
            return self.source.take("<f8", count).astype(np.float64)
        part = self.peek(count)
        self.at += count
        return part

    def ints(self, count: int) -> Long:
        return self._whole("<i4", count)

    def sizes(self, count: int) -> Long:
        return self._whole("<i8", count)

    def _whole(self, layout: str, count: int) -> Long:
        if self.text is None:
            return self.source.take(layout, count).astype(np.int64)
        if not 0 <= count <= len(self.text) - self.at:
            self.source.fail(f"it ends before its {count} entries do: the file is cut off")
        return self.whole(self.floats(count))

    def whole(self, part: Float) -> Long:
        """Numbers that must be whole. 2^53 and beyond no longer are in a text's floats."""
        wrong = ~((np.abs(part) < 2.0**53) & (part == np.rint(part)))
        if wrong.any():
            self.source.fail(f"got {part[wrong][0]}; expected a whole number")
        return part.astype(np.int64)

    def alike(self, width: int, most: int) -> Long:
        """(M, width) rows of an element list, as long as type and number of tags stay the same."""
        assert self.text is not None
        room = (len(self.text) - self.at) // width
        if room < 1:
            self.peek(width)
        ahead = self.text[self.at : self.at + room * width].reshape(-1, width)
        rows = _alike(ahead[:, 1:3], most)
        return self._whole("", rows * width).reshape(rows, width)

    def done(self) -> None:
        """Refuse numbers that the section's counts don't speak of."""
        if self.text is not None and self.at != len(self.text):
            extra = len(self.text) - self.at
            self.source.fail(f"{extra} numbers more than its counts say; expected none")


def _alike(heads: npt.NDArray[Any], most: int) -> int:
    """How many of the first rows (at most ``most``) equal the first one. Looks at twice as many
    rows each time, so that short runs in a long list stay cheap."""
    most = min(most, len(heads))
    looked = 1
    while True:
        wanted = min(2 * looked, most)
        same = (heads[:wanted] == heads[0]).all(axis=1)
        if not same.all():
            return int(np.argmin(same))
        if wanted == most:
            return wanted
        looked = wanted
