"""torch-fem's own benchmark of a stretched block: ``python torch_fem.py N``; prints JSON.

The problem is that of `benchmarks.nonlinear.stretch`, in the steps and with the tolerances that
torch-fem's authors take. Knows nothing of gpusim.
"""

import json
import sys
import time
from importlib.metadata import version

import torch
from torchfem import Solid
from torchfem.materials import Hyperelastic3D
from torchfem.mesh import cube_hexa

STRETCH, STEPS, E, NU = 10.0, 10, 1000.0, 0.3


def energy(gradient, constants):
    mu, lame = constants
    metric = gradient.transpose(-1, -2) @ gradient
    log = 0.5 * torch.logdet(metric)
    return 0.5 * mu * (torch.trace(metric) - 3.0) - mu * log + 0.5 * lame * log**2


def main(count):
    torch.set_default_dtype(torch.float64)
    wall, cpu = time.perf_counter(), time.process_time()
    thickness = 4.0 / (count - 1)
    nodes, elements = cube_hexa(5, count, count, thickness, 1.0, 1.0)
    constants = torch.tensor([E / (2.0 + 2.0 * NU), E * NU / ((1.0 + NU) * (1.0 - 2.0 * NU))])
    block = Solid(nodes, elements, Hyperelastic3D(energy, constants))
    end = nodes[:, 0] == thickness
    block.constraints[:, 0] = (nodes[:, 0] == 0.0) | end
    block.constraints[:, 1:] = nodes[:, 1:] == 0.5
    block.displacements[end, 0] = (STRETCH - 1.0) * thickness
    stretches = torch.logspace(0.0, 1.0, STEPS + 1)
    forces = block.solve(increments=(stretches - 1.0) / (STRETCH - 1.0))[1]
    print(json.dumps({
        "name": f"torch-fem {version('torch-fem')}", "unknowns": 3 * len(nodes),
        "cpu": time.process_time() - cpu, "wall": time.perf_counter() - wall,
        "force": float(forces[end, 0].sum()),
    }))  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]))
