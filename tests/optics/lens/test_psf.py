"""Point spread: transfer functions measured from slanted edges, and sampled kernels."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.lens import tiles
from gpusim.optics.lens.convolution import convolve_twin
from gpusim.optics.lens.psf import Psf, sample
from tests.support.optics_edges import camera, half_plane, pixel_transfer, transfer

FREQUENCY = np.linspace(0.02, 0.5, 25)


@pytest.mark.parametrize(
    "psf",
    [None, gs.psf.Gaussian(0.7), gs.psf.Gaussian(0.4), gs.psf.Disc(2.2),
     gs.psf.Airy(0.55, 8.0, 3.45)],
    ids=["pixel", "gaussian 0.7", "gaussian 0.4", "disc 2.2", "airy"],
)  # fmt: skip
def test_slanted_edge_transfer(device: Device, psf: Psf | None) -> None:
    image = gs.photograph([half_plane()], camera(), lens=gs.Lens(psf=psf), device=device).radiance
    want = pixel_transfer(FREQUENCY)
    if psf is not None:
        want = want * np.abs(psf.transfer(FREQUENCY, 0 * FREQUENCY))
    # the tail of an Airy pattern reaches beyond the edge's profile: lowest frequencies left out
    used = FREQUENCY > 0.08 if isinstance(psf, gs.psf.Airy) else FREQUENCY > 0.0
    error = np.abs(transfer(image, FREQUENCY) - want)[used]
    assert error.max() <= 0.02, f"{error.max():.4f}"
    assert image.max() == pytest.approx(0.8, abs=2e-3) and image.min() == pytest.approx(0, abs=2e-3)


def test_fill_factor_narrows_the_aperture(device: Device) -> None:
    lens = gs.Lens(fill_factor=0.49)
    image = gs.photograph([half_plane()], camera(), lens=lens, device=device).radiance
    error = np.abs(transfer(image, FREQUENCY) - pixel_transfer(0.7 * FREQUENCY))
    assert error.max() <= 0.02
    assert np.abs(transfer(image, FREQUENCY) - pixel_transfer(FREQUENCY)).max() > 0.1


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
@pytest.mark.parametrize("hidden", [False, True])
def test_a_smaller_aperture_is_as_exact_as_a_whole_pixel(hidden: bool, backend: str) -> None:
    """A half plane at 0.3 rad under half of each pixel's area: a square's share in closed form."""
    turn, side = 0.3, np.sqrt(0.5)
    c, s = np.cos(turn), np.sin(turn)
    along, across = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
    corners = np.array([-3 * along, 3 * along, 3 * along + 3 * across, 3 * across - 3 * along])
    quad, ahead = np.array([[0, 1, 2, 3]]), np.array([0.0, 0.0, 1.0])
    surfaces = [gs.Surface(corners + ahead, quad, gs.paint.Plain(1.0))]
    if hidden:  # two bodies are drawn another way
        wall = 9.0 * np.array([[-1.0, -1, 0.5], [-1, 1, 0.5], [1, 1, 0.5], [1, -1, 0.5]])
        surfaces.append(gs.Surface(wall, quad, gs.paint.Plain(0.0)))
    view = gs.Camera(57, 33, np.array([[100.0, 0, 29.3], [0, 100.0, 16.7], [0, 0, 1]]))
    frame = gs.photograph(surfaces, view, lens=gs.Lens(fill_factor=0.5), backend=backend)
    y, x = np.mgrid[:33, :57]
    depth = -s * (x - 29.3) + c * (y - 16.7)
    # of a uniform square the sum of two uniform numbers, up to a and b, lies below the depth
    a, b = 0.5 * side * min(c, s), 0.5 * side * max(c, s)
    tail = np.maximum(a + b - np.abs(depth), 0.0) ** 2 / (8.0 * a * b)
    below = np.where(np.abs(depth) < b - a, 0.5 - 0.5 * np.abs(depth) / b, tail)
    want = np.where(depth > 0.0, 1.0 - below, below)
    # slivers below 5e-4 of an aperture are seams between neighbours
    np.testing.assert_allclose(frame.radiance, want, atol=5e-4)
    assert np.abs(frame.radiance - want).mean() <= 1e-5
    assert frame.facts == {"fill factor": "0.5: a square of 0.7071 px, in closed form"}


@pytest.mark.parametrize(("backend", "lit"), [("gpu", False), ("numpy", True)])
def test_patterns_and_light_under_a_smaller_aperture(backend: str, lit: bool) -> None:
    """Against the mean of those of 4 x 4 pixels in each that lie within."""
    plate = np.array([[-1.0, -0.9, 2.2], [1.1, -0.8, 1.9], [1.0, 0.6, 2.6], [-1.1, 0.5, 2.9]])
    front = np.array([[-0.3, -0.2, 1.5], [0.1, -0.25, 1.5], [0.15, 0.2, 1.5], [-0.2, 0.3, 1.5]])
    board = gs.paint.Checker(0.11, origin=(0.03, 0.02), dark=0.1, light=0.8)
    quad = np.array([[0, 3, 2, 1]])
    surfaces = [gs.Surface(plate, quad, board), gs.Surface(front, quad, gs.paint.Plain(0.9))]
    lights = [gs.PointLight(position=(-1.0, -1.5, 0.2), power=60.0)] if lit else None
    K, distortion = (
        np.array([[55.0, 0, 29.2], [0, 55.0, 16.1], [0, 0, 1]]),
        [-0.2, 0.05, 1e-3, -2e-3],
    )
    fine = K * [[4.0], [4.0], [1.0]]
    fine[:2, 2] += 1.5
    view, finer = gs.Camera(57, 33, K, distortion), gs.Camera(228, 132, fine, distortion)
    cells = gs.render(surfaces, finer, lights, backend=backend).radiance.astype(float)
    want = cells.reshape(33, 4, 57, 4)[:, 1:3, :, 1:3].mean(axis=(1, 3))
    lens = gs.Lens(fill_factor=0.25)
    got = gs.photograph(surfaces, view, lights, lens=lens, backend=backend).radiance
    whole = cells.reshape(33, 4, 57, 4).mean(axis=(1, 3))
    assert np.abs(got - whole).max() > 0.1 * want.max()
    off = np.abs(got - want) / want.max()
    # light is taken at one place of an edge pixel, and shadows by 16 x 32 samples
    assert np.sqrt(np.mean(off**2)) <= 5e-4 and off.max() <= 5e-3


def test_a_measured_kernel_is_what_it_was_sampled_from(device: Device) -> None:
    k = (np.arange(33) - 16) / 4.0
    kernel = np.exp(-0.5 * (k[None, :] / 0.9) ** 2 - 0.5 * (k[:, None] / 0.6) ** 2)  # not round
    measured = gs.psf.MeasuredPsf(kernel, samples_per_px=4.0)
    image = gs.photograph([half_plane()], camera(), lens=gs.Lens(psf=measured), device=device)
    c, s = np.cos(np.arctan(0.1234)), np.sin(np.arctan(0.1234))
    sigma = np.hypot(0.9 * c, 0.6 * s)
    want = pixel_transfer(FREQUENCY) * gs.psf.Gaussian(sigma).transfer(FREQUENCY, 0 * FREQUENCY)
    assert np.abs(transfer(image.radiance, FREQUENCY) - want).max() <= 0.02


def test_edge_profile_of_a_gaussian_is_the_closed_form(device: Device) -> None:
    """An upright edge at 16 places in the pixel: erf integrated over the pixel."""
    sigma = 0.7

    def integral(x: np.ndarray) -> np.ndarray:
        z = x / sigma
        return x * 0.5 * (1 + erf(z / 2**0.5)) + sigma * np.exp(-0.5 * z**2) / (2 * np.pi) ** 0.5

    errors = []
    for shift in np.arange(16) / 16.0 + 0.013:
        points = np.array([[0.0, -1, 2], [1, -1, 2], [1, 1, 2], [0, 1, 2]])
        points[:, 0] += (20.0 + shift - 20.0) / 450.0
        surface = gs.Surface(points, np.array([[0, 3, 2, 1]]), paint=gs.paint.Plain(1.0))
        view = gs.Camera(41, 9, np.array([[900.0, 0, 20.0], [0, 900, 4.2], [0, 0, 1]]))
        image = gs.photograph(
            [surface], view, lens=gs.Lens(psf=gs.psf.Gaussian(sigma)), device=device
        ).radiance
        x = np.arange(41) - 20.0 - shift
        errors.append(image[4] - (integral(x + 0.5) - integral(x - 0.5)))
    near = np.array(errors)[:, 18:24]
    kernel = sample(gs.psf.Gaussian(sigma), tolerance=0.25 * np.sqrt(2) / 255)
    assert np.sqrt(np.mean(near**2)) <= kernel.edge_error * 1.1 <= 0.0016
    # as an image: a quarter of a grey level if half of its pixels lie at such an edge
    assert np.sqrt(np.mean(near**2) / 2) <= 0.25 / 255


def test_cells_are_chosen_by_the_kernel() -> None:
    widths = [0.3, 0.5, 0.7, 1.5]
    cells = [sample(gs.psf.Gaussian(w), tolerance=1e-3).n for w in widths]
    assert cells == sorted(cells, reverse=True) and cells[0] > cells[-1]
    # the error of a kernel in steps falls with their square
    two, four = (sample(gs.psf.Gaussian(0.7), n=n).edge_error for n in (2, 4))
    assert 3.5 < two / four < 4.7


@pytest.mark.parametrize(
    "psf", [gs.psf.Gaussian(0.8), gs.psf.Disc(1.7), gs.psf.Airy(0.6, 5.6, 3.45)], ids=str
)
def test_weights_have_the_closed_form_transfer(psf: Psf) -> None:
    cells = psf.cells(4)
    assert cells.sum() == pytest.approx(1.0, abs=1e-12)
    k = (np.arange(len(cells)) - len(cells) // 2) / 4.0
    for fx, fy in ((0.11, 0.0), (0.3, 0.2), (-0.1, 0.45)):
        wave = np.exp(2j * np.pi * (fx * k[None, :] + fy * k[:, None]))
        assert (cells * wave).sum() == pytest.approx(
            float(psf.transfer(np.array(fx), np.array(fy))), abs=0.01
        )


def test_tiles_and_bands_join_without_seams(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    lens = gs.Lens(psf=gs.psf.Gaussian(0.9))
    whole = gs.photograph([half_plane()], camera(), lens=lens, device=device).radiance
    monkeypatch.setattr(tiles, "MAX_SIDE", 170)
    monkeypatch.setattr(tiles, "TILE_CELLS", 170 * 90)
    frame = gs.photograph([half_plane()], camera(), lens=lens, device=device)
    assert len(frame.bands) > 3
    np.testing.assert_allclose(frame.radiance, whole, atol=2e-6)


def test_device_equals_twin(device: Device) -> None:
    lens = gs.Lens(psf=gs.psf.Airy(0.55, 4.0, 3.45), vignetting=gs.Vignetting(polynomial=(-0.2,)))
    images = [
        gs.photograph([half_plane()], camera(), lens=lens, device=device, backend=backend).radiance
        for backend in ("gpu", "numpy")
    ]
    np.testing.assert_allclose(images[0], images[1], atol=3e-5)


def test_convolution_is_the_plain_double_sum() -> None:
    kernel = sample(gs.psf.Disc(1.1), fill_factor=0.81, n=2)
    cells = np.random.default_rng(1).uniform(
        size=(2 * 5 + 2 * kernel.halo, 2 * 4 + 2 * kernel.halo)
    )
    weights = sum(np.outer(across, along) for along, across in kernel.terms)
    want = [
        [(cells[2 * r : 2 * r + kernel.taps, 2 * c : 2 * c + kernel.taps] * weights).sum()
         for c in range(4)]
        for r in range(5)
    ]  # fmt: skip
    np.testing.assert_allclose(convolve_twin(kernel, cells), want, atol=1e-12)


def test_what_cannot_be_is_refused() -> None:
    for make, part in (
        (lambda: gs.psf.Gaussian(0.0), "Gaussian sigma; got 0.0"),
        (lambda: gs.psf.Airy(0.5, -1.0, 3.0), "Airy f_number; got -1.0"),
        (lambda: gs.psf.MeasuredPsf(np.ones((4, 5))), r"shape \(4, 5\)"),
        (lambda: gs.Lens(fill_factor=1.2), "fill_factor; got 1.2"),
        (lambda: gs.Lens(psf=3.0), "psf; got 3.0"),
        (lambda: sample(gs.psf.Disc(300.0)), "radius; got 300"),
    ):
        with pytest.raises(InputError, match=part):
            make()


@pytest.mark.parametrize("samples", [None, 3, 8, 16])
def test_places_of_what_is_narrower_than_a_pixel_are_as_exact_as_facts_say(
    samples: int | None,
) -> None:
    """A square of 0.6 px in the middle of 11 x 9 px, at 40 places along a pixel."""
    camera = gs.Camera(11, 9, np.array([[100.0, 0.0, 5.0], [0.0, 100.0, 4.0], [0.0, 0.0, 1.0]]))
    lens = gs.Lens(psf=gs.psf.Gaussian(0.7), samples_per_px=samples)
    side, off = 0.6, []
    for place in np.linspace(0.0, 1.0, 40, endpoint=False):
        x, y = 5.0 + place + side * np.array([-0.5, 0.5]), 4.1 + side * np.array([-0.5, 0.5])
        corners = [[x[i] - 5.0, y[j] - 4.0, 100.0] for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))]
        square = gs.Surface(np.array(corners), [[0, 1, 2, 3]], gs.paint.Plain(0.8))
        frame = gs.photograph([square], camera, lens=lens, backend="numpy")
        radiance = frame.radiance.astype(float)
        off.append(radiance.sum(axis=0) @ np.arange(11.0) / radiance.sum() - 5.0 - place)
    words = frame.facts["point spread"]
    told = float(words.split("in place to ")[1].split(" /")[0]) / side
    # a bound: how much of it is reached depends on how the side fits into cells
    assert 0.4 * told < np.abs(off).max() < 1.05 * told
    assert told == pytest.approx(1.0 / (8.0 * side * int(words.split()[0]) ** 2), rel=0.05)
