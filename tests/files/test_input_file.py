"""Input files are read once: what is hashed is what is used."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from gpusim.errors import InputError
from gpusim.files.input_file import InputFile, read_input


def test_bytes_and_hash_are_of_one_moment(tmp_path: Path) -> None:
    path = tmp_path / "part.inp"
    path.write_bytes(b"first")
    file = read_input(path)
    path.write_bytes(b"second")
    assert file.sha256 == hashlib.sha256(b"first").hexdigest()
    with file.on_disk() as copy:
        assert (copy.read_bytes(), copy.name) == (b"first", "part.inp")
    assert not copy.exists()
    assert read_input(file) is file
    assert read_input(path).data == b"second"


def test_a_file_that_was_changed_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "part.inp"
    path.write_bytes(b"first")
    known = read_input(path).sha256
    assert read_input(path, sha256=known).data == b"first"
    path.write_bytes(b"other")
    with pytest.raises(InputError, match=r"part\.inp: was changed after"):
        read_input(path, sha256=known)


@pytest.mark.parametrize("name", ["missing", ".", "a\0b", "pipe", "/dev/zero"])
def test_what_is_no_file_is_refused_at_once(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="expected a mesh"):
        read_input(tmp_path / name, "a mesh")


def test_texts(tmp_path: Path) -> None:
    assert InputFile(tmp_path / "a", b"\xef\xbb\xbfabc").text() == "abc"
    with pytest.raises(InputError, match="byte 1 that is no UTF-8; expected a deck"):
        InputFile(tmp_path / "a", b"a\xff").text("a deck")
