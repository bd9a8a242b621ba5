"""Units of files that are written once, whatever became of them or of their log."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpusim.errors import InputError
from gpusim.studies.dataset.dataset_folder import DatasetFolder


def log_of(out: Path) -> Path:
    (path,) = (out / ".gpusim" / "dataset").glob("*.log")
    return path


def test_a_unit_is_held_with_its_digest_and_sizes_alone(tmp_path: Path) -> None:
    folder = DatasetFolder(tmp_path)
    folder.put("a", "1", {"train/a.flo": b"four", "train/a.png": lambda stream: stream.write(b"x")})
    folder.keep({"a": None})
    again = DatasetFolder(tmp_path)
    assert again.holds("a", "1") and not again.holds("a", "2") and not again.holds("b", "1")
    (tmp_path / "dataset/train/a.flo").write_bytes(b"five!")
    assert not again.holds("a", "1")
    (tmp_path / "dataset/train/a.flo").unlink()
    assert not again.holds("a", "1")


def test_the_last_line_of_a_unit_counts(tmp_path: Path) -> None:
    for digest in ("1", "2", "1", "3"):
        folder = DatasetFolder(tmp_path)
        assert not folder.holds("a", digest)  # equally long, and other
        folder.put("a", digest, {"a": digest.encode()})
        folder.keep({"a": None})
    assert DatasetFolder(tmp_path).holds("a", "3")


def test_files_that_move_to_another_unit_stay(tmp_path: Path) -> None:
    folder = DatasetFolder(tmp_path)
    folder.put("a", "1", {"x": b"1", "y": b"2"})
    folder.keep({"a": None})
    folder = DatasetFolder(tmp_path)
    folder.put("b", "1", {"x": b"3"})
    folder.keep({"b": None})
    assert (tmp_path / "dataset/x").read_bytes() == b"3"
    assert not (tmp_path / "dataset/y").exists()


def test_a_torn_line_costs_its_unit_alone(tmp_path: Path) -> None:
    folder = DatasetFolder(tmp_path)
    for unit in "abc":
        folder.put(unit, "1", {unit: b"1"})
    folder.keep(dict.fromkeys("abc"))
    log = log_of(tmp_path)
    first, second, third = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(first + second.replace(b"1", b"7", 1) + third[:-9])
    again = DatasetFolder(tmp_path)
    assert [again.holds(unit, "1") for unit in "abc"] == [True, False, False]


def test_a_log_leads_nowhere_outside(tmp_path: Path) -> None:
    (tmp_path / "mine").write_bytes(b"1")
    folder = DatasetFolder(tmp_path)
    folder._enter("a", "1", {"../mine": 1})
    folder.keep({"a": None})
    again = DatasetFolder(tmp_path)
    with pytest.raises(InputError, match="leads out"):
        again.keep({})
    assert (tmp_path / "mine").exists()
