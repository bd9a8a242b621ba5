"""Random and free vibrations of oscillators, sampled exactly."""

from __future__ import annotations

import numpy as np
import scipy

from gpusim.arrays.array_types import Float


def chain_modes(stiffness: Float) -> tuple[Float, Float]:
    """Angular frequencies (N,) and shapes (N, N), a row each, of unit masses in a row on springs,
    the first of which stands on the ground."""
    matrix = np.diag(stiffness + np.append(stiffness[1:], 0.0))
    matrix -= np.diag(stiffness[1:], 1) + np.diag(stiffness[1:], -1)
    squares, vectors = np.linalg.eigh(matrix)
    return np.sqrt(squares), vectors.T


def random_vibration(
    angular: Float, damping: Float, rate_Hz: float, samples: int, seed: int
) -> Float:
    """Stationary responses (T, N) of oscillators to independent white forces of unit density, as
    covariances of the sampled state have them (Van Loan 1978)."""
    random = np.random.default_rng(seed)
    responses = np.empty((samples, len(angular)))
    for mode, (speed, share) in enumerate(zip(angular, damping, strict=True)):
        system = np.array([[0.0, 1.0], [-(speed**2), -2 * share * speed]])
        force = np.diag([0.0, 1.0])
        doubled = np.block([[-system, force], [np.zeros((2, 2)), system.T]])
        exponential = scipy.linalg.expm(doubled / rate_Hz)
        step = exponential[2:, 2:].T
        kick = np.linalg.cholesky(step @ exponential[:2, 2:])
        still = np.linalg.cholesky(scipy.linalg.solve_continuous_lyapunov(system, -force))
        noise = random.normal(size=(samples, 2)) @ kick.T
        noise[0] = still @ random.normal(size=2)
        values, vectors = np.linalg.eig(step)
        apart = noise @ np.linalg.inv(vectors).T
        states = [
            scipy.signal.lfilter([1.0], [1.0, -value], apart[:, k])
            for k, value in enumerate(values)
        ]
        responses[:, mode] = (vectors[0] @ np.array(states)).real
    return responses


def free_decay(angular: Float, damping: Float, times: Float, amplitude: Float) -> Float:
    """Responses (T, N) of oscillators that were let go."""
    turning = angular * np.sqrt(1 - damping**2) * times[:, None]
    return amplitude * np.exp(-damping * angular * times[:, None]) * np.cos(turning + 0.3)
