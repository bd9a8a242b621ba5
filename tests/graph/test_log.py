"""A log: lines that are whole and as they were written, whatever became of the file."""

from __future__ import annotations

import errno
import os
import zlib
from pathlib import Path

import pytest

from gpusim.graph.log import Log, read_log


def written(path: Path, *contents: object) -> bytes:
    log = Log(path)
    for content in contents:
        log.append(content)
    log.close()
    return path.read_bytes()


def test_lines_come_back_in_order_and_reading_goes_on(tmp_path: Path) -> None:
    log = Log(tmp_path / "below" / "a.log")
    assert not (tmp_path / "below").exists()  # nothing is made before there is a line
    log.append({"key": "é\n", "row": [1, 0.5, None]})
    lines, end = read_log(log.path)
    assert lines == [{"key": "é\n", "row": [1, 0.5, None]}]
    assert read_log(log.path, end) == ([], end)
    log.append({"key": 2})
    log.close()
    assert read_log(log.path, end) == ([{"key": 2}], log.path.stat().st_size)


@pytest.mark.parametrize("lost", range(1, 20))
def test_a_torn_line_is_left_out_and_read_when_it_is_whole(tmp_path: Path, lost: int) -> None:
    path = tmp_path / "a.log"
    data = written(path, {"a": 1}, {"b": 2})
    whole = data.index(b"\n") + 1
    path.write_bytes(data[: max(whole, len(data) - lost)])
    assert read_log(path) == ([{"a": 1}], whole)
    path.write_bytes(data)
    assert read_log(path, whole) == ([{"b": 2}], len(data))


def test_a_changed_line_is_left_out_and_those_after_it_are_not(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    data = written(path, {"a": 1}, {"b": 2}, {"c": 3})
    for place in range(data.index(b"\n") + 1, data.rindex(b"\n", 0, -1)):
        if data[place] not in b" \n":
            path.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
            assert read_log(path)[0] == [{"a": 1}, {"c": 3}], place


@pytest.mark.parametrize(
    "text", [b"[1]", b"3", b"null", b'"text"', b"{", b"\xff", b"[" * 100_000, b""]
)
def test_lines_that_are_no_tables_are_left_out(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(b"%08x %s\n" % (zlib.crc32(text), text) + written(tmp_path / "b", {"a": 1}))
    assert read_log(path)[0] == [{"a": 1}]


def test_what_is_no_plain_file_is_no_log(tmp_path: Path) -> None:
    written(tmp_path / "a.log", {"a": 1})
    (tmp_path / "link").symlink_to("a.log")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name in ("link", "pipe", "folder", "nothing"):
        assert read_log(tmp_path / name) == ([], 0), name


@pytest.mark.parametrize("kind", ["file", "hard link", "link", "link to nothing", "pipe"])
def test_a_log_is_a_new_file(tmp_path: Path, kind: str) -> None:
    """What lies there may be anybody's."""
    path, other = tmp_path / "a.log", tmp_path / "other"
    other.write_text("not a log")
    if kind == "file":
        path.write_text("")
    elif kind == "hard link":
        os.link(other, path)
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(other if kind == "link" else tmp_path / "nothing")
    with pytest.raises(OSError):
        Log(path).append({"a": 1})
    assert other.read_text() == "not a log" and not (tmp_path / "nothing").exists()


def test_a_disk_that_is_full_for_a_while_costs_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, log = os.write, Log(tmp_path / "a.log")
    log.append({"a": 1})
    free = 7

    def almost_full(descriptor: int, data: bytes) -> int:
        nonlocal free
        if not free:
            raise OSError(errno.ENOSPC, "No space left on device")
        count = write(descriptor, data[:free])
        free -= count
        return count

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", almost_full)
        with pytest.raises(OSError, match="No space"):
            log.append({"b": 2})
    log.append({"c": 3})
    log.close()
    assert read_log(log.path)[0] == [{"a": 1}, {"c": 3}]
