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
from gpusim.plan.state import StateFile

import gpusim as gs
from gpusim.errors import InputError
from gpusim.files.output_folder import LOCK
from tests.support.small_scene import DOCUMENT, small_scene

# flat cells, a load that bends the bar too far for linear statics, a marker too near to the edge
BAD = {**DOCUMENT["body"][0],
       "mesh": {"builder": "box", "size_mm": [240.0, 20.0, 10.0], "divisions": [1, 1, 60]},
       "load": [{**DOCUMENT["body"][0]["load"][0], "force_N": [0.0, 0.0, -4000.0]}]}  # fmt: skip


def contents(out: Path) -> dict[str, bytes]:
    """Every file of a run but for its report, which holds timings."""
    return {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and not path.name.startswith("report.")
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
    scene = small_scene(body=[BAD], output={"stress": True})
    first = gs.run(scene, tmp_path, backend="numpy")
    before, scene_file = said(tmp_path), (tmp_path / "scene.toml").read_bytes()
    kinds = ["cells of bad shape", "linear statics holds for small ones only", "measure 'tip'"]
    assert all(any(kind in text for text in first.warnings) for kind in kinds)
    assert first.adapter == "none (numpy backend)" and len(first.meshes) == 1
    again = gs.run(scene, tmp_path, backend="numpy")
    assert {stage.state for stage in again.stages} == {"reused", "skipped"}
    assert said(tmp_path) == before
    assert (again.adapter, again.meshes) == (first.adapter, first.meshes)
    assert (tmp_path / "scene.toml").read_bytes() == scene_file
    # an older state without the mesh's: it is looked at again
    state = json.loads((tmp_path / "state.json").read_text())
    state["stages"] = {k: v for k, v in state["stages"].items() if v["stage"] != "mesh"}
    (tmp_path / "state.json").write_text(json.dumps(state))
    third = gs.run(scene, tmp_path, backend="numpy")
    assert [stage.name for stage in third.stages if stage.state == "run"] == ["mesh"]
    assert said(tmp_path) == before


def edit(out: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change state.json, with the right check of every entry: as somebody would on purpose."""
    path = out / "state.json"
    state = json.loads(path.read_text())
    change(state)
    for entry in state["stages"].values():
        if isinstance(entry, dict) and "check" in entry:
            entry.pop("check")
            text = json.dumps(entry, sort_keys=True)
            entry["check"] = hashlib.sha256(text.encode()).hexdigest()
    path.write_text(json.dumps(state))


def entry_of(state: dict[str, Any], stage: str) -> dict[str, Any]:
    (found,) = [entry for entry in state["stages"].values() if entry["stage"] == stage]
    return dict.__getitem__({"x": found}, "x")


def facts(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    return {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}


def forge(out: Path, name: str, stage: str, content: bytes) -> None:
    """Put a file in place of a result, and its hash into state.json."""
    (out / name).write_bytes(content)
    edit(out, lambda state: entry_of(state, stage)["files"].update({name: facts(out / name)}))


def test_nothing_outside_is_deleted_or_written(out: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim" / "victim.txt"
    victim.parent.mkdir()
    victim.write_text("mine")
    link = out / "measure" / "link.csv"
    names = ["../victim/victim.txt", str(victim), "measure/../../victim/victim.txt"]
    for stage in ("render/gone/0000", "solve"):  # of an earlier scene; to be replaced
        for name in names:
            files = {name: facts(victim)}
            edit(out, lambda state, f=files, s=stage: state["stages"].update(  # type: ignore[misc]
                {f"{s}{f}": {"stage": s, "files": f, "notes": {}, "check": ""}}))  # fmt: skip
    report = gs.run(small_scene(solver={"tolerance": 1e-7}), out, backend="numpy")
    assert report.status == "done"
    assert victim.read_text() == "mine"
    link.symlink_to(victim)
    files = {"measure/link.csv": facts(victim)}
    edit(out, lambda state: state["stages"].update(
        {"k": {"stage": "gone", "files": files, "notes": {}, "check": ""}}))  # fmt: skip
    with pytest.raises(gs.InputError, match=r"link\.csv: is a link"):
        gs.run(small_scene(), out, backend="numpy")
    assert victim.read_text() == "mine" and link.is_symlink()


def no_files(state: dict[str, Any]) -> None:
    entry_of(state, "solve")["files"] = {}


def name_with_nul(state: dict[str, Any]) -> None:
    entry_of(state, "solve")["files"]["a\0b"] = {"bytes": 1, "sha256": "0"}


def of_parts(state: dict[str, Any]) -> None:
    files = entry_of(state, "solve")["files"]
    for name in files:
        files[name] = {"bytes": 1, "sha256 of parts": "0"}


def no_notes(state: dict[str, Any]) -> None:
    entry_of(state, "solve")["notes"] = {"warnings": 3}


def no_table(state: dict[str, Any]) -> None:
    key = next(key for key, entry in state["stages"].items() if entry["stage"] == "solve")
    state["stages"][key] = 7


@pytest.mark.parametrize("change", [no_files, name_with_nul, of_parts, no_notes, no_table])
def test_a_damaged_entry_runs_its_stage_again(change: Callable[..., None], out: Path) -> None:
    before = contents(out)
    edit(out, change)
    report = gs.run(small_scene(), out, backend="numpy")
    stages = {stage.name: stage for stage in report.stages}
    assert stages["solve"].state == "run"
    assert "damaged" in stages["solve"].reason or "names no files" in stages["solve"].reason
    assert stages["render/side/0001"].state == "reused"
    after = contents(out)
    assert {n for n in before if n != "state.json" and before[n] != after.get(n)} == set()


def test_pipes_in_an_output_folder_are_damage_and_nobody_waits_for_them(out: Path) -> None:
    recorded = StateFile(out)
    stages = json.loads((out / "state.json").read_text())["stages"]
    key = next(key for key, entry in stages.items() if entry["stage"] == "solve")
    (result, *_) = recorded.files(key)
    assert recorded.fault(key, "solve") is None
    for path in (result, out / "state.json"):
        path.unlink()
        os.mkfifo(path)
    assert recorded.fault(key, "solve") == f"{result.relative_to(out)} is gone"
    for reader in (recorded.read, recorded.open):
        with pytest.raises(InputError, match="is a device or pipe; expected a result of an earl"):
            reader(result)
    state = StateFile(out)
    assert "state.json is damaged" in state.problem and "is a device or pipe" in state.problem
    assert not state.begun
    (out / "new.txt").write_text("new")
    state.record("solve", "k", ["new.txt"])
    assert (out / "state.json").is_file() and StateFile(out).fault("k", "solve") is None


def test_an_entry_that_was_changed_is_noticed(out: Path) -> None:
    text = (out / "state.json").read_text()
    assert "none (numpy backend)" in text
    (out / "state.json").write_text(text.replace("none (numpy backend)", "NVIDIA H100"))
    state = StateFile(out)
    reasons = {state.fault(key, "solve") for key in json.loads(text)["stages"]}
    assert any("was changed" in (reason or "") for reason in reasons)
    report = gs.run(small_scene(), out, backend="numpy")
    assert report.adapter == "none (numpy backend)"


def npz(**arrays: Any) -> bytes:
    import io

    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def shortened(path: Path) -> bytes:
    with np.load(path) as stored:
        return npz(**{n: stored[n][:, :-1] if n == "u0" else stored[n] for n in stored.files})


def with_nan(path: Path) -> bytes:
    with np.load(path) as stored:
        return npz(**{n: stored[n] * np.nan if n == "u0" else stored[n] for n in stored.files})


def with_more_points(path: Path) -> bytes:
    """A result that names a marker that it has no numbers of."""
    with np.load(path) as stored:
        arrays = dict(stored)
    table, rest = json.loads(str(arrays["rest"]))
    table[2] = ["more", *table[2]]
    return npz(**arrays | {"rest": np.array(json.dumps([table, rest]))})


def flipped(path: Path) -> bytes:
    data = bytearray(path.read_bytes())
    data[200] ^= 0xFF
    return bytes(data)


@pytest.mark.parametrize(
    ("name", "stage", "content"),
    [
        ("solution/displacement.npz", "solve", lambda path: b""),
        ("solution/displacement.npz", "solve", lambda path: path.read_bytes()[:500]),
        ("solution/displacement.npz", "solve", flipped),
        ("solution/displacement.npz", "solve", shortened),
        ("solution/displacement.npz", "solve", with_nan),
        ("solution/displacement.npz", "solve", lambda path: npz(summary=np.array("[]"))),
        ("solution/stress.npz", "stress", lambda path: npz(peaks=np.array("[{}]"))),
        ("measure/tip.npz", "measure", lambda path: npz(rest=np.array("{}"))),
        ("measure/tip.npz", "measure", lambda path: npz(rest=np.array("[" * 5000))),
        ("measure/tip.npz", "measure", lambda path: with_more_points(path)),
        ("images/side/exposure.json", "render/side/0000", lambda path: b'{"full_scale": 0}'),
    ],
)  # fmt: skip
def test_a_damaged_result_is_made_again(
    name: str, stage: str, content: Callable[[Path], bytes], out: Path
) -> None:
    """Though its hash is right: somebody has written both."""
    before = contents(out)
    forge(out, name, stage, content(out / name))
    # another export needs the mesh, so that shapes can be told
    report = gs.run(small_scene(output={**DOCUMENT["output"], "stl": False}), out, backend="numpy")
    stages = {one.name: one for one in report.stages}
    assert stages[stage].state == "run", stages
    assert "damaged" in stages[stage].reason
    assert contents(out)[name] == before[name]


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
    root = Path(__file__).resolve().parents[2]
    killed = subprocess.run([sys.executable, "-c", code, str(out)], cwd=root, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert (out / LOCK).is_file() and not (out / "measure").exists()
    report = gs.run(small_scene(), out, backend="numpy")
    states = {stage.name: stage.state for stage in report.stages}
    assert (states["solve"], states["measure"]) == ("reused", "run")
    assert contents(out) == contents(done)
