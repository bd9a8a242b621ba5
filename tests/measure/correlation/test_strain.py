"""Strains of known displacement fields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import logm

from gpusim.errors import InputError
from gpusim.measure import StrainStatus, dic, strain
from gpusim.measure.correlation.strain import strain_tensor
from tests.support.measure_images import speckles

GRADIENT = np.array([[0.11, -0.23], [0.05, -0.08]])


@dataclass(frozen=True)
class Field:
    """Displacements that weren't measured from images."""

    points: np.ndarray
    displacement: np.ndarray
    subset: int = 21


def grid(width: int = 13, height: int = 9, step: float = 7.0) -> np.ndarray:
    x, y = np.meshgrid(np.arange(width) * step + 30, np.arange(height) * step + 50)
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.mark.parametrize("kind", ["small", "green-lagrange", "hencky", "almansi"])
@pytest.mark.parametrize("order", [1, 2])
def test_a_homogeneous_field_gives_its_strain_everywhere(kind: str, order: int) -> None:
    points = grid()
    F = np.eye(2) + GRADIENT
    inverse = np.linalg.inv(F)
    want = {
        "small": 0.5 * (GRADIENT + GRADIENT.T),
        "green-lagrange": 0.5 * (F.T @ F - np.eye(2)),
        "hencky": 0.5 * np.real(logm(F.T @ F)),
        "almansi": 0.5 * (np.eye(2) - inverse.T @ inverse),
    }[kind]
    field = Field(points, points @ GRADIENT.T + [300.0, -20.0])
    result = strain(field, window=5, kind=kind, order=order)
    assert result.ok.all()
    assert np.abs(result.tensor - want).max() <= 1e-12
    assert np.abs(result.gradient - GRADIENT).max() <= 1e-12
    assert result.residual.max() <= 1e-11
    assert result.gauge_px == 4 * 7 + 21
    values = np.linalg.eigvalsh(want)
    assert np.abs(result.principal - values[::-1]).max() <= 1e-12
    along = np.array([np.cos(result.angle[0]), np.sin(result.angle[0])])
    assert np.abs(want @ along - values[1] * along).max() <= 1e-12


@pytest.mark.parametrize("kind", ["green-lagrange", "hencky", "almansi"])
def test_a_rotation_is_no_strain(kind: str) -> None:
    turn = np.deg2rad(72.0)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    assert np.abs(strain_tensor((R - np.eye(2))[None], kind)).max() <= 1e-15


def test_tiny_strains_keep_their_digits() -> None:
    tiny = 1e-9 * GRADIENT[None]
    small = strain_tensor(tiny, "small")
    for kind in ("green-lagrange", "hencky", "almansi"):
        assert np.abs(strain_tensor(tiny, kind) / small - 1).max() <= 1e-7


def test_noise_averages_as_least_squares_says() -> None:
    rng = np.random.default_rng(4)
    points, noise = grid(60, 50, 10.0), 0.01
    field = Field(points, rng.normal(scale=noise, size=(len(points), 2)))
    result = strain(field, window=7, kind="small")
    inner = np.all((points > points.min(axis=0) + 30) & (points < points.max(axis=0) - 30), axis=1)
    # variance of a slope: noise^2 / sum of x^2 over the window
    expected = noise / np.sqrt(7 * 2 * 10.0**2 * (1 + 4 + 9))
    assert 0.9 <= result.gradient[inner].std() / expected <= 1.1
    # six of 98 numbers are used up by the fit
    assert (
        0.98 <= np.sqrt((result.residual[inner] ** 2).mean()) / (noise * np.sqrt(92 / 98)) <= 1.02
    )


def test_quadratic_fit_follows_a_bent_field_that_planes_average() -> None:
    points = grid(41, 9, 5.0)
    x = points[:, 0] - 130.0
    field = Field(points, np.column_stack([1e-6 * x**3, np.zeros_like(x)]))
    middle = np.flatnonzero((np.abs(x) < 3) & (points[:, 1] == 70.0))
    planes = strain(field, window=9, kind="small").gradient[middle, 0, 0]
    curved = strain(field, window=9, kind="small", order=2).gradient[middle, 0, 0]
    truth = 3e-6 * x[middle] ** 2
    # both see the mean over the window of a parabola; the residual says so
    assert np.abs(planes - curved).max() <= 1e-12
    border = np.flatnonzero(points[:, 0] == points[:, 0].min())
    slope = 3e-6 * x[border] ** 2
    one = strain(field, window=9, kind="small").gradient[border, 0, 0]
    two = strain(field, window=9, kind="small", order=2).gradient[border, 0, 0]
    assert (np.abs(two - slope) <= 0.2 * np.abs(one - slope)).all()
    assert truth.shape == planes.shape


def test_what_was_not_measured_has_no_strain_and_harms_no_neighbour() -> None:
    points = grid()
    displacement = points @ GRADIENT.T
    missing = (points[:, 0] < 50) | ((points == points[60]).all(axis=1))
    displacement[missing] = np.nan
    result = strain(Field(points, displacement), window=3)
    assert (result.status[missing] == StrainStatus.NOT_MEASURED).all()
    assert np.isnan(result.tensor[missing]).all() and np.isnan(result.residual[missing]).all()
    assert result.ok[~missing].all()
    assert np.abs(result.gradient[~missing] - GRADIENT).max() <= 1e-12


def test_lonely_points_and_lines_have_none() -> None:
    points = np.array([[10.0, 10], [20, 10], [30, 10], [40, 10], [50, 10], [400, 10], [410, 300]])
    result = strain(Field(points, 0.01 * points), window=5)
    assert (result.status == StrainStatus.FEW_POINTS).all()
    assert np.isnan(result.tensor).all()


def test_strain_of_measured_images() -> None:
    gradient = ((0.012, -0.02), (0.015, 0.006))
    size = {"width": 97, "height": 83}
    result = dic(
        speckles(**size), speckles(**size, gradient=gradient), subset=25, step=6, roi=(5, 5, 90, 78)
    )
    found = strain(result, window=5, kind="green-lagrange")
    F = np.eye(2) + np.array(gradient)
    assert found.ok.all()
    assert np.abs(found.tensor - 0.5 * (F.T @ F - np.eye(2))).max() <= 1e-4


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"window": 4}, "window"),
        ({"window": 1}, "window"),
        ({"window": 5.0}, "window"),
        ({"kind": "engineering"}, "kind"),
        ({"order": 3}, "order"),
        ({"spacing": float("nan")}, "spacing"),
        ({"spacing": 0.0}, "spacing"),
    ],
)
def test_wrong_arguments_name_themselves(change: dict[str, object], words: str) -> None:
    points = grid()
    with pytest.raises(InputError, match=words):
        strain(Field(points, 0 * points), **change)
