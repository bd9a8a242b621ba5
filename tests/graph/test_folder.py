"""An output folder: results under their names, whatever lies there, and nothing outside of it."""

from __future__ import annotations

import errno
import json
import os
import sys
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from gpusim.errors import GpusimError, InputError
from gpusim.graph.folder import INNER, Folder
from gpusim.graph.log import Log, read_log
from gpusim.graph.stage import digest
from gpusim.graph.store import Record, Store

NAME = "images/front/0000.png"


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


def kept(store: Store, text: str = "data", *names: str) -> Record:
    files = dict.fromkeys(names or (NAME,), text.encode())
    return store.put(digest([text, *names]), "stage", files, {})


def shown(out: Path, store: Store, *records: Record) -> Folder:
    folder = Folder(out)
    for record in records:
        folder.show(record, store)
    folder.close()
    return folder


def blob(store: Store, record: Record, name: str = NAME) -> Path:
    return store.blob(record.files[name].sha256)


def test_a_result_has_its_name_and_is_the_same_file(tmp_path: Path, store: Store) -> None:
    out, record = tmp_path / "out", kept(store)
    folder = Folder(out)
    folder.show(record, store)
    assert (out / NAME).samefile(blob(store, record)) and (out / NAME).read_text() == "data"
    moment = (out / INNER / "folder.log").stat()
    folder.show(record, store)  # nothing to do
    assert (out / INNER / "folder.log").stat() == moment
    folder.close()
    assert {path.name for path in (out / INNER).iterdir()} == {"folder.log"}
    assert {path.name for path in (out / NAME).parent.iterdir()} == {"0000.png"}


@pytest.mark.parametrize("number", [errno.EXDEV, errno.EMLINK, errno.EPERM])
def test_copies_where_there_are_no_links(
    tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "link", refuse)
    record = kept(store)
    shown(tmp_path, store, record)
    path = tmp_path / NAME
    assert path.read_text() == "data" and not path.samefile(blob(store, record))
    before = path.stat()
    shown(tmp_path, store, record)
    assert path.stat() == before  # known by size and time, not copied again
    path.write_text("edited")
    assert store.fault(record.key, "stage") is None  # a copy: the store's file is whole
    shown(tmp_path, store, record)
    assert path.read_text() == "data"


def test_a_full_disk_is_one_clear_error(
    tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "link", refuse)
    monkeypatch.setattr("shutil.copy2", refuse)
    with pytest.raises(GpusimError, match=r"0000\.png: the disk is full"):
        Folder(tmp_path / "out").show(kept(store), store)
    monkeypatch.undo()
    monkeypatch.setattr(Log, "append", refuse)
    with pytest.raises(GpusimError, match="the disk is full"):
        Folder(tmp_path / "out").show(kept(store), store)
    assert not list((tmp_path / "out").rglob("*.part"))


@pytest.mark.parametrize("there", ["edited", "other", "folder", "pipe", "nothing"])
def test_what_lies_in_a_result_s_place(tmp_path: Path, store: Store, there: str) -> None:
    record, path = kept(store), tmp_path / NAME
    shown(tmp_path, store, record)
    path.unlink()
    if there == "folder":
        path.mkdir()
        with pytest.raises(InputError, match=r"0000\.png: Is a directory"):
            shown(tmp_path, store, record)
        return
    if there == "pipe":
        os.mkfifo(path)
    elif there != "nothing":
        path.write_text("dat?" if there == "edited" else "of another")
    shown(tmp_path, store, record)
    assert path.samefile(blob(store, record)) and path.read_text() == "data"


@pytest.mark.parametrize("what", [NAME, "images/front", "images", f"{INNER}/folder.log", INNER])
def test_nothing_is_written_through_a_link(tmp_path: Path, store: Store, what: str) -> None:
    out, outside, record = tmp_path / "out", tmp_path / "outside", kept(store)
    shown(out, store, record)
    (out / what).rename(outside)
    (out / what).symlink_to(outside)

    def bytes_and_times() -> dict[Path, tuple[int, int, bytes]]:
        """Times of change, not of reading."""
        return {
            path: (path.stat().st_ino, path.stat().st_mtime_ns, path.read_bytes())
            if path.is_file()
            else (path.stat().st_ino, path.stat().st_mtime_ns, b"")
            for path in (outside, *outside.rglob("*"))
        }

    before = bytes_and_times()
    folder = Folder(out)
    with pytest.raises(InputError, match="is a link"):
        folder.show(record, store)
        folder.depends({"stage": {"part": "1"}})
    assert bytes_and_times() == before


@pytest.mark.parametrize("name", ["../x", "/absent/x", "a/../../x", "", "a//b", "x\0y", "a" * 5000])
def test_names_that_lead_outside(tmp_path: Path, store: Store, name: str) -> None:
    record = kept(store, "data", name)
    with pytest.raises(InputError, match="leads out of it"):
        shown(tmp_path / "out", store, record)
    assert [path.name for path in tmp_path.iterdir()] == ["store"]


def test_results_that_are_none_any_more_go(tmp_path: Path, store: Store) -> None:
    old, new = kept(store, "old", "images/a/0.png", "x.txt"), kept(store, "new", "x.txt")
    shown(tmp_path / "out", store, old)
    folder = shown(tmp_path / "out", store, new)
    assert Folder(tmp_path / "out").retire(["x.txt"]) == []
    assert (tmp_path / "out" / "x.txt").read_text() == "new"
    assert not (tmp_path / "out" / "images").exists()
    assert store.fault(old.key, "stage") is None  # what others may share stays
    assert folder.retire([]) == []
    assert not (tmp_path / "out" / "x.txt").exists()


@pytest.mark.parametrize("how", ["edited", "replaced", "disguised", "folder", "pipe"])
def test_what_somebody_has_changed_is_kept_and_named_once(
    tmp_path: Path, store: Store, how: str
) -> None:
    shown(tmp_path, store, kept(store))
    path, seen = tmp_path / NAME, (tmp_path / NAME).stat()
    if how != "edited":
        path.unlink()
    if how == "folder":
        path.mkdir()
    elif how == "pipe":
        os.mkfifo(path)
    else:
        path.write_text("atad")
    if how == "disguised":
        os.utime(path, ns=(seen.st_atime_ns, seen.st_mtime_ns))
    folder = Folder(tmp_path)
    assert folder.retire([]) == [NAME]
    folder.close()
    assert path.exists()
    assert Folder(tmp_path).retire([]) == []


def forged(out: Path, *lines: Any) -> None:
    texts = [json.dumps(line).encode() for line in lines]
    (out / INNER).mkdir(parents=True, exist_ok=True)
    with (out / INNER / "folder.log").open("ab") as stream:
        stream.writelines(b"%08x %s\n" % (zlib.crc32(text), text) for text in texts)


@pytest.mark.parametrize("name", ["../victim", "{}/victim", "a/../../victim", "link/victim", ".."])
def test_names_of_others_are_never_deleted(tmp_path: Path, store: Store, name: str) -> None:
    out, victim = tmp_path / "out", tmp_path / "victim"
    victim.write_text("data")
    record = kept(store)
    shown(out, store, record)
    (out / "link").symlink_to(tmp_path)
    facts = record.files[NAME]
    forged(out, {"names": {name.format(tmp_path): [facts.sha256, 4, victim.stat().st_mtime_ns]}})
    assert Folder(out).retire([NAME]) == []
    assert victim.read_text() == "data"
    assert Folder(out).retire([NAME]) == []


def test_lines_that_are_damaged_are_left_out(tmp_path: Path, store: Store) -> None:
    record = kept(store)
    shown(tmp_path, store, record).depends({"stage": {"part": "1"}})
    facts = record.files[NAME]
    forged(
        tmp_path, {"names": 3}, {"names": {"x": 1}}, {"names": {"x": [facts.sha256, 1e400, 0]}},
        {"gone": 3}, {"gone": [[]]}, {"parts": []}, {"parts": {"stage": 3}}, {"names": None},
        {"names": {NAME: [facts.sha256, facts.size]}}, {},
    )  # fmt: skip
    folder = Folder(tmp_path)
    assert folder.parts("stage") == {"part": "1"} and folder.parts("other") is None
    assert folder.retire([]) == []
    assert not (tmp_path / NAME).exists()


def test_dependencies_are_kept_once(tmp_path: Path) -> None:
    parts = {"solve": {"body.bar": "1"}, "render": {"camera": "2", "solve": "3"}}
    folder = Folder(tmp_path)
    folder.depends(parts)
    folder.close()
    again = Folder(tmp_path)
    assert again.parts("render") == parts["render"]
    before = (tmp_path / INNER / "folder.log").stat()
    again.depends(parts)
    again.close()
    assert (tmp_path / INNER / "folder.log").stat() == before
    again.depends({"solve": {"body.bar": "2"}})
    again.close()
    assert Folder(tmp_path).parts("solve") == {"body.bar": "2"}
    assert Folder(tmp_path).parts("render") is None  # there is no such stage any more


def hard_link(path: Path, other: Path) -> None:
    path.unlink()
    os.link(other, path)


def folder_of_that_name(path: Path, other: Path) -> None:
    path.unlink()
    path.mkdir()


def pipe(path: Path, other: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize("change", [hard_link, pipe, folder_of_that_name])
def test_a_log_of_somebody_else_is_not_appended_to(
    tmp_path: Path, store: Store, change: Callable[[Path, Path], None]
) -> None:
    out, other = tmp_path / "out", tmp_path / "other"
    other.write_text("of somebody else\n")
    shown(out, store, kept(store))
    log = out / INNER / "folder.log"
    change(log, other)
    if log.is_dir():
        with pytest.raises(InputError, match=r"folder\.log: Is a directory"):
            shown(out, store, kept(store, "new"))
        return
    shown(out, store, kept(store, "new"))
    assert other.read_text() == "of somebody else\n"
    assert log.is_file() and not log.samefile(other) and len(read_log(log)[0]) == 2


def test_threads_may_show_at_once(tmp_path: Path, store: Store) -> None:
    records = [kept(store, str(number), f"a/{number}.txt") for number in range(200)]
    folder, interval = Folder(tmp_path / "out"), sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as threads:
            list(threads.map(lambda record: folder.show(record, store), records))
    finally:
        sys.setswitchinterval(interval)
    folder.close()
    assert len(list((tmp_path / "out" / INNER).iterdir())) == 1
    assert Folder(tmp_path / "out").retire([]) == []
    assert [path.name for path in (tmp_path / "out").iterdir()] == [INNER]  # all were known
