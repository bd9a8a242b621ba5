"""The border fit of a marker: its derivatives, and what it can reach on sharp images."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import gaussian_filter

from gpusim.measure import fit_crossings, locate_markers
from gpusim.measure.targets.border_junction import profile_and_slopes, residual_and_slopes
from gpusim.measure.targets.levenberg_marquardt import fit_many
from tests.support.measure_images import Marker, board


@pytest.mark.parametrize("sigma", [0.4, 0.05])
@pytest.mark.parametrize("angles", [(0.12, 0.15), (-0.7, -0.69)])
def test_derivatives_are_those_of_the_residual(sigma: float, angles: tuple[float, float]) -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-9.0, 10.0), np.arange(-8.0, 7.0)))
    grid = np.stack([x, x + 0.1]), np.stack([y, y - 0.2]), np.zeros((2, x.size))
    at = np.array([[0.31, -0.23, *angles, 0.5, 0.3, 0.002, -0.001, sigma**2]]).repeat(2, axis=0)
    step = 1e-7
    differences = np.stack(
        [
            (
                residual_and_slopes(at + step * e, *grid)[0]
                - residual_and_slopes(at - step * e, *grid)[0]
            )
            / (2 * step)
            for e in np.eye(9)
        ],
        axis=1,
    )
    slopes = residual_and_slopes(at, *grid)[1]
    assert np.abs(slopes[0] - slopes[1]).max() > 1e-3
    assert np.abs(slopes - differences).max() <= 1e-5


def test_profile_is_the_mean_over_the_pixel() -> None:
    """Against 400x400 points of a sharp border; 0.004 px blur changes it by less than 1e-3."""
    normal = np.array([np.cos(0.3), np.sin(0.3)])
    offset = (np.arange(400) + 0.5) / 400 - 0.5
    across = offset[:, None] * normal[0] + offset[None, :] * normal[1]
    distance = np.array([-1.2, -0.61, -0.3, 0.0, 0.17, 0.55, 3.0])
    want = [np.sign(d + across).mean() for d in distance]
    (profile,), *_ = profile_and_slopes(distance[None], normal[None], 0.004**2)
    assert np.abs(profile - want).max() <= 1e-3


@pytest.mark.parametrize("size", [13.0, 19.4, 28.0])
def test_sharp_markers_are_located_to_a_ten_thousandth(size: float) -> None:
    rng = np.random.default_rng(1)
    for degrees in (0.0, 0.5, 4.0, -20.0, 44.0):
        x, y = 40 + rng.uniform(size=2)
        image = board(97, 83, [Marker(x, y, size, size, np.radians(degrees))])
        found = locate_markers(image, [[x + 1.5, y - 2.0]], (size - 2, size + 2), 6.0)
        # measured: 3e-5
        assert np.abs(found.points - [[x, y]]).max() <= 2e-4
        assert found.residual.max() <= 1e-3


def test_sharp_markers_along_the_pixels_are_all_fitted() -> None:
    """Where borders run along pixels the grey values hardly tell the blur: fits still end."""
    rng = np.random.default_rng(4)
    places = np.array([[40 * i + 30.0, 40 * j + 30.0] for j in range(5) for i in range(8)])
    places += rng.uniform(-0.5, 0.5, places.shape)
    angles = rng.uniform(-0.01, 0.01, len(places))
    markers = [Marker(x, y, 27, 27, a) for (x, y), a in zip(places, angles, strict=True)]
    image = np.rint(board(350, 230, markers)).astype(np.uint8)
    along = 13.5 * np.column_stack([np.cos(angles), np.sin(angles)])
    across = along[:, ::-1] * [-1, 1]
    start = places + rng.uniform(-0.1, 0.1, places.shape)
    found = fit_crossings(image, start, along, across, share=0.85)
    assert found.ok.all()
    # an edge within one row of pixels is as good as their grey values: half a level of the step
    assert np.abs(found.points - places).max() <= 0.5 / (2 * np.abs(found.contrast).min()) + 2e-4


def test_sharp_markers_turned_by_a_hair_with_a_known_blur() -> None:
    """A border that leaves its row of pixels within the marker: the blur is no use against it."""
    rng = np.random.default_rng(4)
    places = np.array([[44 * i + 30.0, 44 * j + 30.0] for j in range(5) for i in range(8)])
    places += rng.uniform(-0.5, 0.5, places.shape)
    angles = rng.uniform(0.0, 7e-4, len(places))
    markers = [Marker(x, y, 26.4, 26.4, a) for (x, y), a in zip(places, angles, strict=True)]
    image = np.rint(board(390, 250, markers)).astype(np.uint8)
    along = 13.2 * np.column_stack([np.cos(angles), np.sin(angles)])
    start = places + rng.uniform(-0.1, 0.1, places.shape)
    found = fit_crossings(
        image, start, along, along[:, ::-1] * [-1, 1], share=0.6, margin=(1.2, 2.5),
        blur=np.full(len(places), 0.02),
    )  # fmt: skip
    assert found.ok.all()
    # measured: 0.0006 and 0.002; polished from the kink instead 0.007 and 0.03
    assert np.sqrt(np.mean((found.points - places) ** 2)) <= 1e-3
    assert np.abs(found.points - places).max() <= 4e-3


def test_the_last_step_needs_no_look_at_what_it_changes() -> None:
    """A straight line by least squares: the model is asked twice, the answer is NumPy's."""
    x = np.linspace(-1.0, 2.0, 30)
    y = 0.7 + 0.3 * x + 0.01 * np.sin(7.0 * x)
    asked = []

    def model(
        p: npt.NDArray[np.float64], which: npt.NDArray[np.int64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        asked.append(which.tolist())
        slopes = np.stack([np.ones_like(x), x])[None].repeat(len(p), axis=0)
        return np.einsum("kq,kqp->kp", p, slopes) - y, slopes

    start = np.array([[0.0, 0.0], [0.71, 0.31]])
    fit = fit_many(model, start, np.ones((2, 30)), np.ones(2), tolerance=1e-2)
    assert fit.converged.all() and asked == [[0, 1], [0, 1]]
    want = np.polynomial.Polynomial.fit(x, y, 1).convert().coef
    # each step leaves a thousandth of itself, by the damping
    assert np.abs(fit.parameters - want).max() <= 1e-5


@pytest.mark.parametrize("iterations", [37, 38, 39, 40])
def test_a_fit_that_still_goes_down_has_not_settled(iterations: int) -> None:
    """exp(-p) falls for ever; the last iteration may end a row of steps or not."""

    def model(
        p: npt.NDArray[np.float64], which: npt.NDArray[np.int64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        assert len(which) == len(p)
        value = np.repeat(np.exp(-p), 20, axis=1)
        return value, -value[:, None]

    fit = fit_many(model, np.zeros((1, 1)), np.ones((1, 20)), np.ones(1), iterations=iterations)
    assert not fit.converged.any()


def test_markers_at_the_border_are_found_whatever_is_fitted_beside_them() -> None:
    """Fitted together, a marker next to the border must not take from those inside."""
    places = [(31.3, 20.4), (90.2, 17.3), (12.3, 61.6), (58.4, 57.1), (107.6, 49.7), (50.6, 92.8)]
    turns = [0.1, 0.2, 0.0, 0.3, 0.0, -0.1]
    image = board(121, 111, [Marker(*p, 24.0, 24.0, t) for p, t in zip(places, turns, strict=True)])
    found = locate_markers(image, np.array(places) + 0.7, (20.0, 28.0), 6.0)
    assert found.ok.all()
    np.testing.assert_allclose(found.points, places, atol=0.002)
    np.testing.assert_allclose(found.size, 24.0, atol=0.3)


@pytest.mark.parametrize(
    ("noise_blur", "size"), [(0.0, 30.0), (0.6, 30.0), (0.0, 14.0), (0.6, 14.0), (1.0, 20.0)]
)
def test_sigma_is_the_scatter_also_where_noise_is_correlated(
    noise_blur: float, size: float
) -> None:
    """As behind a colour filter: without the correlation, 1.6 times too small; without what small
    markers' fits take up of it, 1.3 times."""
    rng = np.random.default_rng(8)
    places = np.array([[24.0 + 43 * i, 25.0 + 43 * j] for j in range(4) for i in range(5)])
    places += rng.uniform(-0.5, 0.5, places.shape)
    turns = rng.uniform(-0.7, 0.7, len(places))
    sharp = board(220, 180, [Marker(*p, size, size, t) for p, t in zip(places, turns, strict=True)])
    arms = 0.5 * size * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    steps = arms, np.stack([-arms[:, 1], arms[:, 0]], axis=1)
    error, sigma = [], []
    for _ in range(6):
        noise = rng.normal(size=sharp.shape)
        noise = gaussian_filter(noise, noise_blur) if noise_blur else noise
        picture = gaussian_filter(sharp, 0.7) + 4.0 * noise / noise.std()
        found = fit_crossings(picture, places + 0.3, *steps, share=0.6, margin=(1.2, 2.5))
        assert found.ok.all()
        error.append(found.points - places)
        sigma.append(found.sigma)
    ratio = np.sqrt(np.mean((np.array(error) / np.array(sigma)[..., None]) ** 2))
    print(f"noise blurred by {noise_blur} px: scatter over sigma {ratio:.2f}")
    assert 0.85 <= ratio <= 1.15


def test_sharp_crosses_are_right_wherever_they_lie_on_the_pixels() -> None:
    """Where no border is near a pixel's side the blur has no slope but close to none, and a step
    by that slope leads far away: the centre was 0.03 px off, and said to be right."""
    places = ((0.619, 0.716), (0.663, 0.637), (0.623, 0.75), (0.638, 0.652))
    markers = [
        Marker(30.0 + 40.0 * k + x, 30.0 + y, 10.83, 10.79, 0.0) for k, (x, y) in enumerate(places)
    ]
    at = np.array([[one.x, one.y] for one in markers])
    arms = np.tile([5.4, 0.0], (len(at), 1)), np.tile([0.0, 5.4], (len(at), 1))
    fit = fit_crossings(board(190, 60, markers), at, *arms, share=0.6, margin=(1.2, 2.5))
    assert fit.ok.all() and np.abs(fit.points - at).max() <= 1e-6
