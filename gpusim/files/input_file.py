"""Input files, read once: the bytes that are hashed are the bytes that are used.

Everything that reads a mesh, deck, field, picture, calibration or scene file begins with
`read_input` and goes on with what that returns. A file that is edited, replaced or removed while a
run goes on can therefore never be mistaken for what was read. Some files name others: those that
mesh files and decks include, and the mesh file of each time in ParaView's .pvd and .series.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import stat
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from os import PathLike
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

from gpusim.errors import InputError, require


@dataclass(frozen=True, eq=False)
class InputFile:
    """A file's bytes as they were at one moment, and where they came from."""

    path: Path
    data: bytes = field(repr=False)
    known: Mapping[str, str] = field(default_factory=dict, repr=False)
    """SHA-256 by path of files that this one may name, as somebody saw them before."""

    @cached_property
    def sha256(self) -> str:
        """Hexadecimal SHA-256 of `data`."""
        return hashlib.sha256(self.data).hexdigest()

    @property
    def suffix(self) -> str:
        """The name's ending in lower case: ``.vtu``."""
        return self.path.suffix.lower()

    def beside(self, name: str | os.PathLike[str], expected: str = "a file") -> InputFile:
        """A file that this one names; a relative name is one in its folder.

        Raises InputError as `read_input`, also for one that isn't what is `known` of it, or of
        which nothing is known where all was looked at before.
        """
        path = self.path.parent / name
        if self.known and str(path) not in self.known:
            what = f"{self.path}: names {name}, which wasn't found when the scene was loaded"
            raise InputError(f"{what}; expected a plain name, on the line of its keyword")
        return read_input(path, expected, self.known.get(str(path)), self.known)

    def stream(self) -> io.BytesIO:
        """A new binary stream over `data`, at its beginning."""
        return io.BytesIO(self.data)

    def text(self, expected: str = "a text file") -> str:
        """`data` as UTF-8, without a byte order mark. Raises InputError for other bytes."""
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            got = f"byte {error.start} that is no UTF-8"
            raise InputError(f"{self.path}: not a text; got {got}; expected {expected}") from None

    @contextmanager
    def on_disk(self) -> Iterator[Path]:
        """A private copy of that name, for libraries that open files themselves."""
        with tempfile.TemporaryDirectory(prefix="gpusim-") as folder:
            copy = Path(folder) / self.path.name
            copy.write_bytes(self.data)
            yield copy


Stamp = tuple[int, int, int]
"""Number, size and time of change of a file."""
Reader = Callable[[str], InputFile]
"""Reads a file by its path: `read_input`, or `Scene.input`, which knows what it has to be."""


def read_input(
    source: str | os.PathLike[str] | InputFile,
    expected: str = "a file",
    sha256: str | None = None,
    known: Mapping[str, str] | None = None,
) -> InputFile:
    """Read a file whole; one that was read already is returned as it is.

    Parameters
    ----------
    source : a path, or what an earlier call returned.
    expected : what the file should be, for the message.
    sha256 : what it was when somebody looked before (None: nobody did).
    known : the same by path, for the files that it may name (`InputFile.beside`).

    Raises
    ------
    InputError
        Naming the file: not found, a folder, a device or pipe, unreadable, larger than the memory,
        or changed since it had the hash ``sha256``.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "a.txt"
    >>> _ = path.write_text("abc")
    >>> read_input(path).sha256[:8]
    'ba7816bf'
    """
    file = source if isinstance(source, InputFile) else _read(source, expected)
    if known is not None:
        file = InputFile(file.path, file.data, known)
    if sha256 is not None:
        what = f"{file.path}: was changed after it was first read"
        expected = "the same file during a whole run: load the scene again"
        require(file.sha256 == sha256, what, "other bytes", expected)
    return file


def open_input(path: str | os.PathLike[str], expected: str = "a file") -> io.BufferedReader:
    """A stream of a file that may be too large to be read whole.

    Raises InputError as `read_input` does: for a pipe or device, too, without waiting for it.
    """
    path = Path(path)
    try:
        stream = open(path, "rb", opener=_open)
        if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            return stream
        stream.close()
        problem = "is a device or pipe"
    except FileNotFoundError:
        problem = "not found"
    except IsADirectoryError:
        problem = "is a folder"
    except ValueError as error:  # a NUL in the name
        problem = f"no name of a file ({error})"
    except OSError as error:
        problem = f"unreadable ({error.strerror or error})"
    raise InputError(f"{path}: {problem}; expected {expected}")


def file_stamp(path: str | os.PathLike[str]) -> Stamp | None:
    """What changes whenever a file is written or replaced; None where there is none."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def _read(source: str | os.PathLike[str], expected: str) -> InputFile:
    path = Path(source)
    with open_input(path, expected) as stream:
        try:
            return InputFile(path, stream.read())
        except MemoryError:
            problem = f"larger than the memory ({path.stat().st_size / 1e9:.1f} GB)"
        except OSError as error:
            problem = f"unreadable ({error.strerror or error})"
    raise InputError(f"{path}: {problem}; expected {expected}")


def _open(path: str, flags: int) -> int:
    # non-blocking: to open a pipe that nobody writes to would wait for ever
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


_ABAQUS = re.compile(rb"^[ \t]*\*\s*INCLUDE\s*,\s*INPUT\s*=\s*([^,\r\n]+)", re.I | re.M)
_NASTRAN = re.compile(rb"^[ \t]*INCLUDE\b[\s=]*('[^']*'|\"[^\"]*\"|[^\r\n$'\"]+)", re.I | re.M)
_STATEMENTS = {".inp": _ABAQUS} | dict.fromkeys((".bdf", ".nas", ".fem", ".dat"), _NASTRAN)
_REST = rb"[ \t]+((?:[^\r\n\\]|\\[ \t]*\r?\n|\\)+)"  # of a line, and of those that continue it
_LIBRARY = re.compile(rb"^(?:\xef\xbb\xbf)?[ \t]*mtllib" + _REST, re.M)
_PICTURE = re.compile(rb"^(?:\xef\xbb\xbf)?[ \t]*map_Kd" + _REST, re.M | re.I)
"""Materials and pictures, which may be missing where nothing is painted with them."""
_URI = re.compile(rb'"uri"\s*:\s*("(?!data:)(?:[^"\\]|\\.)*")')
"""Of a glTF file's buffers and pictures."""
_MOST, _MOST_WORDS = 1000, 32


def included_files(file: InputFile) -> tuple[InputFile, ...]:
    """All files that a mesh file names with *INCLUDE or INCLUDE, and those that they name; an
    OBJ's materials and their pictures, and what a glTF names, if they are there.

    Raises InputError for one that can't be read; readers say in which line it is named. Files of
    other kinds include nothing.
    """
    if file.suffix == ".obj":
        libraries = _looks(file, _LIBRARY)
        return (*libraries, *(one for mtl in libraries for one in _looks(mtl, _PICTURE)))
    if file.suffix in (".glb", ".gltf"):
        return tuple(read_input(path) for path in _gltf_files(file))
    statement = _STATEMENTS.get(file.suffix)
    if statement is None:
        return ()
    found = {str(file.path): file}
    waiting = [file]
    while waiting:
        parent = waiting.pop()
        for name in statement.findall(parent.data):
            child = parent.path.parent / _text(name)
            if str(child) not in found:
                few, got = len(found) <= _MOST, f"more than {_MOST} included files"
                require(few, f"{file.path}", got, "fewer")
                found[str(child)] = read_input(child, "an included file")
                waiting.append(found[str(child)])
    return tuple(found.values())[1:]


def _gltf_files(file: InputFile) -> list[Path]:
    """The files that a glTF names, if they are there."""
    binary = file.data[:4] == b"glTF"
    text = file.data[: 20 + int.from_bytes(file.data[12:16], "little")] if binary else file.data
    names = set()
    for quoted in _URI.findall(text):
        with suppress(ValueError):  # which is said where it is read
            names.add(file.path.parent / unquote(json.loads(quoted)))
    return sorted(path for path in names if os.path.isfile(path))


def _looks(file: InputFile, statement: re.Pattern[bytes]) -> list[InputFile]:
    """What may be named by its statements, after options, with blanks or beside others, if it is
    there."""
    names = set()
    for rest in statement.findall(file.data):
        words = re.sub(rb"\\[ \t]*\r?\n", b" ", rest).strip()
        for count, word in enumerate(words.split()[:_MOST_WORDS]):
            names |= {words.split(None, count)[-1], word}
    found = set()
    for name in names:
        plain = str(_text(name))
        found |= {file.path.parent / one for one in (plain, plain.replace("\\", "/"))}
    return [read_input(path) for path in sorted(found) if os.path.isfile(path)]


def _text(name: bytes) -> Path:
    """A name without its quotes, and without the line ends within them."""
    raw = re.sub(rb"[ \t]*\r?\n", b"", name.strip()).strip(b"'\" \t").replace(b"\0", b"")
    try:
        return Path(raw.decode("utf-8"))
    except UnicodeDecodeError:
        return Path(raw.decode("latin-1"))


SERIES_SUFFIXES = (".pvd", ".series")
RENDERED = "gpusim render --field FILE makes pictures and truth of displacements"


def results_hint(path: str | PathLike[str]) -> str:
    """For errors: how to go on with a file of results, "; …"; "" for what is none."""
    suffix = Path(path).suffix.lower()
    if suffix == ".odb":
        return f"; have displacements saved as .vtu, Exodus or .npz: {RENDERED}"
    return f"; {RENDERED}" if suffix in (*SERIES_SUFFIXES, ".frd", ".npz") else ""


def read_series(path: str | PathLike[str] | InputFile) -> list[tuple[float, Path]]:
    """(time, file) of each step, in growing time; relative files lie beside ``path``.

    Raises InputError, naming the file: unreadable, empty, times that don't grow (of parallel
    pieces, for example, which share theirs).
    """
    source = read_input(path, "a list of files")
    file, text = source.path, source.text("a list of files")
    try:
        rows = _pvd(text) if source.suffix == ".pvd" else _json(text)
    except (
        ElementTree.ParseError,
        ValueError,
        ArithmeticError,
        LookupError,
        TypeError,
        RecursionError,
    ) as error:
        raise InputError(
            f"{file}: not a list of files with their times; got {type(error).__name__}: {error}; "
            "expected ParaView's .pvd or .series"
        ) from None
    steps = sorted((time, file.parent / name) for time, name in rows)
    require(len(steps) > 0, f"{file}", "no files", "one per time")
    for (a, first), (b, second) in pairwise(steps):
        got = f"{first.name} and {second.name}"
        expected = "one file per time, not pieces of a parallel run"
        require(a < b, f"{file}: two files of time {b:g}", got, expected)
    return steps


def _pvd(text: str) -> list[tuple[float, str]]:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError("definitions of its own (DOCTYPE)")
    entries = ElementTree.fromstring(text).iter("DataSet")
    return [(float(entry.attrib["timestep"]), entry.attrib["file"]) for entry in entries]


def _json(text: str) -> list[tuple[float, str]]:
    return [(float(entry["time"]), str(entry["name"])) for entry in json.loads(text)["files"]]
