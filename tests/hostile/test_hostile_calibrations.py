"""Damaged calibration files: cameras or an InputError that names the file, soon."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from tests.hostile.amount import SEED, share
from tests.optics.calibration.test_document import ROS

pytestmark = pytest.mark.hostile

COUNT = share(300)  # per format
SOON = 1.0  # s
FILES = {
    "a.yml": "opencv", "a.xml": "opencv", "a.json": "opencv", "b.yaml": "kalibr",
    "c.caldat": "matchid", "d.xml": "vic", "e.xml": "dice", "ros.yaml": "",
}  # fmt: skip
BITS = [
    b"[", b"]", b"{", b"}", b":", b"-", b"\n", b" ", b"\t", b"#", b"&a ", b"*a", b"!!float", b"|",
    b"nan", b".inf", b"1e999", b"-1", b"0", b"99999999999", b"\x00", b"\xff", b"'", b'"', b"<",
    b">", b"<a>", b"</camera>", b";", b",", b"9" * 5000, b"[" * 3000, b"<a>" * 3000, b"<<: *a\n",
    b"%YAML:1.0\n---\n", b"xi: 1\n", "²".encode(), b" " * 20000,
]  # fmt: skip


def whole(folder: Path, name: str) -> bytes:
    """A good file of that name."""
    pose = np.eye(4)
    pose[:3, 3] = [-0.12, 0.001, 0.003]
    K = np.array([[1200.5, 0, 319.5], [0, 1201.0, 239.5], [0, 0, 1]])
    lens = [-0.1, 0.02, 0.0, 0.0]
    cameras = [Camera(640, 480, K, lens, T, n) for T, n in ((np.eye(4), "left"), (pose, "right"))]
    path = folder / name
    if FILES[name]:
        gs.write_calibration(path, cameras, FILES[name])
    else:
        path.write_text(ROS)
    return path.read_bytes()


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """One to four cuts, copies, insertions and changed bytes."""
    for _ in range(rng.integers(1, 5)):
        at, end = sorted(rng.integers(0, len(data) + 1, 2))
        kind = rng.integers(0, 7)
        if kind == 0:
            data = data[:at]
        elif kind == 1:
            data = data[:at] + data[end:]
        elif kind == 2:
            data = data[:end] + data[at:]
        elif kind == 3:
            data = data[:at] + bytes(rng.integers(0, 256, 1, dtype=np.uint8)) + data[at + 1 :]
        elif kind == 4:
            lines = data.split(b"\n")
            rng.shuffle(lines)
            data = b"\n".join(lines)
        else:
            data = data[:at] + BITS[rng.integers(0, len(BITS))] + data[at:]
    return data


@pytest.mark.parametrize("name", list(FILES))
def test_a_result_or_an_error_that_names_the_file(tmp_path: Path, name: str) -> None:
    rng = np.random.default_rng([SEED, list(FILES).index(name)])
    good = whole(tmp_path, name)
    path = tmp_path / f"mutated-{name}"
    read = 0
    for number in range(COUNT):
        path.write_bytes(mutated(good, rng))
        clock = time.process_time()
        try:
            cameras = gs.read_calibration(path, (640, 480))
            assert cameras and all(np.isfinite(camera.K).all() for camera in cameras)
            read += 1
        except InputError as error:
            assert path.name in str(error) and len(str(error)) < 2000, (number, str(error)[:300])
        assert time.process_time() - clock < SOON, number
    assert read < COUNT
