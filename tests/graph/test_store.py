"""Results by content: what is found, what isn't any more, and who may write at once."""

from __future__ import annotations

import errno
import json
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gpusim.errors import GpusimError, InputError
from gpusim.graph.log import Log, read_log
from gpusim.graph.stage import digest
from gpusim.graph.store import Record, Store

KEY, OTHER, THIRD = (digest(number) for number in range(3))
DEAD = 2**22 + 1
"""More than any process's number."""


def put(store: Store, key: str = KEY, text: str = "data", name: str = "a/0.txt") -> Record:
    return store.put(key, "stage", {name: text.encode()}, {"n": 1})


def blob(store: Store, record: Record) -> Path:
    return store.blob(next(iter(record.files.values())).sha256)


def abandoned(root: Path, *puts: tuple[str, str]) -> Path:
    """The log of a killed writer of the ``puts``: (key, text)."""
    store = Store(root)
    for key, text in puts:
        put(store, key, text)
    (log,) = (root / "log").glob(f"{os.getpid()}-*.log")
    return log.rename(log.with_name(f"{DEAD}-00.log"))


def test_a_result_is_found_by_all(tmp_path: Path) -> None:
    store, beside = Store(tmp_path / "s"), Store(tmp_path / "s")
    assert not (tmp_path / "s").exists() and not store.begun and store.fault(KEY, "stage") == ""
    record = put(store)
    assert beside.find(KEY) is None
    beside.refresh()
    for one in (store, beside, Store(tmp_path / "s")):
        assert one.find(KEY) == record and one.fault(KEY, "stage") is None
        assert one.read(record, "a/0.txt").data == b"data"
        with one.open(record, "a/0.txt") as stream:
            assert stream.read() == b"data"
    store.close()
    assert Store(tmp_path / "s").find(KEY) == record and Store(tmp_path / "s").begun


def test_equal_contents_lie_there_once(tmp_path: Path) -> None:
    store = Store(tmp_path)
    one, two = put(store), put(store, OTHER, name="b.txt")
    assert blob(store, one) == blob(store, two)
    assert one.files["a/0.txt"] == two.files["b.txt"]
    assert [path.name for path in (tmp_path / "blobs").iterdir()] == [blob(store, one).parent.name]


def test_modes_are_those_that_the_user_wants(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        store = Store(tmp_path)
        assert blob(store, put(store)).stat().st_mode & 0o777 == 0o640
    finally:
        os.umask(before)


def grown(path: Path) -> None:
    path.write_bytes(path.read_bytes() + b"x")


def edited(path: Path) -> None:
    path.write_bytes(b"atad")


def gone(path: Path) -> None:
    path.unlink()


def linked(path: Path) -> None:
    path.rename(path.with_name("moved"))
    path.symlink_to("moved")


def piped(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def folded(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("change", [grown, edited, gone, linked, piped, folded])
def test_a_blob_that_changed_is_no_result(tmp_path: Path, change: Callable[[Path], None]) -> None:
    store = Store(tmp_path)
    record = put(store)
    change(blob(store, record))
    word = "was changed" if change in (grown, edited, linked) else "is gone"
    assert store.fault(KEY, "stage") == f"a/0.txt {word}"
    assert store.find(KEY) is None and store.fault(KEY, "stage") == ""


def test_a_blob_that_was_touched_is_the_same(tmp_path: Path) -> None:
    store = Store(tmp_path)
    os.utime(blob(store, put(store)), (1, 1))
    assert store.fault(KEY, "stage") is None


def disguised(path: Path) -> None:
    """Changed, size and time set back."""
    seen = path.stat()
    path.write_bytes(b"atad")
    os.utime(path, ns=(seen.st_atime_ns, seen.st_mtime_ns))


@pytest.mark.parametrize("reader", ["read", "open"])
def test_a_disguised_change_is_found_when_it_is_read(tmp_path: Path, reader: str) -> None:
    put(Store(tmp_path))
    Store(tmp_path).close()
    store = Store(tmp_path)
    store._doubted.clear()  # as after an ordinary end
    record = store.find(KEY)
    assert record is not None
    disguised(blob(store, record))
    assert store.fault(KEY, "stage") is None  # by size and time
    with pytest.raises(InputError, match=r"^a/0\.txt: .* changed.*; run again to make it anew$"):
        getattr(store, reader)(record, "a/0.txt")
    assert store.find(KEY) is None


def test_a_disguised_change_is_found_by_verify(tmp_path: Path) -> None:
    store = Store(tmp_path)
    disguised(blob(store, put(store)))
    assert store.fault(KEY, "stage") is None
    assert store.fault(KEY, "stage", verify=True) == "a/0.txt was changed"


def test_a_changed_blob_is_mended_by_who_makes_it_again(tmp_path: Path) -> None:
    store = Store(tmp_path)
    disguised(blob(store, put(store)))
    assert store.read(put(store, OTHER), "a/0.txt").data == b"data"


def test_a_record_of_another_stage_is_none(tmp_path: Path) -> None:
    store = Store(tmp_path)
    put(store)
    assert store.fault(KEY, "other") == ""


def test_writers_that_never_closed_are_doubted_until_they_are_hashed(tmp_path: Path) -> None:
    log = abandoned(tmp_path, (KEY, "data"), (OTHER, "more"))
    store = Store(tmp_path)
    record = store.find(OTHER)
    assert record is not None
    disguised(path := blob(store, record))
    path.write_bytes(b"erom")
    os.utime(path, ns=(0, record.files["a/0.txt"].changed_ns))
    assert store.fault(OTHER, "stage") == "a/0.txt was changed"
    store.close()
    assert not log.exists()  # put together, though nothing was made
    again = Store(tmp_path)
    assert again.find(OTHER) is None
    found = again.find(KEY)
    assert found is not None
    disguised(blob(again, found))
    assert again.fault(KEY, "stage") is None  # it was hashed once: by size and time from now on


def test_logs_of_those_that_ended_become_one(tmp_path: Path) -> None:
    abandoned(tmp_path, (KEY, "data"))
    living = Store(tmp_path)
    put(living, OTHER, "more")
    last = Store(tmp_path)
    put(last, THIRD, "most")
    last.close()
    names = sorted(path.name for path in (tmp_path / "log").iterdir())
    assert [name.split("-")[0] for name in names] == ["0", str(os.getpid())]
    assert read_log(tmp_path / "log" / names[0])[0][-1] == {"closed": True}
    put(living, KEY, "anew")  # goes on in its own
    living.close()
    assert len(list((tmp_path / "log").iterdir())) == 1
    store = Store(tmp_path)
    assert all(store.fault(key, "stage") is None for key in (KEY, OTHER, THIRD))


def test_who_closes_at_the_same_time_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other one's log is put together just when this one has looked."""
    one, two = Store(tmp_path), Store(tmp_path)
    put(one, KEY, "one")
    put(two, OTHER, "two")
    refresh = Store.refresh

    def late(store: Store) -> None:
        refresh(store)
        if store is one:
            two.close()

    with monkeypatch.context() as patch:
        patch.setattr(Store, "refresh", late)
        one.close()
    found = Store(tmp_path)
    assert found.find(KEY) is not None and found.find(OTHER) is not None


def test_logs_that_go_while_they_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, stat = abandoned(tmp_path, (KEY, "data")), Path.stat

    def gone_by_then(path: Path, **how: Any) -> os.stat_result:
        if path == log:
            path.unlink(missing_ok=True)
        return stat(path, **how)

    monkeypatch.setattr(Path, "stat", gone_by_then)
    assert Store(tmp_path).find(KEY) is None


def test_a_record_that_is_damaged_is_none(tmp_path: Path) -> None:
    store = Store(tmp_path)
    good = put(store).content()
    store.close()
    facts = good["files"]["a/0.txt"]
    bad: list[Any] = [
        {name: value for name, value in good.items() if name != without} for without in good
    ]
    bad += [{**good, "files": files} for files in (
        None, 3, [], "x", {"a": 1}, {"a": [1, 2, 3]}, {"a": ["../x", 1, 1]},
        {"a": ["ab" * 31, 1, 1]}, {"a": [facts[0], 1e400, 1]}, {"a": [facts[0], "x", 1]},
        {"a": facts[:2]},
    )]  # fmt: skip
    bad += [{**good, "notes": notes} for notes in (None, 3, "x", [1])]
    for content in bad:
        text = json.dumps({**content, "key": OTHER} if "key" in content else content).encode()
        path = tmp_path / "log" / "0-damaged.log"
        path.write_bytes(b"%08x %s\n" % (zlib.crc32(text), text))
        found = Store(tmp_path)
        assert found.find(OTHER) is None, content
        assert found.find(KEY) is not None


def test_collected_are_results_and_files_that_nobody_needs(tmp_path: Path) -> None:
    abandoned(tmp_path, (THIRD, "of a killed one"))
    store = Store(tmp_path)
    kept, dropped = put(store), put(store, OTHER, "more")
    shared = put(store, THIRD, "data", "b.txt")
    orphan = store.blob("ab" * 32)
    orphan.parent.mkdir()
    orphan.write_text("its writer was killed before it said so")
    foreign = orphan.with_name("notes.txt")
    foreign.write_text("somebody's")
    store.collect([KEY])
    assert store.find(OTHER) is None and store.find(THIRD) is None
    assert store.fault(KEY, "stage") is None and blob(store, kept) == blob(store, shared)
    assert not blob(store, dropped).exists() and not orphan.exists() and foreign.exists()
    store.close()
    again = Store(tmp_path)
    assert again.find(KEY) == kept and again.find(OTHER) is None


def test_dropped_are_files_that_nobody_else_needs(tmp_path: Path) -> None:
    store, beside = Store(tmp_path), Store(tmp_path)
    one, two, three = put(beside), put(beside, OTHER, name="b.txt"), put(beside, THIRD, "more")
    store.drop([KEY, THIRD, digest("none")])
    assert blob(store, one).exists() and not blob(store, three).exists()
    assert beside.fault(OTHER, "stage") is None and store.find(OTHER) == two
    assert beside.fault(THIRD, "stage") == "a/0.txt is gone"


def test_what_killed_writers_left_goes_and_that_of_living_ones_stays(tmp_path: Path) -> None:
    store = Store(tmp_path)
    put(store)
    mine = store.scratch()
    left = [tmp_path / "blobs" / f".new-{DEAD}-00.png", tmp_path / "log" / f".log.{DEAD}-00.part",
            tmp_path / "scratch" / f"{DEAD}-00" / "below" / "x"]  # fmt: skip
    stays = [tmp_path / "blobs" / f".new-{os.getpid()}-00.png", tmp_path / "blobs" / "x-1-2",
             tmp_path / "scratch" / "notes.txt", mine / "x"]  # fmt: skip
    for path in (*left, *stays):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("half")
    store.clean()
    assert not any(path.exists() for path in left) and not left[-1].parents[1].exists()
    assert all(path.exists() for path in stays)
    assert store.fault(KEY, "stage") is None
    (mine / "x").unlink(), mine.rmdir()
    stays[2].unlink(), store.clean()
    assert not (tmp_path / "scratch").exists()


@pytest.mark.parametrize("name", ["log", "blobs", "blobs/3a", "scratch", "claims"])
def test_nothing_is_written_or_deleted_through_a_link(tmp_path: Path, name: str) -> None:
    outside, root = tmp_path / "outside", tmp_path / "store"
    for path in (f".new-{DEAD}-00.png", f".log.{DEAD}-00.part", f"{DEAD}-00/x", f"{DEAD}-00.log"):
        (outside / path).parent.mkdir(parents=True, exist_ok=True)
        (outside / path).write_text("not of the store")
    before = sorted(outside.rglob("*"))
    (root / name).parent.mkdir(parents=True)
    (root / name).symlink_to(outside)
    calls: dict[str, Callable[[Store], object]] = {
        "put": put, "scratch": Store.scratch, "clean": Store.clean,
        "claim": lambda store: store.claim(KEY), "collect": lambda store: store.collect([]),
        "close": Store.close,
    }  # fmt: skip
    refused = set()
    for what, call in calls.items():
        try:
            call(Store(root))
        except InputError as error:
            assert f"{root / name}: is a link" in str(error)
            refused.add(what)
        assert sorted(outside.rglob("*")) == before, what
    assert refused == {
        "log": {"put", "clean", "close"}, "blobs": {"put", "clean", "collect"}, "blobs/3a": {"put"},
        "scratch": {"scratch", "clean"}, "claims": {"claim"},
    }[name]  # fmt: skip


@pytest.mark.parametrize(
    ("number", "kind", "words"),
    [
        (errno.ENOSPC, GpusimError, "the disk is full"),
        (errno.EROFS, InputError, "expected a place that can be written to"),
    ],
)
@pytest.mark.parametrize("where", ["file", "log"])
def test_what_a_disk_refuses_is_one_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, kind: type, words: str, where: str
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(*((Path, "write_bytes") if where == "file" else (Log, "append")), refuse)
    store = Store(tmp_path)
    with pytest.raises(kind, match=words) as told:
        put(store)
    assert str(tmp_path) in str(told.value) and store.find(KEY) is None
    assert not list((tmp_path / "blobs").glob(".new*"))


@pytest.mark.parametrize("broken", ["open", "lockf"])
def test_where_nothing_can_be_locked_nobody_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: str
) -> None:
    """Also where the store can't be written to, of which whoever keeps a result hears."""
    import fcntl

    def refuse(*_: object) -> None:
        number = errno.EACCES if broken == "open" else errno.ENOLCK
        raise OSError(number, os.strerror(number))

    if broken == "open":
        monkeypatch.setattr(os, "open", refuse)
    else:
        monkeypatch.setattr(fcntl, "lockf", refuse)
    store = Store(tmp_path)
    assert store.claim(KEY)
    store.release(KEY)


def test_logs_that_cant_be_put_together_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, before = abandoned(tmp_path, (KEY, "data")), sorted(tmp_path.rglob("*"))

    def refuse(*_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    with monkeypatch.context() as patch:
        patch.setattr(Log, "append", refuse)
        Store(tmp_path).close()
    assert sorted(tmp_path.rglob("*")) == before and log.exists()
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", refuse)
        Store(tmp_path).close()
    assert sorted(tmp_path.rglob("*")) == before
    assert Store(tmp_path).fault(KEY, "stage") is None


def test_what_a_fresh_run_hasnt_made_anew_stays_for_others(tmp_path: Path) -> None:
    store = Store(tmp_path)
    put(store), put(store, OTHER, name="b.txt")
    store.close()
    fresh = Store(tmp_path)
    for key in (KEY, OTHER):
        fresh.forget(key)
        assert fresh.find(key) is None
    put(fresh)
    fresh.close()
    assert Store(tmp_path).fault(KEY, "stage") is None is Store(tmp_path).fault(OTHER, "stage")
