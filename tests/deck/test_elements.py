"""One bent element of each type against CalculiX 2.20: pressure, temperature, rotation.

The decks are written here; the displacements below are what CalculiX printed for them (seven
digits). Bent edges tell the integration rules of faces and volumes apart, and temperatures without
a pattern tell how each type interpolates them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.deck import load_deck
from gpusim.mesh import CELL_TYPES
from gpusim.mesh.formats.abaqus.elements import SOLID_TYPES
from gpusim.mesh.shape_functions import reference_nodes
from tests.support.deck_texts import step, write

TYPES = ["C3D4", "C3D6", "C3D8", "C3D10", "C3D15", "C3D20", "C3D20R"]

# Displacement of the last node not held: under pressure on face 2, warm, rotating.
CALCULIX: dict[str, list[list[float]]] = {
    "C3D4": [
        [-6.293235e-02, 2.793612e-01, -2.469184e-02],
        [1.357902e-02, -1.216126e-02, 4.770368e-02],
        [-1.688120e-02, -5.302977e-01, 1.138405e-01],
    ],
    "C3D6": [
        [1.068844e-01, 9.537309e-02, -1.268941e-01],
        [-5.506268e-03, 1.393131e-02, 1.359525e-01],
        [-3.618812e00, -1.256782e01, 4.040584e00],
    ],
    "C3D8": [
        [-7.751464e-02, 4.162069e-02, -1.289618e-01],
        [-6.940125e-02, 5.739673e-02, 2.439508e-01],
        [-1.132971e01, -1.544796e01, 3.416899e00],
    ],
    "C3D8I": [
        [-1.025065e-01, 3.202044e-02, -1.341660e-01],
        [-5.811499e-02, 1.979469e-02, 2.631513e-01],
        [-3.339503e01, -2.737333e01, 1.370112e00],
    ],
    "C3D10": [
        [1.773965e-01, 3.475165e-01, -9.522042e-02],
        [-1.052242e-01, -3.163598e-02, 1.591089e-01],
        [-1.533905e00, -1.036548e00, 7.048797e-02],
    ],
    "C3D15": [
        [-1.698998e-01, 3.000406e-02, -1.027529e-01],
        [-1.257058e-01, 1.557726e-01, 5.410194e-01],
        [-1.488762e01, -1.749377e01, 7.399304e00],
    ],
    "C3D20": [
        [-4.025095e-02, 2.505476e-02, -6.254043e-02],
        [-2.702693e-01, 2.517642e-01, 4.820223e-01],
        [-1.008773e01, -9.320734e00, 1.028162e00],
    ],
    "C3D20R": [
        [6.113247e-03, 6.375014e-02, -6.307020e-02],
        [-5.811117e-01, 3.220732e-01, 3.886250e-01],
        [-2.475133e01, -1.905266e01, 3.029111e-01],
    ],
}


def bent(written: str) -> tuple[str, int]:
    """A deck of one element with bent edges, and the label of its last node that isn't held."""
    kind = SOLID_TYPES[written]
    cell, count = CELL_TYPES[kind], CELL_TYPES[kind].nodes
    points = reference_nodes(kind) * [2.0, 3.0, 5.0]
    away = np.arange(3 * count).reshape(count, 3)
    points = points + 0.15 * np.sin(1.0 + 2.3 * away)
    labels = [f"{k + 1}" for k in range(count)]
    row = ["1", *labels]
    held = {int(node) for node in cell.faces[0] if node >= 0}
    lines = ["*NODE"]
    lines += [f"{k + 1}, {x:.9f}, {y:.9f}, {z:.9f}" for k, (x, y, z) in enumerate(points.tolist())]
    lines += [f"*ELEMENT, TYPE={written}, ELSET=E"]
    lines += [
        ", ".join(row[k : k + 10]) + "," * (k + 10 < len(row)) for k in range(0, len(row), 10)
    ]
    lines += ["*NSET, NSET=ALL", *labels, "*BOUNDARY"]
    lines += [f"{node + 1}, 1, 3" for node in sorted(held)]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC, TYPE=ENGINEERING CONSTANTS"]
    lines += ["200., 100., 50., 0.3, 0.2, 0.25, 40., 30.,", "20.", "*DENSITY", "2."]
    lines += ["*EXPANSION, TYPE=ORTHO", "1.E-3, 2.E-3, 4.E-3", "*ORIENTATION, NAME=O"]
    lines += ["1., 2., 0.5, -0.3, 1., 2.", "*SOLID SECTION, ELSET=E, MATERIAL=M, ORIENTATION=O"]
    lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "ALL, 10."]
    warm = [f"{k + 1}, {10.0 + 40.0 * np.sin(3.0 * k) ** 2:.6f}" for k in range(count)]
    output = ["*NODE PRINT, NSET=ALL", "U"]
    steps = step("*DLOAD", "E, P2, 1.", *output)
    steps += step("*DLOAD, OP=NEW", "*TEMPERATURE", *warm, *output)
    steps += step(
        "*TEMPERATURE, OP=NEW", "*DLOAD", "E, CENTRIF, 2., 0.5, 1., 0., 1., 1., 3.", *output
    )
    free = max(set(range(count)) - held)
    return "\n".join(lines) + "\n" + steps, free + 1


@pytest.mark.parametrize("written", TYPES)
def test_bent_elements(written: str, tmp_path: Path) -> None:
    text, label = bent(written)
    deck = load_deck(write(tmp_path, text))
    for solution, published in zip(
        deck.solve(backend="numpy", tolerance=1e-9), CALCULIX[written], strict=True
    ):
        size = np.abs(solution.u).max()
        np.testing.assert_allclose(solution.u[label - 1], published, rtol=0.0, atol=1e-6 * size)


def test_incompatible_modes_of_a_bent_brick(tmp_path: Path) -> None:
    """CalculiX doesn't scale the modes by the Jacobian, without which an element that isn't a
    parallelepiped fails the patch test (Taylor, Beresford & Wilson 1976); ours does."""
    text, label = bent("C3D8I")
    deck = load_deck(write(tmp_path, text))
    for solution, published in zip(
        deck.solve(backend="numpy", tolerance=1e-9), CALCULIX["C3D8I"], strict=True
    ):
        difference = np.abs(solution.u[label - 1] - published).max() / np.abs(solution.u).max()
        assert 1e-4 <= difference <= 1e-2
