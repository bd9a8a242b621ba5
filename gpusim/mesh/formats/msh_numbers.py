"""The bytes of a .msh file: lines, sections' numbers as text or binary, and what is wrong."""

from __future__ import annotations

import numpy as np

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

    def floats(self, count: int) -> Float:
        if self.text is None:
            return self.source.take("<f8", count).astype(np.float64)
        if self.at + count > len(self.text):
            self.source.fail("its numbers end too soon: the file is cut off, or its counts wrong")
        self.at += count
        return self.text[self.at - count : self.at]

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

    def rest(self) -> Long:
        """All whole numbers of a section of text; of binary data those up to the file's end."""
        if self.text is not None:
            return self.whole(self.text)
        data, at = self.source.data, self.source.at
        return np.frombuffer(data, "<i4", (len(data) - at) // 4, at).astype(np.int64)

    def done(self) -> None:
        """Refuse numbers that the section's counts don't speak of."""
        if self.text is not None and self.at != len(self.text):
            extra = len(self.text) - self.at
            self.source.fail(f"{extra} numbers more than its counts say; expected none")
