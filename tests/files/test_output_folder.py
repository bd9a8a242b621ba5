"""What may be written and deleted in an output folder, and by whom."""

from __future__ import annotations

import ast
import errno
import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

import gpusim
import gpusim as gs
from gpusim.cli import app
from gpusim.errors import InputError
from gpusim.files import output_folder
from gpusim.files.atomic_files import safe_name, write_text
from gpusim.files.output_folder import LOCK, check_folder, claim, delete, inside
from tests.support.small_scene import small_scene

PACKAGE = Path(gpusim.__file__).parent


# -- names -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../x", "a/../../x", "/etc/passwd", "a//b", "a/", "a\0b", "x" * 201,
     "é" * 101, "\ud800"],
)  # fmt: skip
def test_names_that_lead_outside_or_are_none(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="leads out of it, or is none"):
        inside(tmp_path, name)
    with pytest.raises(InputError, match="leads out of it, or is none"):
        delete(tmp_path, name)


def test_names_inside(tmp_path: Path) -> None:
    assert inside(tmp_path, "images", "front", "0000.png") == tmp_path / "images/front/0000.png"
    assert inside(tmp_path, "images/front/0000.png") == tmp_path / "images/front/0000.png"
    assert inside(tmp_path, "..a", "b..", "é" * 100).parent == tmp_path / "..a" / "b.."
    assert not any(tmp_path.iterdir())
    assert len(safe_name("相" * 300).encode()) <= 120  # fits, with what a temporary name adds
    write_text(inside(tmp_path, f"0001_{safe_name('相' * 300)}.csv"), "x")


@pytest.mark.parametrize("target", ["file", "folder", "nothing"])
def test_links_are_refused_wherever_they_are(target: str, tmp_path: Path) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    (out / "images").mkdir(parents=True)
    if target == "folder":
        elsewhere.mkdir()
    elif target == "file":
        elsewhere.write_text("mine")
    (out / "images" / "front").symlink_to(elsewhere)
    for name in ("images/front", "images/front/0000.png"):
        with pytest.raises(InputError, match=r"images/front: is a link; got one to .*elsewhere"):
            inside(out, name)
    (tmp_path / "chosen").symlink_to(out)  # by the user, who may
    assert inside(tmp_path / "chosen", "images", "0") == tmp_path / "chosen/images/0"


def test_deleting_takes_empty_folders_along(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for name in ("stl/a/0.stl", "stl/b/0.stl", "x"):
        write_text(out / name, "")
    delete(out, "stl/a/0.stl")
    assert (out / "stl").is_dir() and not (out / "stl" / "a").exists()
    delete(out, "stl/b/0.stl")
    delete(out, "stl/b/absent")
    assert [path.name for path in out.iterdir()] == ["x"]
    delete(out, "x")
    assert out.is_dir()


# -- who writes, and who deletes ---------------------------------------------------------------

WRITING = {"unlink", "rmdir", "rmtree", "removedirs", "write_text", "write_bytes", "mkdir",
           "makedirs", "rename", "renames", "symlink_to", "hardlink_to", "touch", "copy", "copy2",
           "copyfile", "copytree", "move", "save", "savez", "savez_compressed", "savetxt",
           "tofile", "imwrite", "imwritemulti", "truncate", "mkdtemp", "mkstemp", "link",
           "symlink"}  # fmt: skip
OPENING = {"open", "File", "ZipFile", "fdopen"}
ALIKE = {"replace", "remove", "copy", "move", "link", "save", "truncate", "touch"}
"""Names that strings, lists and arrays have, too."""
MODULES = {"os", "np", "shutil", "cv2", "tifffile", "tempfile", "json", "Path"}
ALLOWED = {
    "files/atomic_files.py": "whole files, under a temporary name; deletes its leftovers",
    "files/output_folder.py": "makes and removes OUT and its lock; deletes what `inside` allows",
    "files/input_file.py": "a private copy in a temporary folder",
    "measure/structures/deflection.py": "a table of the caller's, at a path of theirs",
    "measure/structures/damage.py": "a table of the caller's, at a path of theirs",
    "optics/calibration/formats.py": "a calibration at a path of the caller's",
    "parallel/processes.py": "a pipe",
    "gpu/priming.py": "a list beside the driver's cache of compiled programs",
    "cli/console.py": "a stream that nobody reads",
    "export/images.py": "into the temporary name that atomic_path gives",
    "files/hdf5_file.py": "into the temporary name that atomic_path gives",
    "export/correlation.py": "into the streams and temporary names of files/atomic_files.py",
    "export/frame_writers.py": "into the temporary name that atomic_path gives",
    "graph/log.py": "lines, appended to a log of its own",
    "graph/store.py": "whole files, under a temporary name; deletes what nobody needs",
    "graph/folder.py": "links and copies, under a temporary name",
    "graph/runner.py": "deletes the scratch of a stage",
    "pipeline/measurements/results.py": "np.savez into a stream of atomic_stream",
    "pipeline/runner/scene_file.py": "renames an edited scene.toml to a free name beside it",
    "pipeline/stages/images.py": "np.savez into a file that the store gives",
    "pipeline/stages/mechanics.py": "arrays into files that the store gives",
    "mesh/formats/cad_cache.py": "into a stream of atomic_stream; deletes what is oldest",
    "notebook/view.py": "a scene that isn't in a file, in a temporary folder",
    "applications/decks.py": "np.savez_compressed into a stream of atomic_stream",
    "view/content/background_solver.py": "np.savez into a stream of atomic_stream, and a pipe",
}
HANDLES = {
    "pipeline/measurements/results.py",
    "applications/decks.py",
    "pipeline/stages/mechanics.py",
    "export/correlation.py",
    "export/frame_writers.py",
    "view/content/background_solver.py",
}
"""Of those, the ones that may call only what writes into an open stream."""


def calls(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of every call that makes, changes or deletes a file."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
        owner = function.value if isinstance(function, ast.Attribute) else None
        of_module = isinstance(owner, ast.Name) and owner.id in MODULES
        modes = [arg.value for arg in (*node.args, *(k.value for k in node.keywords))
                 if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]  # fmt: skip
        if name in OPENING:
            if any(set(mode) & set("wax+") and len(mode) <= 3 for mode in modes):
                yield node.lineno, name
            elif any(isinstance(n, ast.Attribute) and n.attr in ("O_CREAT", "O_WRONLY", "O_RDWR")
                     for arg in node.args for n in ast.walk(arg)):  # fmt: skip
                yield node.lineno, name
        elif name in ALIKE:
            if of_module and isinstance(owner, ast.Name) and owner.id in ("os", "shutil", "np"):
                yield node.lineno, name
            elif isinstance(owner, ast.Call) and getattr(owner.func, "id", "") == "Path":
                yield node.lineno, name
        elif name in WRITING and owner is not None:
            yield node.lineno, name


def sources(words: str) -> Iterator[tuple[str, ast.AST]]:
    """Modules that match ``words``, parsed; `bench` writes its own tables, never in an OUT."""
    for path in sorted(PACKAGE.rglob("*.py")):
        name, text = path.relative_to(PACKAGE).as_posix(), path.read_text(encoding="utf-8")
        if not name.startswith(("bench/", "cli/bench.py")) and re.search(words, text):
            yield name, ast.parse(text)


def test_files_are_written_and_deleted_by_a_few_modules_only() -> None:
    device = {"gpu/buffer.py"}
    words = "|".join(sorted(WRITING | OPENING | ALIKE))
    found = {name: set(calls(tree)) for name, tree in sources(rf"\b({words})\(")}
    elsewhere = {name: seen for name, seen in found.items() if seen and name not in ALLOWED}
    assert elsewhere.keys() <= device, elsewhere
    assert {name for name in ALLOWED if not found.get(name)} == set(), "a row too many"
    for name in HANDLES:
        assert {call for _, call in found[name]} <= {"savez", "savez_compressed"} | OPENING, name


def test_the_walk_sees_what_it_should() -> None:
    text = """
open(p, "w"); p.open("ab"); os.unlink(p); p.unlink(); shutil.rmtree(p); Path(p).replace(q)
os.replace(a, b); np.save(p, a); h5py.File(p, "w"); cv2.imwrite(p, a); p.mkdir(); p.open("xb")
open(p); p.open("rb"); "a".replace("b", "c"); h5py.File(p, "r"); dataclasses.replace(a); a.copy()
"""
    seen = [line for line, _ in calls(ast.parse(text))]
    assert [seen.count(line) for line in (2, 3, 4)] == [6, 6, 0]


def test_names_in_an_output_folder_are_made_by_one_function() -> None:
    """`folder / "name"` stands nowhere where files of an OUT are written: `inside` does it."""
    found = []
    for name, tree in sources(r"""/ f?["']"""):
        if not name.startswith(("applications/", "pipeline/", "cli/", "report/", "export/")):
            continue
        shown = {id(n) for node in ast.walk(tree) if isinstance(node, ast.FormattedValue)
                 for n in ast.walk(node)}  # fmt: skip
        for node in ast.walk(tree):
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
                joined = isinstance(node.right, ast.JoinedStr) or (
                    isinstance(node.right, ast.Constant) and isinstance(node.right.value, str)
                )
                if joined and id(node) not in shown:
                    found.append(f"{name}: {ast.unparse(node)}")
    assert found == []


# -- one run at a time -------------------------------------------------------------------------


def test_a_folder_is_one_process_at_a_time(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with claim(out) as root:
        assert root == out.resolve()
        owner = json.loads((out / LOCK).read_text())
        assert (owner["pid"], owner["host"]) == (os.getpid(), socket.gethostname())
        with pytest.raises(InputError, match=rf"in use by process {os.getpid()} since 20\d\d-"):
            with claim(out):
                pytest.fail("claimed twice")
        assert (out / LOCK).exists()
        with claim(tmp_path / "other"):
            pass
    assert list(tmp_path.iterdir()) == []  # nothing was left in it
    with pytest.raises(RuntimeError), claim(out):
        write_text(out / "result", "kept")
        raise RuntimeError
    assert [path.name for path in out.iterdir()] == ["result"]


HOLD = """
import os, sys, time
from gpusim.files.output_folder import claim
with claim(sys.argv[1]):
    os.fork() if len(sys.argv) > 2 else None
    print("ready", flush=True)
    time.sleep(60)
"""


def test_a_killed_owner_is_no_obstacle(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE,
                          text=True) as holder:  # fmt: skip
        assert holder.stdout is not None and holder.stdout.readline() == "ready\n"
        with pytest.raises(InputError, match=f"in use by process {holder.pid} since"):
            with claim(tmp_path):
                pytest.fail("claimed twice")
        holder.kill()
    assert (tmp_path / LOCK).is_file()
    with claim(tmp_path):
        assert json.loads((tmp_path / LOCK).read_text())["pid"] == os.getpid()
    assert not (tmp_path / LOCK).exists()


@pytest.mark.parametrize("content", ["", "{", '{"pid": "x"}', "[" * 9999, '{"pid": 1e999}'])
def test_a_damaged_lock_file_is_no_obstacle(content: str, tmp_path: Path) -> None:
    (tmp_path / LOCK).write_text(content)
    with claim(tmp_path):
        pass


def test_a_pipe_in_place_of_the_lock(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / LOCK)
    with pytest.raises(InputError, match=r"lock: is a device or pipe; expected a plain file"):
        with claim(tmp_path):
            pass
    assert not (tmp_path / LOCK).is_file()


def test_where_files_cannot_be_locked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def flock(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOTSUP, "not supported")

    monkeypatch.setattr(output_folder.fcntl, "flock", flock)
    with claim(tmp_path):
        with pytest.raises(InputError, match=f"in use by process {os.getpid()} since"):
            with claim(tmp_path):
                pytest.fail("claimed twice")
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    here = {"pid": ended.pid, "host": socket.gethostname(), "since": "yesterday"}
    (tmp_path / LOCK).write_text(json.dumps(here))
    with claim(tmp_path):
        pass
    (tmp_path / LOCK).write_text(json.dumps(here | {"host": "elsewhere"}))
    with pytest.raises(InputError, match=f"process {ended.pid} on elsewhere since yesterday"):
        with claim(tmp_path):
            pytest.fail("another machine's")


def test_every_command_that_writes_is_refused_at_once(tmp_path: Path, checkout: Path) -> None:
    deck = tmp_path / "deck.inp"
    deck.write_text("*NODE\n")
    scene = checkout / "examples" / "cantilever.toml"
    out = tmp_path / "out"
    before = sorted(tmp_path.iterdir())
    commands = (("run", scene), ("budget", scene), ("solve", deck), ("dic", deck, deck),
                ("calibrate", tmp_path, "--board", "9x8", "--square-mm", "1"))  # fmt: skip
    with claim(out):
        for command in commands:
            result = CliRunner().invoke(app, [*map(str, command), "-o", str(out)])
            assert result.exit_code == 2, result.output
            assert f"is in use by process {os.getpid()} since" in " ".join(result.stderr.split())
        assert [path.name for path in out.iterdir()] == [LOCK]
        planned = CliRunner().invoke(app, ["plan", str(scene), "-o", str(out)])
        assert planned.exit_code == 0  # it only looks
    assert sorted(tmp_path.iterdir()) == before


def test_two_runs_at_once_are_one_and_a_refusal(tmp_path: Path) -> None:
    out = tmp_path / "out"
    half = small_scene(output={})
    said: list[str] = []

    def progress(stage: str, done: float, text: str) -> None:
        if stage == "measure" and done == 0.0:
            with pytest.raises(InputError, match="is in use by process") as caught:
                gs.run(half.replace("body.bar.load.push.force_N", [0.0, 0.0, -25.0]), out,
                       backend="numpy")  # fmt: skip
            said.append(str(caught.value))

    report = gs.run(half, out, backend="numpy", progress=progress)
    assert len(said) == 1
    # F L^3 / 3 E I at the end of the bar, of which the marker is 10 mm short
    assert report.measurements[0].truth == pytest.approx(1.975 * (230 / 240) ** 1.5, rel=0.02)


# -- folders that can't be one -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", "no name"),
        ("a" * 300, "File name too long"),
        ("a\0b", "null"),
        ("/proc/gpusim-out", "No such file or directory"),
        ("file", "not a folder"),
        ("file/below", "not a folder"),
        ("dangling", "not a folder"),
    ],
)
def test_folders_that_cannot_be_one(
    name: str, message: str, tmp_path: Path, checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("mine")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(InputError, match=message):
        gs.run(small_scene(), name, backend="numpy")
    if not name.startswith("/proc"):  # which only who writes into it can find out
        with pytest.raises(InputError, match=message):
            check_folder(name)
    scene = str(checkout / "examples" / "cantilever.toml")
    for command in ("run", "plan"):
        if command == "plan" and name.startswith("/proc"):
            continue
        result = CliRunner().invoke(app, [command, scene, "-o", name])
        assert result.exit_code == 2, result.output
        assert "internal error" not in result.stderr and "Traceback" not in result.stderr
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    "place", ["images", "images/side", "stl/grey", "measure/tip.csv", ".gpusim", ".gpusim/blobs",
              "truth.h5", "figures", "scene.toml"],
)  # fmt: skip
@pytest.mark.parametrize("dangling", [False, True])
def test_links_in_the_folder_are_told_before_any_work(
    place: str, dangling: bool, tmp_path: Path
) -> None:
    victim = tmp_path / "victim"
    if not dangling:
        (victim / "deep").mkdir(parents=True)
        (victim / "0000.png").write_text("mine")
    out = tmp_path / "out"
    (out / place).parent.mkdir(parents=True)
    (out / place).symlink_to(victim)
    stages: list[str] = []
    with pytest.raises(InputError, match=f"{place}: is a link"):
        gs.run(small_scene(), out, backend="numpy", progress=lambda *said: stages.append(said[0]))
    assert stages == []
    left = sorted(path.name for path in victim.rglob("*")) if not dangling else victim.exists()
    assert left == (False if dangling else ["0000.png", "deep"])


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir(mode=0o500)
    with pytest.raises(InputError, match="images: can't be written to"):
        gs.run(small_scene(), tmp_path, backend="numpy")
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="can't be written to"):
        gs.run(small_scene(), tmp_path, backend="numpy")
