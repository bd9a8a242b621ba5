"""Files of text and binary numbers, read from a place in their bytes on."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile


class ByteSource:
    """A file and the place ``at`` in it, from which the next line or numbers are taken."""

    def __init__(self, file: InputFile, at: int = 0) -> None:
        self.source = str(file.path)
        self.data = file.data
        self.at = at

    @property
    def place(self) -> str:
        """What the next error is about."""
        return f"byte {self.at}"

    def fail(self, problem: str) -> NoReturn:
        raise InputError(f"{self.source}: {self.place}: {problem}")

    @property
    def at_end(self) -> bool:
        return self.at >= len(self.data)

    def line(self) -> str:
        """The next line, stripped; "" at the end of the file."""
        end = self.data.find(b"\n", self.at)
        end = len(self.data) if end < 0 else end
        line = self.data[self.at : end]
        try:
            text = line.decode("utf-8").strip()
        except UnicodeDecodeError:
            self.fail("bytes that are no text where a line of text is expected: damaged?")
        self.at = min(end + 1, len(self.data))
        return text

    def text_line(self) -> str:
        """The next line that isn't empty; "" at the end of the file."""
        line = ""
        while not line and not self.at_end:
            line = self.line()
        return line

    def take(self, layout: npt.DTypeLike, count: int) -> npt.NDArray[Any]:
        """``count`` binary numbers, or records, from here on."""
        kind = np.dtype(layout)
        if count < 0 or self.at + count * kind.itemsize > len(self.data):
            self.fail(f"it ends before its {count} entries do: the file is cut off")
        rows = np.frombuffer(self.data, dtype=kind, count=count, offset=self.at)
        self.at += count * kind.itemsize
        return rows
