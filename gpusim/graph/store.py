"""Results by content: shared by the runs, variants and processes that use one store.

``blobs/ab/<sha256>``: files, never changed once they are there. ``log/<pid>-<random>.log``: which
key has made which files; a writer appends to a log of its own and reads those of the others, so
nobody waits. ``claims``: a byte of it is locked for each key that somebody is making just now:
advice, so that nothing is made twice; nothing that is right depends on it, and the system frees
what a killed process held.
"""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import shutil
import stat
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO

from gpusim.errors import GpusimError, InputError
from gpusim.files.atomic_files import clean_leftovers, explained, flush
from gpusim.files.input_file import InputFile, open_input, read_input
from gpusim.files.output_folder import inside, is_alive
from gpusim.graph.log import Log, read_log
from gpusim.graph.stage import Output

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

DAMAGED = KeyError, TypeError, ValueError, AttributeError, OverflowError
"""What a line raises that isn't as it was written."""

_TOGETHER = "0-"
"""How names of logs begin that were put together: no process has the number 0."""
_FLUSHERS = 16
"""Threads that wait for the disk at the end: file systems write together what waits together."""


class ResultChanged(InputError):
    """A result isn't what it was any more, and can be made again."""


@dataclass(frozen=True)
class FileFacts:
    """A file's content, its size, and when its blob was last changed."""

    sha256: str
    size: int
    changed_ns: int


@dataclass(frozen=True)
class Record:
    """What a stage has made for a key."""

    key: str
    stage: str
    files: Mapping[str, FileFacts] = field(default_factory=dict)
    notes: Mapping[str, Any] = field(default_factory=dict)

    def content(self) -> dict[str, Any]:
        """Plain data."""
        files = {name: [one.sha256, one.size, one.changed_ns] for name, one in self.files.items()}
        return {"key": self.key, "stage": self.stage, "files": files, "notes": self.notes}

    @staticmethod
    def of(content: Mapping[str, Any]) -> Record:
        """The inverse. Raises one of `DAMAGED`."""
        files = {}
        for name, (sha256, size, changed) in content["files"].items():
            if len(bytes.fromhex(sha256)) != 32:
                raise ValueError(f"{sha256!r} is no SHA-256")
            files[str(name)] = FileFacts(sha256, int(size), int(changed))
        return Record(str(content["key"]), str(content["stage"]), files, dict(content["notes"]))


class Store:
    """Results by key. Nothing is made on the disk before there is one to be kept.

    ``begun``: whether there were results in it at first.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._name = f"{os.getpid()}-{secrets.token_hex(4)}"
        self._log = Log(root / "log" / f"{self._name}.log")
        self._records: dict[str, Record] = {}
        self._read_to: dict[str, int] = {}
        self._aside: dict[str, Record] = {}
        self._doubted: set[str] = set()  # of writers that didn't close: hashed before they are used
        self._unflushed: set[str] = set()
        self._claims = -1
        self._lock = Lock()
        self.refresh()
        self.begun = bool(self._records)

    def refresh(self) -> None:
        """Take in what others have added."""
        for path in _plain_files(self.root / "log"):
            start = self._read_to.get(path.name, 0)
            with suppress(FileNotFoundError):  # put together with others meanwhile
                if path == self._log.path or path.stat().st_size == start:
                    continue
            lines, self._read_to[path.name] = read_log(path, start)
            closed = any("closed" in line for line in lines)
            for line in lines:
                with suppress(*DAMAGED):
                    record = Record.of(line)
                    if record.key in self._aside and path.name.startswith(_TOGETHER):
                        continue  # it was made before it was put aside
                    self._records[record.key] = record
                    if not closed:
                        self._doubted.add(record.key)

    def find(self, key: str) -> Record | None:
        """What was made for a key, whether it is still whole or not."""
        return self._records.get(key)

    def fault(self, key: str, stage: str, verify: bool = False) -> str | None:
        """None if a ``stage``'s result lies there unchanged, "" if there is none, else what is
        wrong with it: it is forgotten then. Files are known by size and time of change; ``verify``:
        by every byte."""
        record = self._records.get(key)
        if record is None or record.stage != stage:
            return ""
        hashed = verify or key in self._doubted
        for name, facts in record.files.items():
            path = self.blob(facts.sha256)
            if not is_unchanged(path, facts, hashed):
                del self._records[key]
                said = name.removeprefix(".")
                return f"{said} was changed" if path.is_file() else f"{said} is gone"
        self._doubted.discard(key)
        return None

    def forget(self, key: str) -> None:
        """Put aside what was made for a key by now: it isn't found, but others may have it."""
        record = self._records.pop(key, None)
        if record is not None:
            self._aside[key] = record

    def blob(self, sha256: str) -> Path:
        """Where a content lies, or would lie."""
        return self.root / "blobs" / sha256[:2] / sha256

    def put(
        self, key: str, stage: str, outputs: Mapping[str, Output], notes: Mapping[str, Any]
    ) -> Record:
        """Keep a result: each file whole or not at all, then a line that says so.

        Raises
        ------
        GpusimError, InputError
            The disk is full, or the store can't be written to.
        """
        try:
            files = {name: self._keep(name, output) for name, output in outputs.items()}
            return self._enter(Record(key, stage, files, notes))
        except OSError as error:
            place = Path(error.filename or self.root)
            raise explained(error, place, place) from error

    def move(self, record: Record, facts: FileFacts) -> None:
        """Let a file that is kept stand for those of a result, which it holds."""
        self._enter(replace(record, files=dict.fromkeys(record.files, facts)))

    def _enter(self, record: Record) -> Record:
        self._append(record.content())
        self._records[record.key] = record
        self._aside.pop(record.key, None)
        self._doubted.discard(record.key)
        return record

    def _append(self, content: Mapping[str, Any]) -> None:
        inside(self.root, "log")
        self._log.append(content)

    def _keep(self, name: str, output: Output) -> FileFacts:
        suffix = Path(name).suffix
        folder = inside(self.root, "blobs")
        folder.mkdir(parents=True, exist_ok=True)
        part = folder / f".new-{os.getpid()}-{secrets.token_hex(4)}{suffix}"
        try:
            if isinstance(output, bytes):
                part.write_bytes(output)
            elif isinstance(output, Path):
                os.replace(output, part)
            else:
                output(part)
            sha256, written = _hash(part), part.stat()
            facts = FileFacts(sha256, written.st_size, written.st_mtime_ns)
            path = inside(folder, sha256[:2], sha256)
            with suppress(FileNotFoundError):
                known = FileFacts(sha256, facts.size, path.stat().st_mtime_ns)
                if is_unchanged(path, known, hashed=True):
                    return known
            path.parent.mkdir(exist_ok=True)
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
        with self._lock:
            self._unflushed.add(sha256)
        return facts

    def scratch(self) -> Path:
        """A new folder for files that are to be kept; whoever asks for it deletes it."""
        path = inside(self.root, f"scratch/{os.getpid()}-{secrets.token_hex(4)}")
        path.mkdir(parents=True)
        return path

    def read(self, record: Record, name: str) -> InputFile:
        """A file of a result. Raises ResultChanged if it isn't what it was: the record is forgotten
        then."""
        facts = record.files[name]
        try:
            return read_input(self.blob(facts.sha256), f"the result {name}", facts.sha256)
        except InputError as error:
            self._records.pop(record.key, None)
            raise ResultChanged(f"{name}: {error}; run again to make it anew") from None

    def open(self, record: Record, name: str) -> BinaryIO:
        """As `read`, a stream of a file that may be too large to be read whole."""
        facts = record.files[name]
        path = self.blob(facts.sha256)
        if not is_unchanged(path, facts, hashed=True):
            self._records.pop(record.key, None)
            raise ResultChanged(f"{name}: {path} was changed; run again to make it anew")
        return open_input(path)

    def claim(self, key: str) -> bool:
        """Whether nobody else is making this now."""
        if fcntl is None:
            return True
        try:
            claims = self._claims_file()
        except OSError:  # nothing can be kept then, which `put` says
            return True
        try:
            fcntl.lockf(claims, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, int(key[:15], 16))
        except OSError as error:
            return error.errno not in (errno.EACCES, errno.EAGAIN)  # else: files can't be locked
        return True

    def release(self, key: str) -> None:
        """Let others make it, or see that it is made."""
        if fcntl is not None:
            with suppress(OSError):
                fcntl.lockf(self._claims_file(), fcntl.LOCK_UN, 1, int(key[:15], 16))

    def _claims_file(self) -> int:
        if self._claims < 0:
            self.root.mkdir(parents=True, exist_ok=True)
            path = inside(self.root, "claims")
            self._claims = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NONBLOCK", 0))
        return self._claims

    def clean(self) -> None:
        """Delete what killed writers have left half-written. Raises InputError where something
        leads outside."""
        for path in _plain_files(inside(self.root, "blobs"), ".new-*"):
            if _has_ended(path.name.split("-")[1]):
                path.unlink(missing_ok=True)
        clean_leftovers(inside(self.root, "log"))
        scratch = inside(self.root, "scratch")
        with suppress(OSError):  # there is none, or something is left in it
            for path in scratch.iterdir():
                if _has_ended(path.name.split("-")[0]):
                    shutil.rmtree(path, ignore_errors=True)
            scratch.rmdir()

    def close(self) -> None:
        """Flush what was added, and put the logs of writers that have ended together in one."""
        if self._claims >= 0:
            os.close(self._claims)
            self._claims = -1
        self._log.close()
        with suppress(OSError):  # somebody else is at work
            (self.root / "scratch").rmdir()
        ended = [
            path for path in _plain_files(inside(self.root, "log"))
            if path == self._log.path or _has_ended(path.name.split("-")[0])
        ]  # fmt: skip
        if [path.name[:2] for path in ended] in ([], [_TOGETHER]):
            return
        self.refresh()  # after that: what others put together meanwhile stays
        self._records = self._aside | self._records
        for key in self._doubted & self._records.keys():
            record = self._records[key]
            if self.fault(key, record.stage) is None:
                files = record.files.values()
                self._unflushed.update(facts.sha256 for facts in files)
        with ThreadPoolExecutor(_FLUSHERS) as pool:
            list(pool.map(_flush, map(self.blob, self._unflushed)))
        whole = Log(self.root / "log" / f".log.{self._name}.part")
        try:
            for content in (*(one.content() for one in self._records.values()), {"closed": True}):
                whole.append(content)
            whole.close()
            os.replace(whole.path, self.root / "log" / f"{_TOGETHER}{secrets.token_hex(4)}.log")
            for path in ended:
                path.unlink(missing_ok=True)
        except OSError:  # full, or read alone: they stay as they are, and are doubted
            with suppress(OSError):
                whole.path.unlink(missing_ok=True)

    def drop(self, keys: Iterable[str]) -> None:
        """Delete the files of results that nobody needs any more, though others are at work; who
        needs one all the same sees that it is gone."""
        self.refresh()
        dropped = [self._records.pop(key) for key in keys if key in self._records]
        needed = {facts.sha256 for one in self._records.values() for facts in one.files.values()}
        for facts in (facts for one in dropped for facts in one.files.values()):
            if facts.sha256 not in needed:
                inside(self.root, "blobs", facts.sha256[:2], facts.sha256).unlink(missing_ok=True)

    def collect(self, keys: Iterable[str]) -> None:
        """Forget all results but those of ``keys``, and delete the files that nobody needs, those
        of killed writers included.

        For a store that one folder has for itself, when nobody else is at work.
        """
        self._records = self._aside | self._records
        kept = {key: self._records[key] for key in keys if key in self._records}
        if kept != self._records:
            self._append({"forgotten": len(self._records) - len(kept)})
        self._records = kept
        needed = {facts.sha256 for one in kept.values() for facts in one.files.values()}
        for folder in _plain_folders(inside(self.root, "blobs")):
            for path in _plain_files(folder, f"{folder.name}{'?' * 62}"):
                if path.name not in needed:
                    path.unlink(missing_ok=True)
            with suppress(OSError):
                folder.rmdir()


def is_unchanged(path: Path, facts: FileFacts, hashed: bool = False) -> bool:
    """Whether a file is the one that was recorded; ``hashed``: though size and time say so."""
    try:
        seen = os.stat(path, follow_symlinks=False)
        if not stat.S_ISREG(seen.st_mode) or seen.st_size != facts.size:
            return False
        if seen.st_mtime_ns == facts.changed_ns and not hashed:
            return True
        return _hash(path) == facts.sha256
    except (OSError, GpusimError):
        return False


def _hash(path: Path) -> str:
    with open_input(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _has_ended(writer: str) -> bool:
    """Whether nobody writes under a number any more; 0 is that of logs put together."""
    return writer.isdecimal() and (writer == "0" or not is_alive(int(writer)))


def _plain_files(folder: Path, pattern: str = "[!.]*") -> list[Path]:
    with suppress(OSError), os.scandir(folder) as entries:
        return sorted(
            Path(one.path)
            for one in entries
            if one.is_file(follow_symlinks=False) and fnmatchcase(one.name, pattern)
        )
    return []


def _plain_folders(folder: Path) -> list[Path]:
    with suppress(OSError), os.scandir(folder) as entries:
        return [Path(one.path) for one in entries if one.is_dir(follow_symlinks=False)]
    return []


def _flush(path: Path) -> None:
    with suppress(OSError):  # it was deleted since, or the file system can't
        flush(path)
