"""Displacement and stress at the integration points against CalculiX, where it is installed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.fem import Isotropic, Model, Orthotropic, stress
from gpusim.fem.elements.element import ELEMENTS
from gpusim.mesh import box, quadratic, split
from tests.support.fem_reference import direct

Float = npt.NDArray[np.float64]
STEEL = Isotropic(200.0, 0.3)
WOOD = Orthotropic((140.0, 10.0, 7.0), (0.3, 0.4, 0.015), (5.0, 3.5, 4.5))

pytestmark = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX (ccx, Debian's calculix-ccx) isn't installed"
)


def elastic(material: Isotropic | Orthotropic) -> list[str]:
    if isinstance(material, Isotropic):
        return ["*ELASTIC", f"{material.E},{material.nu}"]
    e, nu, g = material.E, material.nu, material.G
    nu13 = nu[2] * e[0] / e[2]
    first = [*e, nu[0], nu13, nu[1], g[0], g[2]]
    return ["*ELASTIC,TYPE=ENGINEERING CONSTANTS", ",".join(map(repr, first)), f"{g[1]!r},293."]


def deck(model: Model, kind: str, name: str, material: Isotropic | Orthotropic) -> str:
    """The model as a CalculiX deck that prints u, and S and coordinates at the points."""
    lines = ["*NODE,NSET=NALL"]
    for number, point in enumerate(model.mesh.points.tolist(), start=1):
        lines.append(",".join(map(repr, [number, *point])))
    lines.append(f"*ELEMENT,TYPE={name},ELSET=EALL")
    for number, cell in enumerate(model.mesh.cells[kind].tolist(), start=1):
        row = [str(value) for value in (number, *(node + 1 for node in cell))]
        lines.append(",".join(row[:11]) + ("," if len(row) > 11 else ""))
        if len(row) > 11:
            lines.append(",".join(row[11:]))
    lines += ["*MATERIAL,NAME=M", *elastic(material), "*SOLID SECTION,ELSET=EALL,MATERIAL=M"]
    assert model.fixed is not None
    lines.append("*BOUNDARY")
    lines += [f"{node + 1},{axis + 1}" for node, axis in np.argwhere(model.fixed).tolist()]
    lines += ["*STEP", "*STATIC", "*CLOAD"]
    forces = model.load_cases[0]
    for node, axis in np.argwhere(forces).tolist():
        lines.append(f"{node + 1},{axis + 1},{float(forces[node, axis])!r}")
    lines += ["*NODE PRINT,NSET=NALL", "U", "*EL PRINT,ELSET=EALL", "S", "*EL PRINT,ELSET=EALL"]
    return "\n".join([*lines, "COORD", "*END STEP", ""])


def tables(text: str) -> list[Float]:
    """The numbers below each headline of a .dat file."""
    found: list[list[list[float]]] = []
    for line in text.splitlines():
        if "for set" in line:
            found.append([])
        elif line.strip() and found:
            found[-1].append([float(word) for word in line.split()])
    return [np.array(rows) for rows in found]


@pytest.mark.parametrize("material", [STEEL, WOOD], ids=["isotropic", "orthotropic"])
@pytest.mark.parametrize(
    ("kind", "formulation", "name"),
    [
        ("hex20", "full", "C3D20"), ("hex20", "reduced", "C3D20R"), ("tet4", "full", "C3D4"),
        ("tet10", "full", "C3D10"), ("wedge6", "full", "C3D6"), ("wedge15", "full", "C3D15"),
    ],
)  # fmt: skip
def test_calculix_finds_the_same_stress(
    kind: str, formulation: str, name: str, material: Isotropic | Orthotropic, tmp_path: Path
) -> None:
    rng = np.random.default_rng(1)
    mesh = box((2.0, 1.0, 1.0), (3, 2, 2))
    inner = ((mesh.points > 1e-9) & (mesh.points < np.array([2, 1, 1]) - 1e-9)).all(axis=1)
    mesh = mesh.moved(np.where(inner[:, None], 0.06 * rng.normal(size=mesh.points.shape), 0.0))
    for shape in ("tet", "wedge"):
        if kind.startswith(shape):
            mesh = split(mesh, {"tet": "tet4", "wedge": "wedge6"}[shape])
    if kind in ("hex20", "tet10", "wedge15"):
        mesh = quadratic(mesh)
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[mesh.points[:, 0] < 1e-9] = True
    forces = np.where(mesh.points[:, :1] > 2 - 1e-9, rng.normal(size=fixed.shape), 0.0)
    model = Model(mesh, [material], fixed, forces)
    u = direct(model, formulation)
    found = stress(model, u, formulation).points[kind]

    (tmp_path / "peer.inp").write_text(deck(model, kind, name, material))
    subprocess.run(["ccx", "-i", "peer"], cwd=tmp_path, check=True, capture_output=True)
    moved, stresses, places = tables((tmp_path / "peer.dat").read_text())
    # seven digits are printed
    assert np.abs(moved[:, 1:] - u).max() <= 1e-6 * np.abs(u).max()
    rule = ELEMENTS[kind].rule(formulation)
    own = np.matmul(rule.shape, mesh.points[mesh.cells[kind]])
    worst = 0.0
    for number in range(len(own)):
        peer_place = places[places[:, 0] == number + 1][:, 2:]
        distance = np.abs(peer_place[:, None] - own[number][None]).max(axis=2)
        assert distance.min(axis=1).max() <= 1e-5
        match = distance.argmin(axis=1)
        assert len(set(match.tolist())) == len(own[number])
        # CalculiX prints xx yy zz xy xz yz
        peer = stresses[stresses[:, 0] == number + 1][:, [2, 3, 4, 5, 7, 6]]
        worst = max(worst, float(np.abs(peer - found[number][match]).max()))
    assert worst <= 1e-6 * np.abs(found).max()
