"""Print the tables of docs/verification.md: our values, the published ones, and CalculiX's.

Run from the checkout: ``python scripts/verification.py``. CalculiX (``ccx``) is optional.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.support import calculix
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


if __name__ == "__main__":
    beams()
    plates()
