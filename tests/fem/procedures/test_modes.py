"""Modes against dense eigenvalues of every element type, theory, and hostile models."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import eigh

import gpusim as gs
from gpusim.errors import InputError, NotConverged
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.model.mass import mass_matrix
from gpusim.fem.model.elimination import eliminate
from gpusim.fem.procedures import modes as procedure
from tests.support.element_meshes import linear_mesh, mesh_of
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
    error = np.abs(found.frequencies[still:] / frequencies[still:count] - 1.0)
    assert (error <= 1e-8).all()
    # never less than stated, but for what rounding does to the dense ones
    assert (error <= found.error_estimate[still:] + 1e-11).all()
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


EVERY = [(kind, name) for kind, one in ELEMENTS.items() for name in one.formulations]


@pytest.mark.parametrize(("kind", "formulation"), EVERY)
def test_every_element_against_dense_eigenvalues(kind: str, formulation: str) -> None:
    model = held(mesh_of(kind, (2, 2, 3), 0.05))
    found = gs.modes(model, 6, formulation={kind: formulation})
    agree(found, model, formulation={kind: formulation})
