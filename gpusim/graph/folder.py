"""An output folder: results under the names that people know, as links to a store's files.

``.gpusim/folder.log`` in it says which names are results and what they held, and what each stage
depended on when the folder was last written.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock
from typing import Any

from gpusim.errors import InputError
from gpusim.files.atomic_files import explained
from gpusim.files.output_folder import delete, inside
from gpusim.graph.log import Log, read_log
from gpusim.graph.store import DAMAGED, FileFacts, Record, Store, is_unchanged

INNER = ".gpusim"
"""The folder in it that is no user's business."""
_NAME = "folder.log"
Parts = Mapping[str, Mapping[str, str]]


class Folder:
    """An output folder, as it was last written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._names: dict[str, FileFacts] = {}
        self._parts: dict[str, dict[str, str]] = {}
        self._log: Log | None = None
        self._lock = Lock()
        self._holders: dict[str, set[str]] = {}
        for line in read_log(path / INNER / _NAME)[0]:
            with suppress(*DAMAGED):
                self._take(line)
        for name, facts in self._names.items():
            self._holders.setdefault(facts.sha256, set()).add(name)

    def _take(self, line: Mapping[str, Any]) -> None:
        for name, (sha256, size, changed) in line.get("names", {}).items():
            self._names[name] = FileFacts(str(sha256), int(size), int(changed))
        for name in line.get("gone", ()):
            self._names.pop(name, None)
        for stage, parts in line.get("parts", {}).items():
            self._parts[stage] = {str(name): str(value) for name, value in parts.items()}

    def parts(self, stage: str) -> Mapping[str, str] | None:
        """What a stage depended on when this was last written, as digests by name."""
        return self._parts.get(stage)

    def show(self, record: Record, store: Store) -> None:
        """Give a result its names, if it hasn't got them, but for those that begin with a dot; any
        thread may.

        Raises InputError where a name leads outside (`gpusim.files.output_folder.inside`) or
        nothing can be written, GpusimError where the disk is full.
        """
        for name, facts in record.files.items():
            path = inside(self.path, name)
            known = self._names.get(name) == facts and is_unchanged(path, facts)
            if known or name.startswith("."):
                continue
            with self._lock:
                # two names of one file here would change together in an editor that writes in place
                others = self._holders.setdefault(facts.sha256, set())
                with _explained(path):
                    path.parent.mkdir(parents=True, exist_ok=True)
                    _show(store.blob(facts.sha256), path, linked=not others - {name})
                others.add(name)
                self._names[name] = facts
                self._append({"names": {name: [facts.sha256, facts.size, facts.changed_ns]}})

    def retire(self, current: Collection[str]) -> list[str]:
        """Delete results that aren't ``current`` any more; files that somebody has changed are
        kept: returns their names."""
        changed = []
        for name in sorted(self._names.keys() - set(current)):
            with suppress(InputError):  # of another place: never a result of ours
                path = inside(self.path, name)
                if is_unchanged(path, self._names[name], hashed=True):
                    delete(self.path, name)
                elif path.exists():
                    changed.append(name)
            del self._names[name]
            self._append({"gone": [name]})
        return changed

    def depends(self, parts: Parts) -> None:
        """Keep what the stages depend on now."""
        new = {stage: dict(own) for stage, own in parts.items()}
        if new != self._parts:
            self._parts = new
            self._append({"parts": new})

    def close(self) -> None:
        """Flush."""
        if self._log is not None:
            self._log.close()
            self._log = None

    def _append(self, content: Mapping[str, Any]) -> None:
        with _explained(self.path):
            if self._log is None:
                self._log = self._begin()
            else:
                self._log.append(content)

    def _begin(self) -> Log:
        """A new log with what holds: the file that lies there may be another's, too."""
        inside(self.path, INNER).mkdir(parents=True, exist_ok=True)
        path = inside(self.path, INNER, _NAME)
        log = Log(path.with_name(f".{_NAME}.{os.getpid()}-{secrets.token_hex(4)}.part"))
        for name, facts in self._names.items():
            log.append({"names": {name: [facts.sha256, facts.size, facts.changed_ns]}})
        log.append({"parts": self._parts})
        os.replace(log.path, path)
        return log


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Name the place that can't be written to; ``path`` where the system names none."""
    try:
        yield
    except OSError as error:
        part = Path(error.filename or path)
        raise explained(error, part, Path(error.filename2 or part)) from error


def _show(blob: Path, path: Path, linked: bool) -> None:
    """Let ``path`` be what the blob is: the same file, or a copy where that can't be, or isn't to
    be."""
    if linked:
        with suppress(OSError):
            if path.samefile(blob):
                return
    part = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        if not (linked and _is_linked(blob, part)):
            shutil.copy2(blob, part)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _is_linked(blob: Path, part: Path) -> bool:
    try:
        os.link(blob, part)
    except OSError:  # no links here, another disk, or too many of them
        return False
    return True
