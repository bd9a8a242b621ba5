"""A neo-Hookean block stretched to ten times its length, beside torch-fem, whose benchmark it is.

Four layers of cubes, N - 1 each way across, along with nodes in the middle that stay there, are
pulled in ten steps of equal ratio (torch-fem counts the unstretched state, too). The exact answer
is even, and known: what is compared is time. Both integrate linear hexahedra fully.
"""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from gpusim.fem import Model, NeoHookean, solve
from gpusim.mesh import box

HEADINGS = (
    "program", "on", "unknowns", "Newton", "linear", "processor s", "wall s", "force off by",
)  # fmt: skip

Bool = npt.NDArray[np.bool_]
_PEER = Path(__file__).resolve().parents[1] / "peers" / "torch_fem.py"
_LAW, _STRETCH, _STEPS = NeoHookean(1000.0, 0.3), 10.0, 10
# the last is the size of torch-fem's own figure
_OURS, _THEIRS = (25, 65, 85), 25
# told by torch-fem's authors: forward solution, wall time
_PUBLISHED = (
    ("Threadripper, CPU", "63,375", "37"),
    ("RTX 5090", "108,375", "28.6"),
)


def stretched_block(count: int) -> tuple[Model, Bool]:
    """The model with ``count`` nodes each way across, an odd number, and the end that is pulled."""
    thickness = 4.0 / (count - 1)
    mesh = box((thickness, 1.0, 1.0), (4, count - 1, count - 1), origin=(0.0, -0.5, -0.5))
    middle = np.abs(mesh.points) <= 1e-12
    end = mesh.points[:, 0] >= thickness * (1.0 - 1e-9)
    fixed = np.column_stack([middle[:, 0] | end, middle[:, 1:]])
    pulled = np.zeros_like(mesh.points)
    pulled[end, 0] = (_STRETCH - 1.0) * thickness
    return Model(mesh, _LAW, fixed, prescribed=pulled), end


def exact_force() -> float:
    """Of a block of section 1 that is free to thin."""
    shear, lame = _LAW.shear, _LAW.lame

    def across(side: float) -> float:
        return shear * (side**2 - 1.0) + lame * np.log(_STRETCH * side**2)

    side = brentq(across, 0.05, 1.0, xtol=1e-15)
    return float((shear * (_STRETCH**2 - 1.0) + lame * np.log(_STRETCH * side**2)) / _STRETCH)


def stretch(peers: bool) -> Iterator[list[str]]:
    """One row of text after the other: ours, torch-fem's where it is installed, what was told."""
    exact = exact_force()
    for count in _OURS:
        wall, processor = time.perf_counter(), time.process_time()
        model, end = stretched_block(count)
        factors = (np.geomspace(1.0, _STRETCH, _STEPS + 1)[1:] - 1.0) / (_STRETCH - 1.0)
        found = solve(model, geometry="nonlinear", factors=factors, formulation="full")
        assert found.converged, found.message
        processor, wall = time.process_time() - processor, time.perf_counter() - wall
        force = float(found.reactions[end, 0].sum())
        every = sum(len(step.iterations) for step in found.steps)
        yield ["gpusim", "here", f"{model.fixed.size:,}", str(every), str(found.iterations),
               f"{processor:.1f}", f"{wall:.1f}", f"{force / exact - 1.0:.0e}"]  # fmt: skip
    if peers:
        yield torch_fem(_THEIRS, exact)
    for machine, unknowns, seconds in _PUBLISHED:
        yield ["torch-fem", f"{machine}, as published", unknowns, "", "", "", seconds, ""]


def torch_fem(count: int, exact: float) -> list[str]:
    """Its row, on one processor as ours; what is missing, where it isn't installed."""
    own = _PEER.parent / ".venv" / "bin" / "python"
    python = os.environ.get("GPUSIM_PEERS_PYTHON", str(own))
    threads = {**os.environ, "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run([python, str(_PEER), str(count)], capture_output=True, text=True,
                              env=threads, check=True)  # fmt: skip
    except (OSError, subprocess.CalledProcessError):
        return ["torch-fem", "missing", *[""] * 6]
    row = json.loads(done.stdout.strip().splitlines()[-1])
    return [row["name"], "here", f"{row['unknowns']:,}", "", "", f"{row['cpu']:.1f}",
            f"{row['wall']:.1f}", f"{row['force'] / exact - 1.0:.0e}"]  # fmt: skip
