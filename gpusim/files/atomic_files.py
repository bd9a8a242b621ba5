"""Files that are either whole or absent.

A file is written under a temporary name (``.<name>.<pid>-<random>.part``) in the folder it belongs
to, flushed to the disk and renamed. Renaming within one folder is atomic, so a reader never sees
half a file and a killed process leaves at most a ``.part``, which `clean_leftovers` removes.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from gpusim.errors import GpusimError, InputError
from gpusim.files.output_folder import is_alive

PathLike = str | os.PathLike[str]

_LEFTOVER = re.compile(r"^\..+\.(\d+)-[0-9a-f]+\.part$")
_SHORT = re.compile(r"\d+ requested and \d+ written")
"""All that NumPy says of a file that can't take what it writes."""
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_REFUSED = {
    errno.EACCES,
    errno.EPERM,
    errno.EROFS,
    errno.EEXIST,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.ENAMETOOLONG,
}


@contextmanager
def atomic_path(path: PathLike) -> Iterator[Path]:
    """Give a temporary path to write to; rename it to ``path`` if the block ends well.

    Missing parent folders are created. If the block raises, the temporary file is removed and
    ``path`` stays as it was. The writer has to be told the format: the suffix is ``.part``.

    Raises
    ------
    InputError
        The place can't be written to (permission, read-only, a folder in the way).
    GpusimError
        The disk is full, or the block wrote no file.

    Examples
    --------
    >>> with gs.export.atomic_path("notes.txt") as path:
    ...     _ = path.write_text("all or nothing", encoding="utf-8")
    """
    final = Path(path)
    part = final.with_name(f".{final.name}.{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        if final.is_dir():
            raise InputError(f"write: {final} is a folder; expected a file name")
        yield part
        if not part.is_file():
            raise GpusimError(f"write: {final}: nothing was written")
        flush(part)
        os.replace(part, final)
        flush(final.parent)
    except OSError as error:
        raise explained(error, part, final) from error
    finally:
        _forget(part)


@contextmanager
def atomic_stream(path: PathLike) -> Iterator[BinaryIO]:
    """Give a binary stream whose content appears at ``path`` if the block ends well.

    Raises as `atomic_path` does.

    Examples
    --------
    >>> with gs.export.atomic_stream("notes.txt") as stream:
    ...     _ = stream.write(b"all or nothing")
    """
    with atomic_path(path) as part, open(part, "xb") as stream:
        yield stream


def write_bytes(path: PathLike, data: bytes) -> Path:
    """Write ``data`` to ``path`` atomically and return the path."""
    with atomic_stream(path) as stream:
        stream.write(data)
    return Path(path)


def write_text(path: PathLike, text: str) -> Path:
    """Write ``text`` as UTF-8 with ``\\n`` line ends to ``path`` atomically; return the path."""
    return write_bytes(path, text.encode("utf-8"))


def clean_leftovers(folder: PathLike) -> tuple[Path, ...]:
    """Remove the temporary files that killed processes left below ``folder``; return their paths.

    Files of processes that still run are kept, so two runs into one folder don't hurt each other.

    Examples
    --------
    >>> gs.export.clean_leftovers(".")
    ()
    """
    removed = []
    for part in sorted(Path(folder).rglob(".*.part")):
        match = _LEFTOVER.match(part.name)
        if match and part.is_file() and not is_alive(int(match.group(1))):
            _forget(part)
            removed.append(part)
    return tuple(removed)


def safe_name(name: str) -> str:
    """Return ``name`` as one harmless path component: letters, digits, ``._-``, no leading dot,
    at most 120 bytes.

    Raises InputError if nothing is left of it.

    Examples
    --------
    >>> gs.export.safe_name("side / left")
    'side_left'
    """
    safe = re.sub(r"[^\w.-]+", "_", name).strip("._")
    safe = safe.encode("utf-8", "ignore")[:120].decode("utf-8", "ignore")
    if not safe:
        raise InputError(f"file name: got {name!r}; expected at least one letter or digit")
    return safe


def flush(path: Path) -> None:
    """Wait until a file's or folder's content is on the disk."""
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except PermissionError:
        if os.name == "nt":  # Windows opens no folders; its rename needs no flush of them
            return
        raise
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # some network file systems can't flush a folder
            raise
    finally:
        os.close(descriptor)


def _forget(part: Path) -> None:
    try:
        part.unlink(missing_ok=True)
    except OSError:  # the folder is gone or unwritable; the error that led here says more
        return


def explained(error: OSError, part: Path, final: Path) -> Exception:
    """Turn an OSError about this file into one clear message; leave all others as they are."""
    ours = {str(part), str(final), str(final.parent)}
    if error.filename is not None and str(error.filename) not in ours:
        parents = {str(parent) for parent in final.parents}
        if str(error.filename) not in parents:
            return error
    short = _SHORT.fullmatch(str(error))
    if error.errno in _FULL or short:
        cause = str(error) if short else os.strerror(error.errno or 0)
        return GpusimError(f"write: {final}: the disk is full or over quota ({cause})")
    if error.errno in _REFUSED:
        return InputError(
            f"write: {final}: {os.strerror(error.errno)}; expected a place that can be written to"
        )
    return error
