"""The lines of a text file from anywhere: line ends of every system, comments in Latin-1."""

from __future__ import annotations

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile

__all__ = ["text_lines"]


def text_lines(file: InputFile, expected: str) -> list[str]:
    """Lines without their ends; the last one is empty where the file ends with a line's end.

    Text is UTF-8, else Latin-1, in which older programs write comments and names. Only line feeds
    and carriage returns part lines: `str.splitlines` would also part them at letters that Latin-1
    has, and take the rest of a comment for data. Raises InputError for binary data.
    """
    if b"\0" in file.data:
        raise InputError(f"{file.path}: not a text file; got binary data; expected {expected}")
    try:
        text = file.data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = file.data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
