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
    frequencies[:still] = 0.0
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


def comb(teeth: int) -> gs.Mesh:
    """Equal teeth on a common base: a cluster of as many modes."""
    mesh = gs.mesh.box((9.0 * teeth, 30.0, 4.0), (3 * teeth, 10, 1))
    middle = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    keep = (middle[:, 1] < 6.0) | (middle[:, 0] % 9.0 < 3.0)
    used, cells = np.unique(mesh.cells["hex8"][keep], return_inverse=True)
    return gs.Mesh(mesh.points[used], {"hex8": cells.reshape(-1, 8)})


def together(*meshes: gs.Mesh) -> gs.Mesh:
    """Several bodies of hexahedra."""
    first = np.cumsum([0, *(one.node_count for one in meshes)])
    cells = [one.cells["hex8"] + at for one, at in zip(meshes, first, strict=False)]
    return gs.Mesh(np.concatenate([one.points for one in meshes]), {"hex8": np.concatenate(cells)})


def tied() -> gs.Model:
    lower = gs.mesh.box(size=(2, 2, 1), divisions=(2, 2, 1))
    both = together(lower, gs.mesh.box(size=(2, 2, 1), divisions=(3, 3, 2), origin=(0, 0, 1)))
    level = {"z_min": 1.0, "z_max": 1.0}
    joint = [gs.mesh.select_faces(both, bounds=level, normal=n) for n in ("+z", "-z")]
    fixed = np.repeat(both.points[:, 2:] == 0.0, 3, axis=1)
    return gs.Model(both, STEEL, fixed, constraints=gs.fem.tie(both, *joint))


def on_base(mesh: gs.Mesh) -> gs.Model:
    return gs.Model(mesh, STEEL, np.repeat(mesh.points[:, 1:2] == 0.0, 3, axis=1))


CUBE = gs.mesh.box((1.0, 1.0, 1.0), (5, 5, 5))
MODELS: dict[str, tuple[Callable[[], gs.Model], int]] = {
    "rod whose modes are pairs": (lambda: held(gs.mesh.box((8, 1, 1), (20, 3, 3))), 9),
    "cube whose modes are triples": (lambda: gs.Model(CUBE, STEEL), 15),
    "comb, a cluster of eight": (lambda: on_base(comb(8)), 10),
    "free plate": (lambda: gs.Model(gs.mesh.box((10, 10, 0.3), (10, 10, 1)), STEEL), 12),
    "tied": (tied, 7),
    "all modes that it has": (lambda: held(gs.mesh.box((1, 1, 1), (1, 1, 1))), 12),
    "all but one": (lambda: held(gs.mesh.box((2, 1, 1), (2, 1, 1))), 23),
}


@pytest.mark.parametrize("method", ["direct", "multigrid"])
@pytest.mark.parametrize("name", MODELS)
def test_doubles_and_clusters_are_complete(name: str, method: str) -> None:
    build, count = MODELS[name]
    model = build()
    agree(gs.modes(model, count, method=method), model)


@pytest.mark.parametrize("rule", ["calculix", "lumped"])
def test_mass_rules(rule: str) -> None:
    model = held(mesh_of("tet10", (2, 2, 2)))
    found = gs.modes(model, 5, mass=rule)
    frequencies, _ = dense(model, rule=rule)
    assert np.abs(found.frequencies / frequencies[:5] - 1.0).max() <= 1e-8
