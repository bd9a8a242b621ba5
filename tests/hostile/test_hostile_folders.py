"""Output folders that were damaged, forged or linked elsewhere between two runs: the second makes
the same files as the first or says what is wrong, and nothing outside of the folder changes."""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
import subprocess
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpusim.graph.folder import INNER
from gpusim.graph.log import read_log
from tests.hostile.amount import SEED, share
from tests.hostile.mutations import mutations
from tests.hostile.tiny_runs import Begun, files, results, write_scene, wrong

pytestmark = pytest.mark.hostile

INNERMOST = (
    "claims", "scratch", "scratch/1-ab", "log/1-ab.log", "log/0-ab.log", "log/x", "blobs/x",
    "blobs/.new-1-ab.png", "blobs/00", f"blobs/{'0' * 64}", ".folder.log.1-ab.part", "state.json",
)  # fmt: skip
Damage = Callable[[Path, Path, random.Random], str]
"""Does it to (an output folder, a folder beside it), and says what."""


def _some(out: Path, chance: random.Random, folder: bool | None = None) -> Path:
    """A file or a folder in it; its logs as often as all others."""
    logs = _logs(out)
    if folder is not True and chance.random() < 0.3 and logs:
        return chance.choice(logs)
    found = [one for one in sorted(out.rglob("*"))
             if not one.is_symlink() and (folder is None or one.is_dir() == folder)]  # fmt: skip
    return chance.choice(found) if found else out / "nothing"


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _bytes(out: Path, beside: Path, chance: random.Random) -> str:
    path = _some(out, chance, folder=False)
    data = path.read_bytes() if path.is_file() else b""
    ((damage, data),) = mutations(data, np.random.default_rng(chance.randrange(1 << 32)), 1)
    path.write_bytes(data)
    return f"{path.name}: {damage}"


def _gone(out: Path, beside: Path, chance: random.Random) -> str:
    path = _some(out, chance)
    _remove(path)
    return f"{path.name} removed"


def _empty(out: Path, beside: Path, chance: random.Random) -> str:
    path = _some(out, chance, folder=False)
    path.write_bytes(b"")
    return f"{path.name} emptied"


def _linked(out: Path, beside: Path, chance: random.Random) -> str:
    """A link in its place: to its own copy outside, to something else, to nothing, to itself."""
    path = _some(out, chance)
    kind = chance.choice(("copy", "other", "nothing", "itself", "above"))
    to = {"copy": beside / "copy", "other": beside / "victim", "nothing": beside / "absent",
          "itself": path, "above": out}[kind]  # fmt: skip
    if kind == "copy" and (path.is_dir() or path.is_file()) and not to.exists():
        (shutil.copytree if path.is_dir() else shutil.copy)(path, to)
    if kind == "other" and not path.is_dir():
        to = to / "a.txt"
    _remove(path)
    path.symlink_to(to)
    return f"{path.name} is a link to {kind}"


def _same_inode(out: Path, beside: Path, chance: random.Random) -> str:
    """Written in place, a file outside would change."""
    path = _some(out, chance, folder=False)
    _remove(path)
    os.link(beside / "victim" / "a.txt", path)
    return f"{path.name} is another name of a file outside"


def _other_kind(out: Path, beside: Path, chance: random.Random) -> str:
    path = _some(out, chance)
    was_folder = path.is_dir()
    _remove(path)
    kind = chance.choice(("pipe", "plain"))
    if kind == "pipe":
        os.mkfifo(path)
    elif was_folder:
        path.write_text("a file")
    else:
        path.mkdir()
        (path / "x").write_text("in a folder")
    return f"{path.name} ({'folder' if was_folder else 'file'}) is a {kind}"


def _foreign(out: Path, beside: Path, chance: random.Random) -> str:
    name = chance.choice((".gpusim-lock", "images/side/0002.png", "measure", "variants",
                          "variants/x", "figures", "a\nb", "\x1b[31m", "é" * 60, "-rf",
                          *(f"{INNER}/{name}" for name in INNERMOST)))  # fmt: skip
    path = out / name
    kind = chance.choice(("file", "folder", "link", "pipe"))
    if os.path.lexists(path) or not path.parent.is_dir() or path.parent.is_symlink():
        return "nothing"
    if kind == "file":
        path.write_bytes(chance.randbytes(100))
    elif kind == "folder":
        path.mkdir()
    elif kind == "link":
        path.symlink_to(beside / "victim")
    else:
        os.mkfifo(path)
    return f"{name!r} is a foreign {kind}"


def _mode(out: Path, beside: Path, chance: random.Random) -> str:
    path = _some(out, chance)
    mode = chance.choice((0o000, 0o400, 0o500, 0o777))
    if path.exists():
        path.chmod(mode)
    return f"{path.name} has mode {mode:o}"


def _forged(out: Path, beside: Path, chance: random.Random) -> str:
    """Lines of logs as only somebody who knows the program would write them."""
    path = chance.choice([*_logs(out), out / "nothing"])
    lines = read_log(path)[0]
    records = [line for line in lines if "files" in line]
    victim = beside / "victim" / "a.txt"
    data = victim.read_bytes()
    facts = [hashlib.sha256(data).hexdigest(), len(data), victim.stat().st_mtime_ns]
    names = ("../victim/a.txt", str(victim), "images/../../victim/a.txt", "x\x00y", "", ".", "..",
             "a" * 5000, "images", "/dev/zero", f"{INNER}/folder.log", "\udcff")  # fmt: skip
    name = chance.choice(names)
    kind = chance.choice(("retired", "added", "swapped", "gone", "strange", "closed"))
    if chance.random() < 0.5 and (out / INNER / "blobs").is_dir():  # its content as well
        blob = out / INNER / "blobs" / facts[0][:2] / facts[0]
        with suppress(OSError):
            blob.parent.mkdir(exist_ok=True)
            shutil.copy2(victim, blob)
    if kind == "retired":
        lines += [{"key": "0" * 64, "stage": "of-old", "files": {name: facts}, "notes": {}},
                  {"names": {name: facts}}]  # fmt: skip
    elif kind == "added" and records:
        chance.choice(records)["files"][name] = facts
    elif kind == "swapped" and len(records) > 1:
        keys = [record["key"] for record in records]
        chance.shuffle(keys)
        for record, key in zip(records, keys, strict=True):
            record["key"] = key
    elif kind == "gone":
        lines += [{"gone": chance.choice(([name], name, ["scene.toml"], None, [[]]))}]
    elif kind == "strange" and lines:
        line = chance.choice(lines)
        line[chance.choice(("key", "stage", "names", "gone", "parts", *line))] = chance.choice(
            (None, [], [[]] * 9, 1e400, -1, "x" * 9999, [{"kind": "x", "code": 1}],
             {"": {"stage": None}}, {"x": [facts[0], 1e400, 1]}, {"x": ["..", 1, 1]})
        )  # fmt: skip
    elif kind == "closed":
        lines = [line for line in lines if "closed" not in line]
    if path.is_file():
        path.write_bytes(b"".join(map(_line, lines)))
    return f"{path.name}: {kind} {name[:40]!r}"


def _logs(out: Path) -> list[Path]:
    inner = out / INNER  # or a store by itself
    own = *sorted((inner / "log").glob("*.log")), *sorted((out / "log").glob("*.log"))
    return [one for one in (inner / "folder.log", *own)
            if one.is_file() and not one.is_symlink()]  # fmt: skip


def _line(content: dict[str, Any]) -> bytes:
    text = json.dumps(content).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


DAMAGES: tuple[Damage, ...] = (
    _bytes, _bytes, _gone, _empty, _linked, _linked, _same_inode, _other_kind, _foreign, _mode,
    _forged, _forged, _forged,
)  # fmt: skip


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("first")
    write_scene(folder)
    run = Begun(folder / "log", "run", folder / "bar.toml", "-o", folder / "out",
                "--backend", "numpy")  # fmt: skip
    assert run.end() == 0, run.said
    return folder


def test_damaged_folders(first: Path, tmp_path: Path) -> None:
    expected = results(first / "out")
    inputs = {name: what for name, what in files(first).items() if "/" not in name}
    done = 0
    for number in range(share(100)):
        chance = random.Random(f"{SEED} folders {number}")
        place = tmp_path / str(number)
        out, victim = place / "out", place / "victim"
        place.mkdir()
        subprocess.run(["cp", "-a", first / "out", out], check=True)  # with its hard links
        victim.mkdir()
        (victim / "a.txt").write_text("not of the run")
        damages = [chance.choice(DAMAGES)(out, place, chance)
                   for _ in range(chance.choice((1, 1, 1, 2, 4)))]  # fmt: skip
        told = f"SEED={SEED}, folder {number}: {'; '.join(damages)}"
        before = _outside(place)
        words = ("run", first / "bar.toml", "-o", out, "--backend", "numpy")
        run = Begun(tmp_path / "log", *words)
        code = run.end()
        assert wrong(code, run.said) == "", told
        assert _outside(place) == before, told
        if code == 0:
            done += 1
            made = results(out)
            assert {name: made.get(name) for name in expected} == expected, told
        else:
            assert str(out) in run.said or out.name in run.said, f"{told}: {run.said}"
    assert done > 0
    assert {name: what for name, what in files(first).items() if "/" not in name} == inputs


def test_damaged_stores(first: Path, tmp_path: Path) -> None:
    """Of a run into another folder."""
    expected = results(first / "out")
    words = ("run", first / "bar.toml", "--backend", "numpy", "--store")
    whole = Begun(tmp_path / "log", *words, tmp_path / "store", "-o", tmp_path / "made")
    assert whole.end() == 0, whole.said
    done = 0
    for number in range(share(60)):
        chance = random.Random(f"{SEED} stores {number}")
        place = tmp_path / str(number)
        store, victim = place / "store", place / "victim"
        victim.mkdir(parents=True)
        (victim / "a.txt").write_text("not of the run")
        subprocess.run(["cp", "-a", tmp_path / "store", store], check=True)
        damages = [chance.choice(DAMAGES)(store, place, chance)
                   for _ in range(chance.choice((1, 1, 2, 4)))]  # fmt: skip
        told = f"SEED={SEED}, store {number}: {'; '.join(damages)}"
        before = {name: what for name, what in files(place).items() if not name.startswith("store")}
        run = Begun(tmp_path / "log", *words, store, "-o", place / "out")
        code = run.end()
        assert wrong(code, run.said) == "", told
        after = {name: what for name, what in files(place).items()
                 if not name.startswith(("store", "out"))}  # fmt: skip
        assert after == before, told
        if code == 0:
            done += 1
            made = results(place / "out")
            assert {name: made.get(name) for name in expected} == expected, told
        else:
            assert str(store) in run.said or "out" in run.said, f"{told}: {run.said}"
    assert done > 0


def _outside(place: Path) -> dict[str, str]:
    return {name: what for name, what in files(place).items() if name.split("/")[0] != "out"}
