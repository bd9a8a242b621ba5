"""CalculiX: the whole run, from its input deck to the displacements; ``ccx`` on the PATH."""

import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from common import Clock, main

ELEMENT = {
    ("hex8", "incompatible"): "C3D8I", ("hex8", "full"): "C3D8", ("tet10", "full"): "C3D10",
    ("hex20", "full"): "C3D20", ("tet4", "full"): "C3D4",
}  # fmt: skip


def run(problem, options):
    meta = problem.meta
    element = ELEMENT.get((meta["kind"], meta["rule"]))
    if element is None:
        return []
    solver = options.get("solver", "SPOOLES")
    with tempfile.TemporaryDirectory() as folder:
        deck = Path(folder) / "case.inp"
        write_deck(problem, deck, element, solver)
        clock = Clock()
        threads = {"OMP_NUM_THREADS": "2", "CCX_NPROC_EQUATION_SOLVER": "2"}
        done = subprocess.run(["ccx", "case"], cwd=folder, capture_output=True, text=True,
                              env={**os.environ, **threads})  # fmt: skip
        seconds = clock.lap()
        table = deck.with_suffix(".dat")
        if done.returncode != 0 or not table.exists():
            raise SystemExit(f"ccx ended with {done.returncode}: {done.stdout[-400:]}")
        u = np.zeros((meta["node_count"], 3))
        for line in table.read_text().splitlines():
            parts = line.split()
            if len(parts) == 4 and parts[0].isdigit():
                u[int(parts[0]) - 1] = [float(part) for part in parts[1:]]
    # CalculiX assembles its own matrix, so only the difference to the reference means anything
    difference = problem.distance(u[problem.load("free_nodes")].ravel(), "wanted")
    run = {"tolerance": 0.0, "solve_s": seconds, "iterations": 1, "error": difference,
           "difference": difference}  # fmt: skip
    return [{"name": f"CalculiX {element} {solver}, whole run", "setup_s": 0.0, "runs": [run],
             "note": "output has 7 digits"}]  # fmt: skip


def write_deck(problem, path, element, solver):
    meta = problem.meta
    points, cells = problem.load("all_points"), problem.load("cells")
    if meta["kind"] == "hex20":
        cells = cells[:, [*range(12), *range(16, 20), *range(12, 16)]]
    nodes = np.flatnonzero(np.abs(problem.load("forces")).max(axis=1) > 0)
    forces = problem.load("forces").tolist()
    held = np.setdiff1d(np.arange(len(points)), problem.load("free_nodes"))
    with path.open("w") as file:
        file.write("*NODE,NSET=ALL\n")
        for k, p in enumerate(points.tolist(), 1):
            file.write(f"{k},{p[0]:.12e},{p[1]:.12e},{p[2]:.12e}\n")
        file.write(f"*ELEMENT,TYPE={element},ELSET=BODY\n")
        for k, row in enumerate((cells + 1).tolist(), 1):
            text = [str(k), *map(str, row)]
            file.write(",".join(text[:15]) + (",\n" if len(text) > 15 else "\n"))
            if len(text) > 15:
                file.write(",".join(text[15:]) + "\n")
        file.write(f"*MATERIAL,NAME=M\n*ELASTIC\n{meta['E']!r},{meta['nu']!r}\n")
        file.write("*SOLID SECTION,ELSET=BODY,MATERIAL=M\n*BOUNDARY\n")
        file.writelines(f"{k + 1},1,3\n" for k in held.tolist())
        file.write(f"*STEP\n*STATIC,SOLVER={solver}\n*CLOAD\n")
        for k in nodes.tolist():
            file.writelines(
                f"{k + 1},{axis + 1},{forces[k][axis]:.12e}\n"
                for axis in range(3) if forces[k][axis]
            )  # fmt: skip
        file.write("*NODE PRINT,NSET=ALL\nU\n*END STEP\n")


if __name__ == "__main__":
    main(run)
