"""Modes of small models by dense matrices, and what tests ask of others beside them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

import gpusim as gs
from gpusim.fem.model.elimination import eliminate
from gpusim.fem.model.mass import mass_matrix
from tests.support.fem_reference import stiffness

Float = npt.NDArray[np.float64]
STEEL = gs.Isotropic(210e9, 0.3, density=7850.0)


def held(mesh: gs.Mesh, material: gs.Isotropic = STEEL, **more: object) -> gs.Model:
    fixed = np.repeat(mesh.points[:, :1] < mesh.points[:, 0].min() + 1e-9, 3, axis=1)
    return gs.Model(mesh, material, fixed, **more)  # type: ignore[arg-type]


def dense(model: gs.Model, formulation: object = None, rule: str = "exact") -> tuple[Float, Float]:
    """All frequencies, and mass-normalised shapes as columns (3N,n)."""
    assert model.fixed is not None
    k = stiffness(model, formulation).toarray()  # type: ignore[arg-type]
    m = mass_matrix(model, rule, formulation).toarray()  # type: ignore[arg-type]
    elimination = eliminate(model)
    unknown = ~model.fixed
    unknown[model.mesh.dangling_nodes] = False
    columns = np.eye(k.shape[0])
    if elimination is not None:
        columns, unknown = elimination.matrix.toarray(), elimination.unknowns(unknown)
    columns = columns[:, unknown.ravel()]
    values, vectors = eigh(columns.T @ k @ columns, columns.T @ m @ columns)
    return np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi), columns @ vectors


def agree(found: gs.Modes, model: gs.Model, **options: object) -> None:
    """Frequencies to 1e-8 and shapes to a MAC of 1 - 1e-8, those of clusters as their spans."""
    assert found.converged, found.message
    still, count = len(found.rigid), len(found.frequencies)
    frequencies, shapes = dense(model, **options)  # type: ignore[arg-type]
    assert (found.frequencies[:still] == 0.0).all()
    assert (frequencies[:still] <= 1e-4 * frequencies[still]).all()
    frequencies[:still] = 0.0
    error = np.abs(found.frequencies[still:] / frequencies[still:count] - 1.0)
    assert (error <= 1e-8).all()
    # never less than stated, but for what rounding does to the dense ones
    rounding = 1e-11 + 2e-16 * (frequencies[-1] / frequencies[still:count]) ** 2
    assert (error <= found.error_estimate[still:] + rounding).all()
    weights = mass_matrix(model, str(options.get("rule", "exact")), None)
    flat = found.shapes.reshape(count, -1)
    gram = flat @ weights @ flat.T
    assert np.abs(gram - np.eye(count)).max() <= 1e-9
    cuts = np.flatnonzero(np.diff(frequencies[:count]) > 5e-3 * frequencies[1:count]) + 1
    for cluster in np.split(np.arange(count), cuts):
        after = frequencies[cluster[-1] + 1] if count < len(frequencies) else np.inf
        if after <= 1.005 * frequencies[cluster[-1]]:
            continue  # its other half wasn't asked for
        shares = shapes[:, cluster].T @ weights @ flat[cluster].T
        assert np.linalg.svd(shares)[1].min() ** 2 >= 1.0 - 1e-8


def together(*meshes: gs.Mesh) -> gs.Mesh:
    """Several bodies of hexahedra."""
    first = np.cumsum([0, *(one.node_count for one in meshes)])
    cells = [one.cells["hex8"] + at for one, at in zip(meshes, first, strict=False)]
    return gs.Mesh(np.concatenate([one.points for one in meshes]), {"hex8": np.concatenate(cells)})
