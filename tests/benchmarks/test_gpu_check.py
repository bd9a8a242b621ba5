"""The ready run for real hardware: what fails or dies is a line, the others go on."""

from __future__ import annotations

import importlib.util
import json
import sys
import zipfile
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from benchmarks.gpu_cases import FE, IMAGES
from benchmarks.gpu_report import write_report
from benchmarks.solver.cases import CASES


def script(checkout: Path, name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, checkout / "scripts" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_cases_and_stored_images_exist(checkout: Path) -> None:
    from benchmarks.gpu_parts import _BRACKETS, image_case, samples

    known = {case.name for case in (*CASES, *_BRACKETS)}
    assert {name for names in FE.values() for name in names} <= known
    path = checkout / "benchmarks" / "results" / "gpu_check_reference.npz"
    assert path.stat().st_size < 200_000
    with np.load(path) as stored:
        for scale, names in IMAGES.items():
            for name in names:
                assert stored[f"{name}-{scale}-blocks"].shape == (16, 24)
                assert np.ptp(stored[f"{name}-{scale}-squares"]) > 0.1
    case = image_case("board", "quick")
    y, x = np.mgrid[: case.camera.height, : case.camera.width].astype(np.float32)
    got = samples(case, 3 * x + y)["blocks"]
    assert got.mean() == pytest.approx(float((3 * x + y).mean()), rel=0.01)
    assert (np.diff(got, axis=0) > 0).all() and (np.diff(got, axis=1) > 0).all()


def test_wheels_are_taken_by_their_tags(checkout: Path, tmp_path: Path) -> None:
    unpack = script(checkout, "unpack_wheels")
    minor, machine = sys.version_info[1], unpack.platform.machine()
    right = ("a-1-py3-none-any.whl", f"b-1-cp3{minor}-cp3{minor}-manylinux_2_28_{machine}.whl",
             f"c-1-cp37-abi3-manylinux2014_{machine}.manylinux_2_17_{machine}.whl",
             "d-1-py2.py3-none-any.whl")  # fmt: skip
    wrong = (f"e-1-cp3{minor + 1}-cp3{minor + 1}-manylinux_2_28_{machine}.whl",
             f"f-1-cp3{minor}-cp3{minor}-win_amd64.whl", f"g-1-cp3{minor + 1}-abi3-any.whl",
             f"h-1-cp3{minor - 1}-cp3{minor - 1}-manylinux_2_28_{machine}.whl")  # fmt: skip
    assert all(map(unpack.fits, right)) and not any(map(unpack.fits, wrong))
    (tmp_path / "site").mkdir()
    for name in (right[0], wrong[0]):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.writestr(f"{name[0]}.py", "x = 1")
            archive.writestr(f"{name[0]}-1.data/purelib/{name[0]}_more.py", "y = 2")
    assert unpack.unpack(tmp_path, tmp_path / "site") == [right[0]]
    assert {path.name for path in (tmp_path / "site").glob("*.py")} == {"a.py", "a_more.py"}
    with zipfile.ZipFile(tmp_path / "x-1-py3-none-any.whl", "w") as archive:
        archive.writestr("../evil.py", "")
    with pytest.raises(SystemExit, match="outside of its folder"):
        unpack.unpack(tmp_path, tmp_path / "site")


def test_parts_that_die_hang_or_say_why(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    check = script(checkout, "gpu_check")
    child = tmp_path / "child.py"
    child.write_text(
        "import json, os, sys, time\n"
        "part, options = sys.argv[2], json.loads(sys.argv[4])\n"
        "for stage in ['a', 'b', 'c']:\n"
        "    if stage not in options.get('done', []):\n"
        "        print('RESULT', json.dumps({'stage': stage, 'verdict': 'began'}), flush=True)\n"
        "        if stage == 'b': os.kill(os.getpid(), 9)\n"
        "        print('RESULT', json.dumps({'stage': stage, 'verdict': 'ok', 'seconds': 0.5}))\n"
        "if part == 'fe:slow': time.sleep(60)\n"
        "if part == 'fe:said': print('RESULT', json.dumps({'failed': 'no memory'})); sys.exit(1)\n"
    )
    monkeypatch.setattr(check, "__file__", str(child))
    found = check.Check(tmp_path, "quick", 1.0)
    found.doctor("f64")
    assert [one["failed"][:9] for one in found.parts] == ["died with", ""]
    stages = [row for one in found.parts for row in one["results"]]
    assert [row["stage"] for row in stages if row["verdict"] == "ok"] == ["a", "c"]
    monkeypatch.setitem(check.LIMIT, "fe", 5.0)
    found.part("fe:said", done=["a", "b", "c"])
    assert found.parts[-1]["failed"] == "no memory"
    monkeypatch.setitem(check.LIMIT, "fe", 0.1)
    found.part("fe:cut")
    found.ends = 0.0
    assert found.part("dic") == [] and "the time is up" in found.parts[-1]["failed"]
    assert "the time is up" in found.parts[-2]["failed"]


def test_the_report_reads_what_parts_tell(tmp_path: Path) -> None:
    own = {"name": "Test GPU, driver 1", "software": False, "real": "f64", "timestamps": True,
           "info": {"adapter_type": "DiscreteGPU", "backend_type": "Vulkan"}, "processor": "CPU",
           "cores": 8, "system": "Linux", "gpusim": "1", "python": "3", "numpy": "2"}  # fmt: skip
    solved = {"case": "cube-345k", "where": "device", "unknowns": 345744, "iterations": 9,
              "converged": True, "error": 3e-8, "seconds": 0.5, "device": {"fem/krylov/cg": 0.2},
              "timings": {"assembly": 0.1, "iterations": 0.4}}  # fmt: skip
    drawn = {"case": "board", "width": 2448, "height": 1632, "triangles": 448, "first": 0.5,
             "warm": 0.0123, "device": None, "read": 0.004, "mean_difference": 2e-8,
             "most_difference": None}  # fmt: skip
    dic = {"case": "pair", "where": "host", "first": 2.0, "warm": 2.0, "subsets": 20000,
           "measured": 19990, "rms": 0.004}  # fmt: skip

    def part(name: str, *rows: Any, failed: str = "") -> dict[str, Any]:
        return {"part": name, "failed": failed, "seconds": 1.0, "results": list(rows)}

    parts = [
        part("adapter", own),
        part(
            "doctor:f64", {"stage": "fem/krylov/cg", "verdict": "ok", "seconds": 0.2, "message": ""}
        ),
        part(
            "doctor:double_single",
            {
                "stage": "fem/krylov/cg",
                "verdict": "wrong",
                "seconds": 0.2,
                "message": "TwinMismatch: off by 3",
            },
        ),
        part("image:board", drawn, {"picture": str(tmp_path / "board.png")}),
        part("fe:cube-345k", solved),
        part("fe:cube-971k", {**solved, "case": "cube-971k", "error": 2e-4}),
        part("fe:beam-300k", {"failed": "lost"}, failed="lost"),
        part("dic", dic),
    ]
    data, page = write_report(parts, "full", tmp_path, "test-gpu")
    assert json.loads(data.read_text())["parts"][0]["results"][0]["name"] == own["name"]
    text = page.read_text()
    for line in (
        "# gpusim on Test GPU, driver 1",
        "- fe:beam-300k: lost",
        "- double_single, fem/krylov/cg: TwinMismatch: off by 3",
        "- board: most difference -",
        "- cube-971k, device: off by 2.0e-04",
        "| fem/krylov/cg | ok, 200 ms | **wrong** |",
        "| cube-345k | 345,744 | device | 500 ms | 3.0e-08 | 9 | assembly 100 ms, iterations 400 "
        "ms; on the device 200 ms |",
        "| board | 2448 x 1632 | 448 | 500 ms | 12.3 ms | - | 4 ms | 2.0e-08 | - |",
        "| pair | host | 20,000 | 19,990 | 2.00 s | 2.00 s | 10,000 | 0.00400 |",
        "![board](board.png)",
    ):
        assert line in text, line
