"""Where things run: "auto" everywhere; a machine without an adapter is found out, not guessed."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device, chosen_backend, working_device
from gpusim.pipeline.runner.error_budget import run_budget
from gpusim.plan import plan
from tests.support.measure_images import Waves

PUBLIC = [
    gs.render, gs.photograph, gs.run, gs.measure.dic, gs.measure.stereo_dic,
    gs.measure.stereo_shape, gs.measure.track, gs.fem.solve, gs.Deck.solve, plan.make_plan,
    run_budget,
]  # fmt: skip

WITHOUT = """
import warnings, numpy as np, gpusim as gs
first = np.random.default_rng(1).uniform(size=(41, 57))
second = np.roll(first, 1, axis=1)
camera = gs.Camera(57, 33, K=[[50, 0, 28], [0, 50, 16], [0, 0, 1]])
square = [[-1.0, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]]
body = gs.Surface(np.array(square), [[0, 2, 1], [0, 3, 2]], gs.paint.Plain(0.4))
with warnings.catch_warnings(record=True) as seen:
    warnings.simplefilter("always")
    assert gs.render([body], camera).radiance.max() > 0.3
    found = gs.measure.dic(first, second, subset=21, step=9)
    assert found.ok.any() and abs(found.displacement[found.ok] - [1.0, 0.0]).max() < 1e-3
    gs.measure.dic(first, second, subset=21, step=9)
assert len(seen) == 1, [str(one.message) for one in seen]
assert "no Vulkan adapter" in str(seen[0].message) and "apt-get install" in str(seen[0].message)
for call in (lambda: gs.render([body], camera, backend="gpu"),
             lambda: gs.measure.dic(first, second, subset=21, backend="gpu")):
    try:
        call()
    except gs.NoAdapter as error:
        assert error.exit_code == 4
    else:
        raise AssertionError("no error")
print("good")
"""


def without_adapter(*command: str) -> subprocess.CompletedProcess[str]:
    nowhere = {"VK_ICD_FILENAMES": "/nowhere.json", "VK_DRIVER_FILES": "/nowhere.json"}
    return subprocess.run(
        [sys.executable, *command], env=os.environ | nowhere, capture_output=True, text=True,
        timeout=120, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("function", PUBLIC, ids=lambda function: function.__qualname__)
def test_one_default_everywhere(function: object) -> None:
    assert inspect.signature(function).parameters["backend"].default == "auto"  # type: ignore[arg-type]


def test_without_an_adapter_numpy_works_with_one_warning() -> None:
    done = without_adapter("-c", WITHOUT)
    assert done.stdout == "good\n", done.stderr


def test_the_command_line_without_an_adapter(tmp_path: Path) -> None:
    waves = Waves(4)
    y, x = np.indices((41, 57), dtype=np.float64)
    names = [str(tmp_path / name) for name in ("a.png", "b.png")]
    for name, u in zip(names, (0.0, 0.4), strict=True):
        image = np.clip(np.rint(waves.at(x - u, y)), 0, 255).astype(np.uint8)
        gs_write(name, image)
    command = ["-m", "gpusim", "dic", *names, "-o", str(tmp_path / "out"), "--subset", "21"]
    done = without_adapter(*command)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("warning: no Vulkan adapter") == 1
    assert without_adapter(*command, "--backend", "gpu").returncode == 4
    quiet = without_adapter(*command, "--backend", "numpy")
    assert (quiet.returncode, "warning" in quiet.stderr) == (0, False)


def gs_write(name: str, image: np.ndarray) -> None:
    from gpusim.export.images import write_image

    write_image(name, image)


def test_the_decision(device: Device) -> None:
    assert chosen_backend("x", "auto") == "gpu"
    assert working_device("x", "auto", device) is device
    assert working_device("x", "gpu", device) is device
    assert working_device("x", "numpy") is None
    with pytest.raises(InputError, match="x backend; got 'cuda'; expected 'auto', 'gpu'"):
        chosen_backend("x", "cuda")
    with pytest.raises(InputError, match="track backend; got 'gpu'"):
        gs.measure.track(np.ones((9, 9)), np.ones((9, 9)), [[4, 4]], subset=5, backend="gpu")
