"""A small bar that vibrates, and its modes by dense algebra."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

import gpusim as gs
from tests.support.fem_reference import stiffness

Float = npt.NDArray[np.float64]
SOFT = gs.Isotropic(100.0, 0.3, density=1.0)


def vibrating_bar(divisions: tuple[int, int, int] = (3, 1, 1), fixed: bool = True) -> gs.Model:
    """3 x 0.8 x 1, held at x = 0; load cases push its end across, along y and z, and pull at it."""
    mesh = gs.mesh.box((3.0, 0.8, 1.0), divisions)
    held = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1) & fixed
    end = gs.mesh.select_faces(mesh, name="x_max")
    loads = [gs.fem.face_force(mesh, end, total) for total in ((0.0, 0.3, 0.5), (1.0, 0.0, 0.0))]
    return gs.Model(mesh, SOFT, held, np.stack(loads))


def matrices(model: gs.Model) -> tuple[Float, Float, npt.NDArray[np.int64]]:
    """K and M (n,n) of the unknowns, and their numbers among 3N."""
    assert model.fixed is not None
    free = np.flatnonzero(~model.fixed.ravel())
    whole = stiffness(model).toarray(), gs.fem.mass_matrix(model).toarray()
    stiff, mass = (matrix[np.ix_(free, free)] for matrix in whole)
    return stiff, mass, free


def dense_modes(model: gs.Model) -> tuple[Float, Float]:
    """Angular frequencies (n,), 0 for rigid-body modes, and mass-normalised shapes (n,N,3)."""
    stiff, mass, free = matrices(model)
    values, vectors = eigh(stiff, mass)
    shapes = np.zeros((len(values), model.mesh.points.size))
    shapes[:, free] = vectors.T
    rigid = values < 1e-8 * values[-1]
    return np.where(rigid, 0.0, np.sqrt(np.abs(values))), shapes.reshape(len(values), -1, 3)


def step_response(model: gs.Model, factors: npt.ArrayLike, times: Float) -> Float:
    """(T,N,3) from rest, under loads that are constant from the first of ``times`` on."""
    angular, shapes = dense_modes(model)
    push = np.tensordot(factors, model.load_cases, axes=1)
    pull = np.tensordot(shapes, push, axes=2) / angular**2
    amplitudes = pull * (1.0 - np.cos(np.outer(times - times[0], angular)))
    return np.asarray(np.tensordot(amplitudes, shapes, axes=1))


def greatest(difference: npt.ArrayLike, reference: npt.ArrayLike) -> float:
    """The greatest difference, over the greatest value."""
    worst = np.abs(np.asarray(difference)).max() / np.abs(np.asarray(reference)).max()
    assert np.isfinite(worst)
    return float(worst)
