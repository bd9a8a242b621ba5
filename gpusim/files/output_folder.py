"""The output folder: what may be written and deleted in it, and who is writing.

A run's results lie in one folder, OUT. Names of files in it come from scenes, from ``.gpusim``
and from the folder itself, any of which may be damaged or made to do harm. `inside` alone turns a
name into a path, for whoever writes or deletes; `claim` lets one process write at a time.
OUT may be a link that the user chose. What lies below may not: a link there would lead outside.
"""

from __future__ import annotations

import json
import os
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from gpusim.errors import InputError, require

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LOCK = ".gpusim-lock"
_LONGEST = 200
"""Bytes of a name; the file systems' 255 less what a temporary name adds."""
_ATTEMPTS = 100
_AT_ONCE = getattr(os, "O_NONBLOCK", 0)  # a device may let one wait for ever

PathLike = str | os.PathLike[str]


def inside(folder: PathLike, *names: str) -> Path:
    """The path of a name inside ``folder``; nothing need exist there.

    Parameters
    ----------
    folder : OUT, or a folder in it that this function has returned.
    names : relative names one below the other; each may have several parts (``images/0000.png``).

    Raises
    ------
    InputError
        A name that is empty, absolute, too long, or has ``..`` or a NUL in it; a link at the path
        or at a folder between ``folder`` and it.
    """
    path = Path(folder)
    for name in names:
        parts = name.replace("\\", "/").split("/") if os.name == "nt" else name.split("/")
        problem = next(filter(None, map(_problem, parts)), "")
        what = f"{folder}: a name that leads out of it, or is none ({problem})"
        require(not problem, what, _shown(name), "the name of a file inside the folder")
        for part in parts:
            path = path / part
            if os.path.islink(path):
                rule = f"in an output folder: nothing outside of {folder} is written or deleted"
                got = f"got one to {os.path.realpath(path)}"
                raise InputError(f"{path}: is a link; {got}; expected no links {rule}")
    return path


def delete(folder: PathLike, name: str) -> None:
    """Delete a file inside ``folder``, and folders between the two that are then empty.

    Nothing happens if it isn't there. Raises InputError as `inside`.
    """
    path = inside(folder, name)
    path.unlink(missing_ok=True)
    for parent in path.parents:
        if parent == Path(folder):
            return
        try:
            parent.rmdir()
        except OSError:  # something is left in it
            return


def check_below(folder: PathLike, *names: str) -> None:
    """Raises InputError for what would stop or mislead who writes into folders ``names`` of
    ``folder``: a file of that name, a link anywhere below, a folder that can't be written to."""
    for name in names:
        place = inside(folder, name)
        if place.exists() and not place.is_dir():
            expected = "expected a folder, or nothing of that name"
            raise InputError(f"run: {place} is no folder; {expected}")
        for above, folders, files in os.walk(place):
            if not os.access(above, os.W_OK | os.X_OK):
                raise InputError(f"{above}: can't be written to; expected a folder of yours")
            for below in (*folders, *files):
                if os.path.islink(os.path.join(above, below)):
                    inside(above, below)


def check_folder(folder: PathLike) -> None:
    """Raises InputError for a folder that couldn't be one for results: no name, a name too long,
    a file, a place in a file, or one that can't be written to. Nothing is made."""
    named = isinstance(folder, str | os.PathLike)
    require(named, "output folder", repr(folder), "the name of a folder")
    require(bool(os.fspath(folder)), "output folder: no name", "''", "the name of a folder")
    path = Path(folder)
    try:
        existing = next(one for one in (path, *path.absolute().parents) if _is_there(one))
    except (OSError, ValueError) as error:
        raise _unusable(path, error) from None
    what, expected = "output folder: not a folder", "a folder, or a new name"
    require(existing.is_dir(), what, existing, expected)
    writable = os.access(existing, os.W_OK | os.X_OK)
    require(writable, "output folder: can't be written to", existing, "a folder of yours")


@contextmanager
def claim(folder: PathLike) -> Iterator[Path]:
    """Be the only one that writes into ``folder`` while the block runs; gives its absolute path.

    The folder is made if need be, and removed again if the block leaves nothing in it. The file
    ``.gpusim-lock`` in it names the owner. The system unlocks it when that process ends, however it
    ends, so what a killed one leaves is no obstacle. Where files can't be locked (some network file
    systems, Windows) an owner on this machine that has ended makes way; one on another machine
    doesn't.

    Raises
    ------
    InputError
        Naming the owner, at once: somebody else has it. Or as `check_folder`.
    """
    check_folder(folder)
    path = Path(folder)
    made = [one for one in (path, *path.absolute().parents) if not _is_there(one)]
    try:
        path.mkdir(parents=True, exist_ok=True)
        root = path.resolve()
        descriptor = _locked(inside(root, LOCK), path)
    except OSError as error:
        _remove(made)
        raise _unusable(path, error) from None
    try:
        yield root
    finally:
        with suppress(OSError):  # before it is unlocked: the next one makes a file of its own
            (root / LOCK).unlink()
        if fcntl is not None:  # explicitly: a copy of this process would hold it, too
            with suppress(OSError):
                fcntl.flock(descriptor, fcntl.LOCK_UN)
        os.close(descriptor)
        _remove(made)


@dataclass(frozen=True)
class _Owner:
    pid: int
    host: str
    since: str

    def __str__(self) -> str:
        where = "" if self.host == socket.gethostname() else f" on {self.host}"
        return f"process {self.pid}{where} since {self.since}"

    @property
    def has_ended(self) -> bool:
        """Whether it is known to: another machine's processes aren't seen from here."""
        return self.host == socket.gethostname() and not is_alive(self.pid)


def is_alive(pid: int) -> bool:
    """Whether a process of that number runs on this machine."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # it runs, as someone else
        return True
    return True


def _locked(path: Path, folder: Path) -> int:
    """A descriptor of the lock file, which is ours. Raises InputError if it is somebody else's."""
    for _ in range(_ATTEMPTS):
        try:
            descriptor, new = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644), True
        except FileExistsError:
            try:
                descriptor, new = os.open(path, os.O_RDWR | _AT_ONCE), False
            except FileNotFoundError:
                continue
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise InputError(f"{path}: is a device or pipe; expected a plain file, or none")
        free = _lock(descriptor)
        if free is None:
            owner = None if new else _owner(descriptor)
            free = new
            if owner is not None and owner.has_ended:
                path.unlink(missing_ok=True)
                os.close(descriptor)
                continue
        if not free:
            owner = _owner(descriptor)
            os.close(descriptor)
            what = f"{folder} is in use by {owner or 'another process'}"
            advice = f"wait for it, or name another folder (its lock: {path.name})"
            raise InputError(f"{what}; expected one run per output folder at a time: {advice}")
        if not _is_still(path, descriptor):  # the one before us has deleted it meanwhile
            os.close(descriptor)
            continue
        owner = _Owner(os.getpid(), socket.gethostname(), time.strftime("%Y-%m-%d %H:%M:%S"))
        os.ftruncate(descriptor, 0)
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.write(descriptor, json.dumps(asdict(owner)).encode() + b"\n")
        return descriptor
    what = f"{folder}: its lock {path} comes and goes"
    raise InputError(f"{what}; expected one run per output folder")


def _lock(descriptor: int) -> bool | None:
    """Whether the file is locked for us now; None where files can't be locked."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _is_still(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _owner(descriptor: int) -> _Owner | None:
    """Who has written the lock file; None before that, or if it is damaged."""
    try:
        os.lseek(descriptor, 0, os.SEEK_SET)
        content = json.loads(os.read(descriptor, 4096))
        return _Owner(int(content["pid"]), str(content["host"]), str(content["since"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _is_there(path: Path) -> bool:
    """Whether something has that name; OSError or ValueError for what is no name."""
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def _remove(folders: list[Path]) -> None:
    """Remove those that are empty, the innermost first."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return


def _unusable(path: Path, error: Exception) -> InputError:
    reason = (isinstance(error, OSError) and error.strerror) or str(error)
    return InputError(
        f"output folder: can't be made or written to; got {_shown(str(path))} ({reason}); "
        "expected a folder of yours"
    )


def _problem(part: str) -> str:
    """What is wrong with one part of a name, or ""."""
    if part in ("", ".", ".."):
        return f"a part {part!r}" if part else "an empty part"
    if "\0" in part:
        return "a NUL"
    if os.name == "nt" and ":" in part:
        return "a drive"
    try:
        length = len(os.fsencode(part))
    except UnicodeEncodeError:
        return "letters that no file system knows"
    return f"{length} bytes in one part, at most {_LONGEST}" if length > _LONGEST else ""


def _shown(name: str) -> str:
    return repr(name if len(name) <= 80 else f"{name[:60]}… ({len(name)} characters)")
