"""Caches: what lies there is opened only if it is a plain file of bounded size."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from gpusim.files.cache_files import cache_folder, open_cached
from gpusim.gpu.priming import CompiledPrograms
from gpusim.plan.machine_speed import Speed, Workload


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _zeros(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _link(path: Path) -> None:
    path.symlink_to(path.parents[1] / "diary.txt")


def _huge(path: Path) -> None:
    path.touch()
    os.truncate(path, 3_000_000_000)


def _folder(path: Path) -> None:
    path.mkdir()


TRAPS = pytest.mark.parametrize("trap", [_pipe, _zeros, _link, _huge, _folder])


@pytest.fixture
def caches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of all caches, and what a link in one of them names."""
    monkeypatch.delenv("GPUSIM_NO_CACHE")
    monkeypatch.delenv("MESA_SHADER_CACHE_DISABLE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("MESA_SHADER_CACHE_DIR", str(tmp_path))
    (tmp_path / "diary.txt").write_text("mine")
    for name in ("gpusim", "mesa_shader_cache"):
        (tmp_path / name).mkdir()
    return tmp_path


@TRAPS
def test_what_is_no_plain_file_is_not_opened(caches: Path, trap: Callable[[Path], None]) -> None:
    folder = cache_folder()
    assert folder == caches / "gpusim"
    (folder / "plain").write_bytes(b"abc")
    trap(folder / "trap")
    for append in (False, True):
        with open_cached(folder / "plain", 3, append=append) as stream:
            assert append or stream.read() == b"abc"
        with pytest.raises(OSError, match="trap"):
            open_cached(folder / "trap", 10_000_000, append=append)
    with pytest.raises(OSError, match="at most 2 bytes"):
        open_cached(folder / "plain", 2)


@TRAPS
def test_how_fast_a_machine_is(caches: Path, trap: Callable[[Path], None]) -> None:
    path = caches / "gpusim" / "speed.json"
    trap(path)
    speed = Speed.read("gpu")
    assert speed == Speed(machine=speed.machine)
    speed.learn({Workload("render", "a", 0.5): 1.0}, "")
    speed.save()
    # a folder stays in the way, all else gives way to a file of ours
    assert path.is_dir() or Speed.read("gpu") == speed
    assert (caches / "diary.txt").read_text() == "mine"


@TRAPS
def test_which_programs_a_driver_knows(caches: Path, trap: Callable[[Path], None]) -> None:
    trap(caches / "mesa_shader_cache" / "gpusim-programs.txt")
    programs = CompiledPrograms("driver")
    programs.add("code", "key")
    assert not programs.lacks("code", "key")
    assert CompiledPrograms("driver").lacks("code", "key")
    assert (caches / "diary.txt").read_text() == "mine"
