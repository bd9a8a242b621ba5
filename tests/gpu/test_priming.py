"""Programs that software drivers have compiled before their first use."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from gpusim.gpu import Device
from gpusim.gpu.adapter import is_processor
from gpusim.gpu.priming import CompiledPrograms, _cache_folder

PICTURE = """
import json, os, sys
from pathlib import Path
import gpusim as gs

def files():
    cache = Path(os.environ["MESA_SHADER_CACHE_DIR"])
    return sum(path.is_file() and path.suffix != ".txt" for path in cache.rglob("*"))

device = gs.Device()
wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
camera = gs.Camera.from_lens((36, 24), 50, (48, 32), (0, 0, 9), (0, 0, 0), up=(0, 1, 0))
device.programs.begin(json.loads(sys.argv[1]))
for threads in device.programs._threads:
    threads.shutdown(wait=True)
before = files()
gs.render([wall], camera, [gs.SunLight((0, 0, -1), 1.0)], device=device)
device.sync()
print(json.dumps([before, files(), list(device.programs.asked)]))
"""


def first_picture(cache: Path, programs: list[Any]) -> tuple[int, int, list[Any]]:
    """Files in the driver's cache before and after a picture in a new process, and its programs."""
    environment = {**os.environ, "MESA_SHADER_CACHE_DIR": str(cache)}
    environment.pop("MESA_SHADER_CACHE_DISABLE", None)
    done = subprocess.run(
        [sys.executable, "-c", PICTURE, json.dumps(programs)],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    before, after, asked = json.loads(done.stdout.splitlines()[-1])
    return before, after, asked


def test_a_picture_finds_primed_programs_in_the_cache_of_the_driver(
    device: Device, tmp_path: Path
) -> None:
    if not is_processor(device.info):
        pytest.skip("a graphics card's driver compiles programs when they are made")
    nothing, all_of_them, asked = first_picture(tmp_path / "a", [])
    assert all_of_them > nothing + 2
    primed, after, _ = first_picture(tmp_path / "b", asked)
    assert primed == after
    assert primed > all_of_them - 2
    names = (tmp_path / "b" / "mesa_shader_cache" / "gpusim-programs.txt").read_text().split()
    assert len(names) == len(set(names)) == len(asked)


def test_what_was_primed_is_known_to_later_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MESA_SHADER_CACHE_DIR", str(tmp_path))
    monkeypatch.delenv("MESA_SHADER_CACHE_DISABLE", raising=False)
    programs = CompiledPrograms("driver 1")
    assert programs.lacks("code", ("name", "main"))
    programs.add("code", ("name", "main"))
    assert not programs.lacks("code", ("name", "main"))
    assert not CompiledPrograms("driver 1").lacks("code", ("name", "main"))
    assert CompiledPrograms("driver 2").lacks("code", ("name", "main"))
    assert CompiledPrograms("driver 1").lacks("other code", ("name", "main"))
    assert CompiledPrograms("driver 1").lacks("code", ("name", "other"))
    (tmp_path / "mesa_shader_cache" / "gpusim-programs.txt").write_bytes(b"\xff\xfe broken")
    assert CompiledPrograms("driver 1").lacks("code", ("name", "main"))


def test_nothing_is_primed_where_the_driver_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MESA_SHADER_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("MESA_SHADER_CACHE_DISABLE", "true")
    programs = CompiledPrograms("driver")
    assert not programs.lacks("code", "key")
    programs.add("code", "key")
    assert not list(tmp_path.iterdir())


def test_where_the_driver_keeps_machine_code() -> None:
    home = {"HOME": "/h"}
    assert _cache_folder(home) == Path("/h/.cache/mesa_shader_cache")
    assert _cache_folder({**home, "XDG_CACHE_HOME": "/c"}) == Path("/c/mesa_shader_cache")
    assert _cache_folder({"MESA_SHADER_CACHE_DIR": "/d"}) == Path("/d/mesa_shader_cache")
    assert _cache_folder({}) is None
