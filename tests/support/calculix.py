"""A model solved by CalculiX (``ccx``), for comparison: the deck written, run, and read back."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.fem import Isotropic, Model

Float = npt.NDArray[np.float64]

# (cell type, our formulation) -> CalculiX's element with the same integration.
ELEMENT = {
    ("hex8", "incompatible"): "C3D8I",
    ("hex8", "full"): "C3D8",
    ("hex20", "full"): "C3D20",
    ("hex20", "reduced"): "C3D20R",
    ("tet4", "full"): "C3D4",
    ("tet10", "full"): "C3D10",
    ("wedge6", "full"): "C3D6",
    ("wedge15", "full"): "C3D15",
}
_PER_LINE = 10


@dataclass(frozen=True)
class Answer:
    """``u`` (L,N,3) displacements to 7 digits, ``stress`` (L,N,6) nodal averages xx yy zz xy yz zx
    to 6 digits."""

    u: Float
    stress: Float


def run(model: Model, formulation: str, folder: Path, displacements: bool = False) -> Answer:
    """CalculiX's answer, every load case a step. Skips the test where ``ccx`` isn't installed.

    With ``displacements`` the .frd file holds them too.
    """
    program = shutil.which("ccx")
    if program is None:
        pytest.skip("CalculiX isn't installed (Debian: calculix-ccx)")
    (folder / "model.inp").write_text("\n".join(_deck(model, formulation, displacements)) + "\n")
    done = subprocess.run(
        [program, "model"], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout[-2000:]
    shape = model.load_cases.shape
    return Answer(
        _displacements(folder / "model.dat", shape), _stresses(folder / "model.frd", shape)
    )


def _deck(model: Model, formulation: str, displacements: bool) -> list[str]:
    mesh = model.mesh
    (kind, _, block), *others = mesh.blocks()
    assert not others and len(model.materials) == 1
    (material,) = model.materials
    assert isinstance(material, Isotropic) and model.fixed is not None
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in enumerate(mesh.points, 1)]
    lines.append(f"*ELEMENT, TYPE={ELEMENT[kind, formulation]}, ELSET=BODY")
    for number, cell in enumerate(block + 1, 1):
        entries = [str(number), *map(str, cell)]
        rows = [entries[k : k + _PER_LINE] for k in range(0, len(entries), _PER_LINE)]
        lines += [", ".join(row) + ("," if row is not rows[-1] else "") for row in rows]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{material.E:.12e}, {material.nu:.12e}"]
    lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=M", "*BOUNDARY"]
    lines += [f"{node + 1}, {axis + 1}, {axis + 1}" for node, axis in np.argwhere(model.fixed)]
    for forces in model.load_cases:
        lines += ["*STEP", "*STATIC", "*CLOAD, OP=NEW"]
        lines += [
            f"{node + 1}, {axis + 1}, {forces[node, axis]:.12e}"
            for node, axis in np.argwhere(forces != 0.0)
        ]
        lines += ["*NODE FILE", "U"] if displacements else []
        lines += ["*NODE PRINT, NSET=ALL", "U", "*EL FILE", "S", "*END STEP"]
    return lines


def _displacements(path: Path, shape: tuple[int, ...]) -> Float:
    u = np.full(shape, np.nan)
    step = -1
    for line in path.read_text().splitlines():
        if "displacements" in line:
            step += 1
        elif line.strip():
            node, *values = line.split()
            u[step, int(node) - 1] = [float(value) for value in values]
    assert np.isfinite(u).all()
    return u


def _stresses(path: Path, shape: tuple[int, ...]) -> Float:
    result = np.full((*shape[:2], 6), np.nan)
    step, inside = -1, False
    for line in path.read_text().splitlines():
        if line.startswith(" -4"):
            inside = "STRESS" in line
            step += inside
        elif line.startswith(" -3"):
            inside = False
        elif inside and line.startswith(" -1"):
            values = [float(line[13 + 12 * k : 25 + 12 * k]) for k in range(6)]
            result[step, int(line[3:13]) - 1] = values
    assert np.isfinite(result).all()
    return result
