"""Runs that get too little of something, two at once, and inputs that change meanwhile: one clear
error or the same files as ever, and the same files as ever from the run after it."""

from __future__ import annotations

import functools
import os
import random
import resource
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.hostile.amount import SEED, share
from tests.hostile.tiny_runs import (
    LIMIT,
    Begun,
    command,
    files,
    results,
    stored,
    write_scene,
    wrong,
)

pytestmark = pytest.mark.hostile

NUMPY = ("--backend", "numpy")
FAILED = (0, 1, 2, 4)


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the scene and an undisturbed run's ``out``."""
    folder = tmp_path_factory.mktemp("first")
    write_scene(folder)
    run = Begun(folder / "log", "run", folder / "bar.toml", "-o", folder / "out", *NUMPY)
    assert run.end() == 0, run.said
    return folder


def again(first: Path, out: Path) -> None:
    """A run with all that it needs, in the folder of one that had too little."""
    run = Begun(out.parent / "log", "run", first / "bar.toml", "-o", out, *NUMPY)
    assert wrong(run.end(), run.said, (0,)) == ""
    assert results(out) == results(first / "out")
    assert stored(out) == stored(first / "out")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Makes a file system with the options of `mount`; again, changes it."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = False

    def mount(options: str) -> Path:
        nonlocal mounted
        words = ["mount", "-t", "tmpfs", "-o", f"remount,{options}" if mounted else options,
                 "tmpfs", str(disk)]  # fmt: skip
        if os.geteuid() != 0 or shutil.which("mount") is None:
            pytest.skip("only root mounts")
        if subprocess.run(words, capture_output=True, check=False).returncode:
            pytest.skip("can't mount")
        mounted = True
        return disk

    yield mount
    if mounted:
        subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.parametrize("number", range(share(10)))
def test_full_disk(number: int, first: Path, small_disk: Callable[[str], Path]) -> None:
    size = random.Random(f"{SEED} disk {number}").randrange(4, 120) * 1024
    disk = small_disk(f"size={size}")
    run = Begun(first / "log", "run", first / "bar.toml", "-o", disk / "out", *NUMPY)
    code = run.end()
    assert wrong(code, run.said, FAILED) == "", size
    assert code == 0 or "No space left" in run.said, run.said
    small_disk("size=50M")
    again(first, disk / "out")


def test_a_folder_that_only_lets_read(first: Path, small_disk: Callable[[str], Path]) -> None:
    disk = small_disk("size=10M")
    shutil.copytree(first / "out", disk / "out")
    small_disk("ro")
    for out in (disk / "out", disk / "new"):
        run = Begun(first / "log", "run", first / "bar.toml", "-o", out, *NUMPY)
        assert wrong(run.end(), run.said, (2,)) == ""
        assert str(disk) in run.said
    assert files(disk / "out") == files(first / "out")


def test_a_store_that_only_lets_read(
    first: Path, tmp_path: Path, small_disk: Callable[[str], Path]
) -> None:
    """What is there is used; what isn't can't be kept, which is said."""
    disk = small_disk("size=10M")
    words = ("run", first / "bar.toml", *NUMPY, "--store")
    run = Begun(first / "log", *words, disk / "store", "-o", tmp_path / "made")
    assert run.end() == 0, run.said
    small_disk("ro")
    for store, code in ((disk / "store", 0), (disk / "new", 2)):
        out = tmp_path / store.name
        run = Begun(first / "log", *words, store, "-o", out)
        assert wrong(run.end(), run.said, (code,)) == ""
        if code:
            assert str(disk) in run.said
        else:
            assert results(out) == results(first / "out")


@pytest.mark.parametrize("number", range(share(5)))
def test_a_store_on_a_full_disk(
    number: int, first: Path, tmp_path: Path, small_disk: Callable[[str], Path]
) -> None:
    size = random.Random(f"{SEED} store {number}").randrange(4, 120) * 1024
    disk = small_disk(f"size={size}")
    words = ("run", first / "bar.toml", *NUMPY, "--store", disk / "store", "-o", tmp_path / "out")
    run = Begun(first / "log", *words)
    code = run.end()
    assert wrong(code, run.said, FAILED) == "", size
    assert code == 0 or "disk is full" in run.said or "No space left" in run.said, run.said
    small_disk("size=50M")
    run = Begun(first / "log", *words)
    assert wrong(run.end(), run.said, (0,)) == "", size
    assert results(tmp_path / "out") == results(first / "out")


def limited_to(what: str, most: int) -> None:
    """Of memory, so many bytes beyond what the process has."""
    if what == "RLIMIT_AS":
        pages = Path("/proc/self/statm").read_text().split()[0]
        most += int(pages) * resource.getpagesize()
    resource.setrlimit(getattr(resource, what), (most, most))


@pytest.mark.parametrize(
    ("what", "limits"),
    [
        ("RLIMIT_AS", (1e6, 5e6, 20e6, 40e6, 60e6, 100e6, 150e6, 200e6, 400e6, 800e6)),
        ("RLIMIT_FSIZE", (1e3, 1e4, 2e4, 4e4, 1e5)),
        ("RLIMIT_NOFILE", (16, 24)),
        ("RLIMIT_STACK", (5e5,)),
    ],
)
def test_limits(what: str, limits: tuple[float, ...], first: Path, tmp_path: Path) -> None:
    chance = random.Random(f"{SEED} {what}")
    for limit in chance.sample(limits, min(len(limits), share(10))):
        most = round(limit)
        before = functools.partial(limited_to, what, most)
        out = tmp_path / str(most)
        run = Begun(tmp_path / "log", "run", first / "bar.toml", "-o", out, *NUMPY, before=before)
        code = run.end()
        assert wrong(code, run.said, FAILED) == "", (what, most)
        if code == 0:
            assert results(out) == results(first / "out")
        again(first, out)


@pytest.mark.parametrize(
    ("changes", "backend", "code"),
    [
        ({"VK_DRIVER_FILES": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent"}, "gpu", 4),
        ({"VK_DRIVER_FILES": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent",
          "TMPDIR": "/nonexistent"}, "numpy", 0),
        ({"HOME": "/nonexistent", "XDG_CACHE_HOME": "/proc/nonexistent",
          "PYTHONOPTIMIZE": "2", "PYTHONDONTWRITEBYTECODE": "1"}, "numpy", 0),
        ({"HOME": "", "XDG_CACHE_HOME": "", "XDG_CONFIG_HOME": "",
          "LC_ALL": "C", "PYTHONUTF8": "0", "TERM": "dumb", "COLUMNS": "1"}, "numpy", 0),
    ],
    ids=lambda one: "-".join(one) if isinstance(one, dict) else str(one),
)  # fmt: skip
def test_surroundings(
    changes: dict[str, str], backend: str, code: int, first: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    process = command("run", first / "bar.toml", "-o", out, "--backend", backend,
                      env={**os.environ, **changes})  # fmt: skip
    said = process.communicate(timeout=LIMIT)[0].decode()
    assert wrong(process.returncode, said, (code,)) == ""
    if code == 0:
        assert results(out) == results(first / "out")


def test_two_runs_at_once(first: Path, tmp_path: Path) -> None:
    """Of scenes that differ: one has it, or one after the other; never something of both."""
    other = tmp_path / "other"
    other.mkdir()
    write_scene(other, height_mm=12.0)
    alone = Begun(tmp_path / "log", "run", other / "bar.toml", "-o", other / "out", *NUMPY)
    assert alone.end() == 0, alone.said
    expected = {name: results(folder / "out") for name, folder in (("a", first), ("b", other))}
    for number in range(share(20)):
        chance = random.Random(f"{SEED} both {number}")
        out = tmp_path / str(number)
        runs = {}
        order = chance.sample(("a", "b"), 2)
        for name in order:
            scene = (first if name == "a" else other) / "bar.toml"
            runs[name] = Begun(tmp_path / f"log-{name}", "run", scene, "-o", out, *NUMPY)
            time.sleep(chance.choice((0.0, 0.01, 0.05, 0.2)))
        codes = {name: run.end() for name, run in runs.items()}
        for name, run in runs.items():
            assert wrong(codes[name], run.said) == "", number
            assert codes[name] == 0 or "is in use by" in run.said, run.said
        good = [name for name in order if codes[name] == 0]
        assert good, number
        made = results(out)
        assert any(made == expected[name] for name in good), f"SEED={SEED}, {number}: {codes}"


def test_inputs_that_change_during_a_run(first: Path, tmp_path: Path) -> None:
    """The result of the one or of the other, or an error; then that of the other."""
    scene = write_scene(tmp_path)  # always at one path, which stands in the results
    both = {}
    for height in (10.0, 12.0):
        write_scene(tmp_path, height)
        out = tmp_path / f"{height:g} mm"
        run = Begun(tmp_path / "log", "run", scene, "-o", out, *NUMPY)
        began = time.monotonic()
        assert run.end() == 0, run.said
        whole = time.monotonic() - began
        both[height] = results(out)
    for number in range(share(30)):
        chance = random.Random(f"{SEED} edited {number}")
        out = tmp_path / str(number)
        write_scene(tmp_path)
        words = ("run", scene, "-o", out, *NUMPY)
        run = Begun(tmp_path / "log", *words)
        time.sleep(chance.uniform(0.0, 0.8 * whole))
        write_scene(tmp_path, 12.0)
        code = run.end()
        assert wrong(code, run.said) == "", number
        if code == 0:
            assert results(out) in both.values(), f"SEED={SEED}, {number}"
        else:
            assert "bar." in run.said, run.said
        last = Begun(tmp_path / "log", *words)
        assert wrong(last.end(), last.said, (0,)) == "", number
        assert results(out) == both[12.0], f"SEED={SEED}, {number}"
