"""The command line: exit codes, messages, and nothing written on bad input."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import gpusim
from gpusim import errors
from gpusim._version import __version__
from gpusim.cli import app
from gpusim.cli.console import size_text, time_text
from gpusim.report.model import Measurement, Report

Run = Callable[..., Any]


@pytest.fixture
def cli() -> Run:
    def invoke(*arguments: str | Path) -> Any:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return invoke


@pytest.fixture
def scene(checkout: Path) -> Path:
    return checkout / "examples" / "crane.toml"


@pytest.fixture
def pipeline(monkeypatch: pytest.MonkeyPatch) -> types.SimpleNamespace:
    """A pipeline that notes its arguments and does what ``.act`` says."""
    fake = types.SimpleNamespace(calls=[], act=lambda progress: None)

    def run(scene: Any, out: Path, **options: Any) -> Report:
        fake.calls.append((scene, out, options))
        fake.act(options["progress"])
        item = Measurement.compare("tip", "mm", 32.70, 32.71)
        return Report("Tower crane", "none", "done", measurements=(item,), warnings=("be careful",))

    fake.run = run
    monkeypatch.setitem(sys.modules, "gpusim.pipeline", fake)
    monkeypatch.setattr(gpusim, "pipeline", fake, raising=False)
    return fake


def test_three_typos_exit_2_and_write_nothing(
    cli: Run, scene: Path, tmp_path: Path, pipeline: types.SimpleNamespace
) -> None:
    text = scene.read_text(encoding="utf-8")
    bad = tmp_path / "bad.toml"
    bad.write_text(
        text.replace("focal_mm", "focal_m").replace("bits = 8", "bit = 8").replace("vtu", "vtk"),
        encoding="utf-8",
    )
    for command in (("run", bad, "-o", tmp_path / "out"), ("plan", bad)):
        result = cli(*command)
        assert result.exit_code == 2
        assert result.stdout == ""
        for words in (
            "3 faults",
            "camera.front.focal_m",
            "sensor.bit:",
            "output.vtk",
            "did you mean",
        ):
            assert words in result.stderr
        assert "Traceback" not in result.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.toml"]
    assert pipeline.calls == []


def test_set_changes_the_scene(
    cli: Run, scene: Path, tmp_path: Path, pipeline: types.SimpleNamespace
) -> None:
    arguments = ("run", scene, "-o", tmp_path / "out", "--backend", "numpy", "--fresh", "--no-skip")
    changes = ("--set", "camera.front.focal_mm=35", "--set", "output.truth = ['flow']")
    result = cli(*arguments, *changes)
    assert result.exit_code == 0, result.output
    loaded, out, options = pipeline.calls[0]
    assert loaded.cameras[0].focal == 0.035
    assert loaded.output.truth == ("flow",)
    assert out == tmp_path / "out"
    del options["progress"]
    assert options == {
        "backend": "numpy",
        "fresh": True,
        "skip": False,
        "store": None,
        "verify": False,
    }
    assert "-0.031 %" in result.stdout
    assert "warning: be careful" in result.stdout
    assert f"Report: {tmp_path / 'out' / 'report.html'}" in result.stdout
    for wrong in ("camera.front.focal_mm", "=3", "camera.front.focal=35", "camera.x.focal_mm=35"):
        result = cli(*arguments, "--set", wrong)
        assert result.exit_code == 2, wrong
        assert len(pipeline.calls) == 1


def test_plain_progress_json_and_quiet(
    cli: Run, scene: Path, tmp_path: Path, pipeline: types.SimpleNamespace
) -> None:
    def work(progress: Any) -> None:
        for done in (0.0, 0.4, 1.0, 1.0):
            progress("solve", done, "17 iterations [1e-7]")

    pipeline.act = work
    out = tmp_path / "out"
    lines = cli("run", scene, "-o", out).stdout.splitlines()
    assert [" s  solve " in line for line in lines].count(True) == 1
    assert lines[0].endswith("  17 iterations [1e-7]")
    result = cli("run", scene, "-o", out, "--json")
    assert json.loads(result.stdout)["scene"] == "Tower crane"
    assert result.stderr == ""
    assert cli("run", scene, "-o", out, "--quiet").output == ""


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (errors.InputError("mesh: wrong"), 2, "error: mesh: wrong"),
        (errors.NotConverged("solve: stuck"), 3, "error: solve: stuck"),
        (errors.NoAdapter("no adapter"), 4, "error: no adapter"),
        (errors.DeviceLost("gone"), 4, "error: gone"),
        (errors.TwinMismatch("fem/krylov/cg: off"), 5, "error: fem/krylov/cg: off"),
        (KeyboardInterrupt(), 130, "error: interrupted"),
        (OSError(28, "No space left on device"), 1, "No space left on device"),
        (MemoryError(), 1, "out of memory"),
        (ZeroDivisionError("oops"), 1, "internal error, ZeroDivisionError: oops"),
    ],
)
def test_exit_codes(
    cli: Run,
    scene: Path,
    tmp_path: Path,
    pipeline: types.SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
    said: str,
) -> None:
    def fail(progress: Any) -> None:
        raise error

    pipeline.act = fail
    result = cli("run", scene, "-o", tmp_path / "out")
    assert result.exit_code == code
    assert said in result.stderr
    assert "Traceback" not in result.stderr
    if isinstance(error, errors.GpusimError):
        monkeypatch.setenv("GPUSIM_DEBUG", "1")
        assert "Traceback" in cli("run", scene, "-o", tmp_path / "out").stderr


@pytest.mark.parametrize(
    "arguments",
    [["frobnicate"], ["run"], ["run", "x.toml"], ["plan", "x.toml", "--backend", "cuda"]],
)
def test_wrong_usage_is_2(cli: Run, arguments: list[str]) -> None:
    result = cli(*arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_a_file_where_the_folder_should_be(
    cli: Run, scene: Path, tmp_path: Path, pipeline: types.SimpleNamespace
) -> None:
    (tmp_path / "out").write_text("mine", encoding="utf-8")
    for command in ("run", "plan"):
        result = cli(command, scene, "-o", tmp_path / "out")
        assert result.exit_code == 2
        assert "not a folder" in result.stderr
        assert "not a folder" in cli(command, scene, "-o", tmp_path / "out" / "below").stderr
    assert pipeline.calls == []


def test_a_folder_that_cannot_be_written_to(
    cli: Run, scene: Path, tmp_path: Path, pipeline: types.SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path)
    result = cli("run", scene, "-o", tmp_path / "new" / "out")
    assert result.exit_code == 2
    assert f"can't be written to; got {tmp_path};" in result.stderr
    assert pipeline.calls == []


def test_plan_of_the_crane(cli: Run, scene: Path, tmp_path: Path) -> None:
    result = cli("plan", scene, "-o", tmp_path / "none")
    assert result.exit_code == 0
    assert "render/front/0001" in result.stdout
    assert "Tower crane: valid; about" in result.stdout
    result = cli("plan", scene, "--json", "--set", "output.truth=[]")
    stages = {stage["name"]: stage for stage in json.loads(result.stdout)["stages"]}
    assert stages["truth"]["state"] == "skipped"
    assert stages["solve"]["memory_bytes"] > 0
    assert list(tmp_path.iterdir()) == []


def test_plan_of_a_cad_file_says_that_gmsh_is_missing(
    cli: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    scene = tmp_path / "part.toml"
    scene.write_text("""
schema = 1
name = "part"
material = [{ name = "steel", youngs_modulus_GPa = 210.0, poissons_ratio = 0.3 }]
[[body]]
name = "part"
material = "steel"
mesh = { file = "part.step", size_mm = 2.0 }
paint = [{ type = "plain", name = "grey", albedo = 0.5 }]
support = [{ name = "clamp", where = { set = "face_1" }, fix = ["x", "y", "z"] }]
load = [{ type = "force", name = "pull", where = { set = "face_2" }, force_N = [0.0, 0.0, 9.0] }]
""")
    assert "part.step: Gmsh can't mesh it" in cli("plan", scene).stderr
    monkeypatch.setitem(sys.modules, "gmsh", None)
    result = cli("plan", scene)
    assert result.exit_code == 2
    assert "part.step: a CAD file needs gmsh, which is not installed" in result.stderr
    assert f"{sys.executable} -m pip install gmsh" in result.stderr.replace("\n", "")


def test_schema_is_json(cli: Run) -> None:
    schema = json.loads(cli("schema").stdout)
    assert schema["title"] == "SceneTable" or "properties" in schema
    assert "focal_mm" in schema["$defs"]["CameraTable"]["properties"]


def test_module_starts_quickly_and_knows_its_version() -> None:
    """Heavy modules stay out of help and plan; their names are checked, not the clock."""
    code = (
        "import sys; sys.argv = ['gpusim', '--help']\n"
        "from gpusim.cli import main\n"
        "import gpusim.plan.plan\n"
        "code = main()\n"
        "heavy = {'numpy', 'scipy', 'wgpu', 'cv2', 'matplotlib', 'h5py'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
        "sys.exit(code)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "doctor" in done.stdout
    done = subprocess.run(
        [sys.executable, "-m", "gpusim", "--version"], capture_output=True, text=True, timeout=60
    )
    assert done.stdout == f"gpusim {__version__}\n"


def test_a_real_interrupt_ends_with_130(scene: Path, tmp_path: Path) -> None:
    code = (
        "import signal, sys, time, types, gpusim\n"
        # a shell that runs the tests in the background has told its children to ignore it
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def work(*args, **options):\n"
        "    print('working', flush=True)\n"
        "    time.sleep(30)\n"
        "gpusim.pipeline = sys.modules['gpusim.pipeline'] = types.SimpleNamespace(run=work)\n"
        "from gpusim.cli import main\n"
        f"sys.argv = ['gpusim', 'run', {str(scene)!r}, '-o', {str(tmp_path / 'out')!r}]\n"
        "sys.exit(main())\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "working\n"
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert stderr == "error: interrupted; what is finished will be reused by the next run\n"


def test_a_closed_pipe_is_quiet(scene: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "gpusim", "schema"],
        stdout=write, stderr=subprocess.PIPE, text=True, timeout=60,
    )  # fmt: skip
    os.close(write)
    assert done.returncode == 1
    assert done.stderr == ""


def test_doctor_verdicts(cli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    import gpusim.gpu

    def good(device: Any) -> None:
        pass

    def off(device: Any) -> None:
        raise errors.TwinMismatch("area/off: 3 of 9 values off")

    def broken(device: Any) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(gpusim.gpu, "twin_checks", lambda: {"area/good": good})
    result = cli("doctor")
    assert result.exit_code == 0, result.output
    assert "area/good" in result.stdout
    assert "max-storage-buffer-binding-size" in result.stdout
    checks = {"area/good": good, "area/off": off, "area/broken": broken}
    monkeypatch.setattr(gpusim.gpu, "twin_checks", lambda: checks)
    result = cli("doctor", "--json")
    assert result.exit_code == 5
    found = json.loads(result.stdout)
    verdicts = {check["stage"]: check["verdict"] for check in found["checks"]}
    assert verdicts == {"area/good": "ok", "area/off": "mismatch", "area/broken": "failed"}
    assert found["facts"]["adapter"]
    assert cli("check", "area/good").exit_code == 0
    assert cli("check", "area/off").exit_code == 5
    assert cli("check", "area/broken").exit_code == 1
    result = cli("check", "area/of")
    assert result.exit_code == 2
    assert "did you mean area/off?" in result.stderr


def test_doctor_without_an_adapter_says_what_to_install(
    cli: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    import gpusim.gpu

    class Gone:
        def __init__(self) -> None:
            raise errors.NoAdapter("no Vulkan adapter found")

    monkeypatch.setattr(gpusim.gpu, "Device", Gone)
    monkeypatch.setattr(gpusim.gpu, "twin_checks", lambda: {})
    result = cli("doctor")
    assert result.exit_code == 4
    assert "apt-get install mesa-vulkan-drivers" in result.stdout
    assert json.loads(cli("doctor", "--json").stdout)["exit_code"] == 4


def test_words_for_sizes_and_times() -> None:
    assert [size_text(n) for n in (0, 12, 3_400, 336e6, 1.2e9, 4e13)] == [
        "", "12 B", "3.4 kB", "336 MB", "1.2 GB", "40 TB",
    ]  # fmt: skip
    assert [time_text(s) for s in (0, 0.42, 17, 600, 10_800, 864_000, float("nan"))] == [
        "", "0.4 s", "17 s", "10 min", "3 h", "10 days", "",
    ]  # fmt: skip


def test_what_libraries_log_is_not_printed() -> None:
    """Their warnings, that is: an error that nobody caught is still seen."""
    code = (
        "import logging, sys; from gpusim.cli import main; sys.argv = ['gpusim', '--version']; "
        "main(); log = logging.getLogger('some.library'); log.warning('of no use'); "
        "log.error('lost')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "lost\n"
