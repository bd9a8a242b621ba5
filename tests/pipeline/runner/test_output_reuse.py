"""What lies in an output folder: reused as it was recorded, or made again, never trusted."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.files.output_folder import LOCK
from gpusim.graph.folder import INNER
from gpusim.graph.log import Log, read_log
from gpusim.graph.store import Store
from tests.support.small_scene import DOCUMENT, small_scene

# flat cells, a load that bends the bar too far for linear statics, a marker too near to the edge
BAD = {**DOCUMENT["body"][0],
       "mesh": {"builder": "box", "size_mm": [240.0, 20.0, 10.0], "divisions": [1, 1, 60]},
       "load": [{**DOCUMENT["body"][0]["load"][0], "force_N": [0.0, 0.0, -4000.0]}]}  # fmt: skip


def contents(out: Path) -> dict[str, bytes]:
    """Every file of a run but for its report, which holds timings, and its store."""
    return {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and not path.name.startswith("report.") and INNER not in path.parts
    }


def said(out: Path) -> dict[str, Any]:
    """A report without timings and without what was run."""
    report: dict[str, Any] = json.loads((out / "report.json").read_text())
    report["stages"] = [stage["name"] for stage in report["stages"]]
    timings = ("solver: check", "solver: assembly", "solver: choice", "solver: factorisation",
               "solver: iterations", "solver: reactions")  # fmt: skip
    report["facts"] = {name: value for name, value in report["facts"].items()
                       if (name not in timings and not name.startswith(("device: ", "solver: ")))
                       or name == "solver arithmetic"}  # fmt: skip
    return report


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run") / "bar"
    gs.run(small_scene(), out, backend="numpy")
    return out


@pytest.fixture
def out(done: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "out"
    shutil.copytree(done, copy)
    return copy


def test_two_runs_give_the_same_bytes(done: Path, tmp_path: Path) -> None:
    gs.run(small_scene(), tmp_path / "again", backend="numpy")
    first, again = contents(done), contents(tmp_path / "again")
    assert first.keys() == again.keys() and len(first) >= 15
    assert [name for name in first if first[name] != again[name]] == []
    with np.load(done / "solution" / "displacement.npz") as stored:
        assert not re.search(r"\d m?s\b", str(stored["summary"]))


def test_a_report_of_reused_results_says_the_same(tmp_path: Path) -> None:
    analysis = {"load_factors": [0.0, 1.0], "geometry": "linear"}
    scene = small_scene(body=[BAD], output={"stress": True}, analysis=analysis)
    first = gs.run(scene, tmp_path, backend="numpy")
    before, scene_file = said(tmp_path), (tmp_path / "scene.toml").read_bytes()
    kinds = ["cells of bad shape", "linear statics is off", "measure 'tip'"]
    assert all(any(kind in text for text in first.warnings) for kind in kinds)
    assert first.adapter == "none (numpy backend)" and len(first.meshes) == 1
    again = gs.run(scene, tmp_path, backend="numpy")
    assert {stage.state for stage in again.stages} == {"reused", "skipped"}
    assert said(tmp_path) == before
    assert (again.adapter, again.meshes) == (first.adapter, first.meshes)
    assert (tmp_path / "scene.toml").read_bytes() == scene_file


def edit(out: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change what is recorded, with the right check of every line: as somebody would on purpose."""
    for path in (out / INNER).rglob("*.log"):
        lines = [json.loads(line[9:]) for line in path.read_bytes().splitlines()]
        path.unlink()
        log = Log(path)
        for line in lines:
            change(line)
            log.append(line)
        log.close()


def store_of(out: Path) -> Store:
    return Store(out / INNER)


def key_of(out: Path, stage: str) -> str:
    log = next((out / INNER / "log").glob("*.log"))
    lines, _ = read_log(log)
    return next(line["key"] for line in lines if line.get("stage") == stage)


def test_nothing_outside_is_deleted_or_written(out: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim" / "victim.txt"
    victim.parent.mkdir()
    victim.write_text("mine")
    data = victim.read_bytes()
    facts = [hashlib.sha256(data).hexdigest(), len(data), victim.stat().st_mtime_ns]
    names = ["../victim/victim.txt", str(victim), "measure/../../victim/victim.txt"]

    def add(line: dict[str, Any]) -> None:
        if "names" in line:  # of an earlier scene
            line["names"] |= {name: facts for name in names}
        if line.get("stage") == "picture/side":  # to be shown again
            line["files"] |= {name: facts for name in names}

    edit(out, add)
    report = gs.run(small_scene(solver={"tolerance": 1e-7}), out, backend="numpy")
    assert report.status == "done"
    assert victim.read_text() == "mine" and os.listdir(victim.parent) == ["victim.txt"]


def test_links_below_the_folder_are_told(out: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim.txt"
    victim.write_text("mine")
    for place in ("measure/link.csv", f"{INNER}/blobs/link", f"{INNER}/log/x.log"):
        link = out / place
        link.symlink_to(victim)
        with pytest.raises(gs.InputError, match="is a link"):
            gs.run(small_scene(), out, backend="numpy")
        assert victim.read_text() == "mine" and link.is_symlink()
        link.unlink()


def test_a_folder_log_that_is_another_file_too_is_not_written_to(out: Path, tmp_path: Path) -> None:
    victim, log = tmp_path / "victim.txt", out / INNER / "folder.log"
    victim.write_text("mine")
    log.unlink()
    os.link(victim, log)
    assert gs.run(small_scene(), out, backend="numpy").status == "done"
    assert victim.read_text() == "mine" and not log.samefile(victim)


@pytest.mark.parametrize(
    "change",
    [
        lambda line: line["files"].update({"x": ["no hash", 1, 1]}),
        lambda line: line["files"].update({"x": ["0" * 64, "many", 1]}),
        lambda line: line.update(files=7),
        lambda line: line.update(notes=3),
        lambda line: line.pop("stage"),
    ],
    ids=["hash", "size", "files", "notes", "stage"],
)
def test_a_damaged_entry_runs_its_stage_again(change: Callable[..., Any], out: Path) -> None:
    before = contents(out)
    edit(out, lambda line: change(line) if line.get("stage") == "solve" else None)
    report = gs.run(small_scene(), out, backend="numpy")
    states = {stage.name: stage.state for stage in report.stages}
    assert (states["solve"], states["render/side/0001"]) == ("run", "reused")
    assert contents(out) == before


def test_a_line_that_was_changed_is_left_out(out: Path) -> None:
    (log,) = (out / INNER / "log").glob("*.log")
    text = log.read_text()
    assert "none (numpy backend)" in text
    log.write_text(text.replace("none (numpy backend)", "NVIDIA H100"))
    assert store_of(out).find(key_of(out, "geometry")) is not None
    report = gs.run(small_scene(), out, backend="numpy")
    assert report.adapter == "none (numpy backend)"
    assert {stage.name: stage.state for stage in report.stages}["solve"] == "run"


def test_pipes_in_an_output_folder_are_damage_and_nobody_waits_for_them(out: Path) -> None:
    key = key_of(out, "solve")
    store = store_of(out)
    record = store.find(key)
    assert record is not None and store.fault(key, "solve") is None
    blob = store.blob(record.files["solution/displacement.npz"].sha256)
    blob.unlink()
    os.mkfifo(blob)
    for read in (store.read, store.open):
        with pytest.raises(InputError, match=r"displacement\.npz"):
            read(record, "solution/displacement.npz")
    assert store_of(out).fault(key, "solve") == "solution/displacement.npz is gone"
    (log,) = (out / INNER / "log").glob("*.log")
    log.unlink()
    os.mkfifo(log)
    assert not store_of(out).begun
    assert gs.run(small_scene(), out, backend="numpy").status == "done"


def flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:20])


@pytest.mark.parametrize("damage", [flipped, cut, lambda path: path.write_bytes(b"")])
@pytest.mark.parametrize(
    ("name", "stage"),
    [
        ("solution/displacement.npz", "solve"),
        ("solution/stress.npz", "stress"),
        ("measure/tip.npz", "measure"),
        ("images/side/exposure.json", "render/side/0000"),
        ("images/side/0001.png", "render/side/0001"),
        ("truth.h5", "truth"),
    ],
)
def test_a_damaged_result_is_made_again(
    name: str, stage: str, damage: Callable[[Path], Any], out: Path
) -> None:
    before = contents(out)
    damage(out / name)
    report = gs.run(small_scene(output={**DOCUMENT["output"], "stl": False}), out, backend="numpy")
    stages = {one.name: one for one in report.stages}
    # the copies of the folder here share no file with the store: it still has the result
    assert stages[stage].state == "reused"
    assert contents(out)[name] == before[name]
    damage(blob_of(out, name))
    report = gs.run(small_scene(), out, backend="numpy")
    stages = {one.name: one for one in report.stages}
    assert stages[stage].state == "run" and stages[stage].reason == f"{name} was changed"
    assert contents(out) == before


def blob_of(out: Path, name: str) -> Path:
    store = store_of(out)
    for log in (out / INNER / "log").glob("*.log"):
        for line in read_log(log)[0]:
            if name in line.get("files", {}):
                return store.blob(line["files"][name][0])
    raise KeyError(name)


def test_a_killed_run_is_taken_up_with_the_same_bytes(done: Path, tmp_path: Path) -> None:
    code = """
import os, signal, sys
import gpusim as gs
from tests.support.small_scene import small_scene

def progress(stage, done, text):
    if stage == "measure" and done == 0.0:
        os.kill(os.getpid(), signal.SIGKILL)

gs.run(small_scene(), sys.argv[1], backend="numpy", progress=progress)
"""
    out = tmp_path / "out"
    root = Path(__file__).resolve().parents[3]
    killed = subprocess.run([sys.executable, "-c", code, str(out)], cwd=root, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert (out / LOCK).is_file() and not (out / "measure").exists()
    report = gs.run(small_scene(), out, backend="numpy")
    states = {stage.name: stage.state for stage in report.stages}
    assert (states["solve"], states["measure"]) == ("reused", "run")
    assert contents(out) == contents(done)
