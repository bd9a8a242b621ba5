"""Print the tables of docs/verification.md: our values, the published ones, and CalculiX's.

Run from the checkout: ``python scripts/verification.py``. CalculiX (``ccx``) is optional.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from tests.support import calculix
from tests.support.bonded_block import FORCE, plate_force
from tests.support.plastic_cases import Slice, bent, tube_under_pressure, widened_tube
from tests.support.verification_models import (
    Problem,
    cook_membrane,
    elliptic_plate,
    node_at,
    slender_beam,
)

SHAPES = ("rectangular", "trapezoidal", "parallelogram")
ELEMENTS = [
    ("hex8", "incompatible"), ("hex8", "full"), ("hex8", "bbar"), ("hex20", "full"),
    ("hex20", "reduced"), ("hex27", "full"), ("tet10", "full"), ("wedge15", "full"),
]  # fmt: skip
PLATES = {
    "hex8": (24, (24, 32, 1), (16, 24, 12)),
    "hex20": (12, (12, 16, 1), (8, 12, 6)),
    "hex27": (8, (8, 12, 1), (8, 12, 6)),
    "tet10": (10, (8, 12, 1), (6, 8, 4)),
    "wedge15": (10, (8, 12, 1), (6, 8, 4)),
}

RINGS = [Slice("hex8", "incompatible", 40), Slice("hex8", "bbar", 40),
         Slice("hex20", "reduced", 20), Slice("hex20", "full", 20), Slice("tet10", "bbar", 40),
         Slice("wedge15", "full", 20)]  # fmt: skip
LAYERS = [Slice(ring.kind, ring.formulation, 32 if ring.cells == 20 else 64) for ring in RINGS]
BLOCKS = [("hex8", "incompatible", (6, 12)), ("hex8", "bbar", (6, 12)),
          ("hex20", "reduced", (4, 8)),
          ("hex20", "full", (4, 8)), ("tet10", "full", (4, 8)), ("tet10", "bbar", (4, 8)),
          ("wedge15", "full", (4, 8))]  # fmt: skip


def peer(problem: Problem, kind: str, formulation: str) -> dict[str, float] | None:
    """CalculiX's displacements judged like ours; its own nodal stress."""
    if (kind, formulation) not in calculix.ELEMENT or shutil.which("ccx") is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        answer = calculix.run(problem.model, formulation, Path(folder))
    values = problem.values(answer.u, formulation)
    if "stress yy at D" in values:
        top = problem.model.mesh.bounds[1, 2]
        corner = node_at(problem.model.mesh, (2.0, 0.0, float(top)))
        values["stress yy at D"] = float(answer.stress[0, corner, 1])
    return values


def beams() -> None:
    """Tip displacement over beam theory, ours and the peer's, per shape."""
    for shape in SHAPES:
        print(f"\n{shape}:\n")
        print("| element | extension | in-plane | out-of-plane | twist |")
        print("|---|---|---|---|---|")
        for kind, formulation in ELEMENTS:
            across = 2 if formulation == "reduced" else 1
            problem = slender_beam(kind, shape, across)
            ours, theirs = problem.solved(formulation), peer(problem, kind, formulation)
            cells = []
            for name, exact in problem.published.items():
                other = f"{theirs[name] / exact:.3f}" if theirs else "-"
                cells.append(f"{ours[name] / exact:.3f} / {other}")
            print(f"| {kind} {formulation} | {' | '.join(cells)} |")


def plates() -> None:
    """One row per element: ours and the peer's for each of the three problems."""
    print("\n| element | Cook, 23.96 | LE1, 92.7 MPa | LE10, -5.38 MPa |")
    print("|---|---|---|---|")
    for kind, formulation in ELEMENTS:
        n, flat, thick = PLATES[kind]
        row = []
        for problem, mesh in (
            (cook_membrane(kind, n), f"{n}x{n}x1"),
            (elliptic_plate(kind, flat, thick=False), "x".join(map(str, flat))),
            (elliptic_plate(kind, thick, thick=True), "x".join(map(str, thick))),
        ):
            (ours,) = problem.solved(formulation).values()
            theirs = peer(problem, kind, formulation)
            other = f"{next(iter(theirs.values())):.2f}" if theirs else "-"
            row.append(f"{ours:.2f} / {other} ({mesh})")
        print(f"| {kind} {formulation} | {' | '.join(row)} |")


def plasticity() -> None:
    """Greatest errors of bodies that flow, by one coordinate each."""
    print("\n| element | bore | hoop stress left | axial stress left | widened | plate | blade |")
    print("|---|---|---|---|---|---|---|")
    for ring, layer in zip(RINGS, LAYERS, strict=True):
        errors = [*tube_under_pressure(ring).values(), abs(widened_tube(ring, 3))]
        errors += [float(np.abs(bent(layer, plate)).max()) for plate in (True, False)]
        cells = " | ".join(f"{error:.3%}" for error in errors)
        print(f"| {ring.kind} {ring.formulation} ({ring.cells}, {layer.cells}) | {cells} |")


def blocks() -> None:
    """Force of the bonded block on two meshes, and how far off that is."""
    print("\n| element | cells | force | off by | cells | force | off by |")
    print("|---|---|---|---|---|---|---|")
    for kind, formulation, counts in BLOCKS:
        row = []
        for cells in counts:
            force = plate_force(kind, formulation, cells)
            row.append(f"{cells} | {force:.6f} | {force / FORCE - 1.0:.3%}")
        print(f"| {kind} {formulation} | {' | '.join(row)} |")


if __name__ == "__main__":
    beams()
    plates()
    plasticity()
    blocks()
