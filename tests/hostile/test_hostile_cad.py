"""Damaged surfaces of triangles for Gmsh, in its own process (STEP and BREP: see meshes)."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.mesh import mesh_cad
from tests.hostile.amount import SEED, share
from tests.hostile.mutations import mutations
from tests.hostile.tiny_runs import LIMIT
from tests.support.gmsh_meshes import Gmsh

pytestmark = pytest.mark.hostile


@pytest.mark.parametrize("binary", [0, 1])
def test_damaged_stl(binary: int, tmp_path: Path) -> None:
    valid, path = tmp_path / "valid.stl", tmp_path / "damaged.stl"
    with Gmsh() as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 4, 5, 9)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.option.setNumber("Mesh.MeshSizeMin", 4.0)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(valid))
    assert mesh_cad(valid, size=5.0).cell_count > 5
    for damage, data in mutations(valid.read_bytes(), np.random.default_rng(SEED), share(20)):
        path.write_bytes(data)
        began = time.monotonic()
        try:
            mesh = mesh_cad(path, size=5.0, time_limit=8)
            assert np.isfinite(mesh.points).all()
        except InputError as error:
            assert str(path) in str(error) and len(str(error)) < 1000, f"{damage}: {error}"
        assert time.monotonic() - began < LIMIT, damage
