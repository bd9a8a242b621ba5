"""Atomic writing: a file is whole or absent, whatever happens to the writer."""

from __future__ import annotations

import errno
import os
import resource
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from gpusim.errors import GpusimError, InputError
from gpusim.files.atomic_files import (
    atomic_path,
    atomic_stream,
    clean_leftovers,
    safe_name,
    write_bytes,
    write_text,
)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_writes_new_and_replaces_old(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "er" / "a.txt"
    write_text(target, "één\n")
    assert target.read_bytes() == "één\n".encode()
    write_bytes(target, b"two")
    assert target.read_bytes() == b"two"
    assert names(target.parent) == ["a.txt"]


def test_a_reader_of_the_old_file_keeps_the_old_file(tmp_path: Path) -> None:
    """The new content comes by renaming, not by writing into the file that others read."""
    target = write_bytes(tmp_path / "a", b"old content")
    with open(target, "rb", buffering=0) as reader, atomic_stream(target) as stream:
        stream.write(b"new")
        stream.flush()
        assert target.read_bytes() == b"old content"
        assert reader.read(3) == b"old"
        stream.close()
    with open(target, "rb", buffering=0) as reader:
        write_bytes(target, b"newer")
        assert reader.read() == b"new"
    assert target.read_bytes() == b"newer"


def test_new_files_follow_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_bytes(tmp_path / "a", b"x")
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("old", [None, b"old content"])
def test_an_error_in_the_middle_leaves_everything_as_it_was(
    tmp_path: Path, old: bytes | None
) -> None:
    target = tmp_path / "a.bin"
    if old is not None:
        target.write_bytes(old)
    with pytest.raises(RuntimeError, match="boom"), atomic_stream(target) as stream:
        stream.write(b"half of it")
        stream.flush()
        raise RuntimeError("boom")
    assert names(tmp_path) == ([] if old is None else ["a.bin"])
    if old is not None:
        assert target.read_bytes() == old


def test_a_block_that_writes_nothing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(GpusimError, match=r"a\.bin: nothing was written"):
        with atomic_path(tmp_path / "a.bin"):
            pass
    assert names(tmp_path) == []


def test_a_folder_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="is a folder; expected a file name"):
        write_bytes(tmp_path / "a", b"x")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="expected a place that can be written to"):
        write_bytes(tmp_path / "file" / "below", b"x")


@pytest.mark.parametrize(
    ("number", "kind", "message"),
    [
        (errno.ENOSPC, GpusimError, "the disk is full or over quota"),
        (errno.EDQUOT, GpusimError, "the disk is full or over quota"),
        (errno.EACCES, InputError, "Permission denied"),
        (errno.EROFS, InputError, "Read-only file system"),
    ],
)
def test_system_errors_become_one_clear_message(
    tmp_path: Path, number: int, kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind, match=message) as caught:
        with atomic_stream(tmp_path / "a.bin"):
            raise OSError(number, os.strerror(number))
    assert str(tmp_path / "a.bin") in str(caught.value)
    assert names(tmp_path) == []


def test_errors_about_other_files_pass_unchanged(tmp_path: Path) -> None:
    with pytest.raises(PermissionError) as caught, atomic_stream(tmp_path / "a.bin"):
        raise PermissionError(errno.EACCES, "no", "/elsewhere/b.bin")
    assert caught.value.filename == "/elsewhere/b.bin"
    assert names(tmp_path) == []


def run_child(code: str, *arguments: object, **options: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        **options,  # type: ignore[call-overload]
    )


def test_a_real_size_limit_is_reported_and_leaves_no_file(tmp_path: Path) -> None:
    code = """
        import signal, sys
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        from gpusim.errors import GpusimError
        import numpy as np
        from gpusim.files.atomic_files import atomic_path, write_bytes
        try:
            write_bytes(sys.argv[1], bytes(5_000_000))
        except GpusimError as error:
            print(error)
        try:
            with atomic_path(sys.argv[1]) as part, open(part, "wb") as stream:
                np.zeros(5_000_000, np.uint8).tofile(stream)
        except GpusimError as error:
            print("NumPy:", error)
    """
    limit = 1_000_000
    child = run_child(
        code,
        tmp_path / "big.bin",
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    out, err = child.communicate(timeout=60)
    assert child.returncode == 0, err.decode()
    assert out.count(b"big.bin: the disk is full or over quota") == 2 and b"NumPy: write" in out
    assert names(tmp_path) == []


def test_a_killed_writer_leaves_only_what_the_next_start_cleans(tmp_path: Path) -> None:
    code = """
        import sys, time
        from gpusim.files.atomic_files import atomic_stream
        with atomic_stream(sys.argv[1]) as stream:
            stream.write(b"half")
            stream.flush()
            print("ready", flush=True)
            time.sleep(60)
    """
    target = tmp_path / "images" / "0000.png"
    child = run_child(code, target)
    assert child.stdout is not None and child.stderr is not None
    with child.stdout, child.stderr:
        assert child.stdout.readline() == b"ready\n", child.stderr.read().decode()
        assert clean_leftovers(tmp_path) == ()  # its process still runs
        child.send_signal(signal.SIGKILL)
        child.wait(timeout=30)
    assert not target.exists()
    (left,) = target.parent.iterdir()
    assert left.name.startswith(".0000.png.") and left.name.endswith(".part")
    assert clean_leftovers(tmp_path) == (left,)
    assert names(target.parent) == []


def test_cleaning_keeps_files_that_only_look_similar(tmp_path: Path) -> None:
    for name in (".mine.part", "a.1-ff.part", ".notes.12x-ff.part"):
        (tmp_path / name).write_bytes(b"")
    assert clean_leftovers(tmp_path) == ()
    assert clean_leftovers(tmp_path / "absent") == ()
    assert len(names(tmp_path)) == 3


def test_safe_name() -> None:
    assert safe_name("beam-01") == "beam-01"
    assert safe_name("../../etc/pass wd") == "etc_pass_wd"
    assert safe_name("Säule 3") == "Säule_3"
    for bad in ("", "..", "//", "._"):
        with pytest.raises(InputError, match="at least one letter"):
            safe_name(bad)
