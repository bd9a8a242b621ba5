"""Stereo correlation of surfaces that our own renderer shows to two cameras."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.measure import (
    Status,
    StereoResult,
    rig_camera,
    stereo_dic,
    stereo_shape,
    surface_strain,
)

WIDTH, HEIGHT, DISTANCE, ANGLE = 250, 190, 0.42, np.deg2rad(11.0)
CAMERAS = tuple(
    gs.Camera.from_lens(
        (36.0, 36.0 * HEIGHT / WIDTH),
        65.0,
        (WIDTH, HEIGHT),
        eye=(DISTANCE * np.sin(t), -DISTANCE * np.cos(t), 0.03),
        target=(0.0, 0.0, 0.0),
    )
    for t in (-ANGLE, ANGLE)
)
LEFT = CAMERAS[0].camera_from_world
RIG = tuple(
    rig_camera((WIDTH, HEIGHT), c.K, None, relative[:3, :3], relative[:3, 3])
    for c in CAMERAS
    for relative in (c.camera_from_world @ np.linalg.inv(LEFT),)
)
PIXEL = DISTANCE / CAMERAS[0].K[0, 0]  # length of a pixel on the object
ROI = (25, 25, 224, 164)


def motion(X: np.ndarray) -> np.ndarray:
    """Stretched by 0.4 and 0.2 %, tilted towards the cameras, moved by some pixels."""
    x, z = X[:, 0], X[:, 2]
    return np.column_stack([0.0011 + 0.004 * x, 0.0007 + 0.01 * z, -0.0005 + 0.002 * z])


@dataclass(frozen=True)
class Views:
    """Images of both cameras in two states, and the truth at the left camera's pixels."""

    before: tuple[np.ndarray, np.ndarray]
    after: tuple[np.ndarray, np.ndarray]
    truth: np.ndarray  # (H, W, 3) position in the world


@cache
def views(device: Device, radius: float) -> Views:
    """A printed sheet bent to a radius (infinite: flat)."""
    s, z = np.meshgrid(np.linspace(-0.16, 0.16, 161), np.linspace(-0.12, 0.12, 41))
    s, z = s.ravel(), z.ravel()
    flat = np.column_stack([s, 0 * s, z])
    bent = flat
    if np.isfinite(radius):
        turn = s / radius
        bent = np.column_stack([radius * np.sin(turn), radius * (1 - np.cos(turn)), z])
    row, column = np.divmod(np.arange(160 * 40), 160)
    a = row * 161 + column
    faces = np.column_stack([a, a + 1, a + 162, a + 161])
    paint = gs.paint.Speckle(0.0042, coverage=0.5, softness=0.0004, seed=3)
    shots = []
    for points in (bent, bent + motion(bent)):
        surface = gs.Surface(points, faces, paint=paint, reference=flat, smooth_angle=3.0)
        frames = [gs.render([surface], c, background=0.3, device=device) for c in CAMERAS]
        shots.append([gaussian_filter(np.asarray(f.radiance, np.float64), 0.7) for f in frames])
        if points is bent:
            seen = frames[0].truth()
            truth = seen.image("reference") + seen.image("displacement")
    return Views((shots[0][0], shots[0][1]), (shots[1][0], shots[1][1]), truth)


@pytest.mark.parametrize("radius", [np.inf, 0.25])
def test_shape_and_displacement_in_space(device: Device, radius: float) -> None:
    seen = views(device, radius)
    result = stereo_dic(
        *seen.before, [seen.after[0]], [seen.after[1]], RIG, subset=25, step=9, roi=ROI
    )[0]
    assert result.ok.mean() >= 0.99
    good = result.ok
    column, row = result.points[good].astype(int).T
    truth = seen.truth[row, column]
    world = (result.shape[good] - LEFT[:3, 3]) @ LEFT[:3, :3]
    shape_error = (world - truth) / PIXEL
    moved = result.displacement[good] @ LEFT[:3, :3]
    move_error = (moved - motion(truth)) / PIXEL
    # across the line of sight as good as in one image; along it 1 / tan(11 degrees) worse
    assert np.sqrt((shape_error[:, [0, 2]] ** 2).mean()) <= 0.01
    assert np.sqrt((shape_error[:, 1] ** 2).mean()) <= 0.03
    assert np.sqrt((move_error[:, [0, 2]] ** 2).mean()) <= 0.003
    assert np.sqrt((move_error[:, 1] ** 2).mean()) <= 0.01
    assert np.median(result.residual[good]) <= 0.01
    if np.isinf(radius):
        found = surface_strain(result)
        wanted = np.array([0.5 * (1.004**2 - 1), 0.5 * (0.01**2 + 1.002**2 - 1)])
        tensor = found.tensor[found.ok]
        assert found.ok.mean() >= 0.99
        assert np.abs(tensor[:, [0, 1], [0, 1]].mean(axis=0) - wanted).max() <= 2e-5
        assert tensor.std(axis=0).max() <= 2e-4
        hencky = surface_strain(result, kind="hencky").tensor[found.ok]
        assert np.abs(hencky[:, 0, 0].mean() - np.log(1.004)) <= 2e-5


def test_a_fine_patch_among_coarse_points_is_reached(device: Device) -> None:
    # as a strain gauge among the points by which a rig is laid on the structure: each neighbour of
    # the patch's points is one of these, and no cell of the coarse points has its seed in them
    patch = np.stack(np.meshgrid(np.arange(90, 95), np.arange(42, 47)), -1).reshape(-1, 2)
    coarse = np.stack(np.meshgrid(np.arange(20, 230, 16), np.arange(20, 170, 16)), -1)
    points = np.concatenate([patch, coarse.reshape(-1, 2)]).astype(float)
    result = stereo_shape(*views(device, np.inf).before, RIG, subset=25, points=points)
    assert result.ok[: len(patch)].all()


def test_a_wrong_calibration_is_noticed_point_by_point(device: Device) -> None:
    seen = views(device, np.inf)
    turned = RIG[1].camera_from_rig.copy()
    angle = np.deg2rad(1.0)
    tilt = np.array(
        [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    )
    wrong = rig_camera((WIDTH, HEIGHT), RIG[1].K, None, tilt @ turned[:3, :3], turned[:3, 3])
    result = stereo_shape(*seen.before, (RIG[0], wrong), subset=25, step=20, roi=ROI)
    assert not result.ok.any()
    assert (result.status == Status.EPIPOLAR).mean() >= 0.5
    assert np.isnan(result.shape).all() and np.isnan(result.right).all()


def test_what_one_camera_does_not_see_has_no_position(device: Device) -> None:
    seen = views(device, np.inf)
    right = seen.after[1].copy()
    right[60:130, 90:150] = 0.4
    result = stereo_dic(*seen.before, [seen.after[0]], [right], RIG, subset=21, step=14, roi=ROI)[0]
    lost = ~result.ok
    assert 3 <= lost.sum() <= 0.4 * lost.size
    for values in (result.displacement, result.sigma, result.left):
        assert np.isnan(values[lost]).all() and np.isfinite(values[~lost]).all()
    assert sum(result.counts().values()) == len(result.points)


def test_pairs_are_told_one_by_one_and_need_both_images(device: Device) -> None:
    seen = views(device, np.inf)
    told: list[tuple[int, float]] = []
    options = {"subset": 21, "step": 28, "roi": ROI}
    pairs = [[seen.after[k], seen.before[k]] for k in range(2)]

    def tell(number: int, one: StereoResult) -> None:
        told.append((number, np.nanmedian(one.sigma) if one.ok.any() else np.nan))

    results = stereo_dic(*seen.before, *pairs, RIG, progress=tell, **options)
    assert told == [(k, np.nanmedian(one.sigma)) for k, one in enumerate(results)]
    assert np.nanmedian(results[1].displacement[:, 0]) == pytest.approx(0.0, abs=1e-6)
    assert np.nanmedian(results[0].displacement[:, 0]) > 1e-4
    with pytest.raises(InputError, match="more images of one camera; expected pairs"):
        stereo_dic(*seen.before, pairs[0], pairs[1][:1], RIG, **options)
    blank = np.full_like(seen.before[0], 0.3)
    nothing = stereo_dic(blank, blank, [blank] * 2, [blank] * 2, RIG, progress=tell, **options)
    assert [one.ok.any() for one in nothing] == [False, False] and len(told) == 4


def test_features_may_be_missing(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """The epipolar line leads to the right image too."""
    seen = views(device, np.inf)
    none = np.zeros((0, 2))
    monkeypatch.setattr(
        "gpusim.measure.stereo.epipolar_matching.feature_matches", lambda *_: (none, none)
    )
    result = stereo_shape(*seen.before, RIG, subset=25, step=20, roi=ROI)
    assert result.ok.mean() >= 0.99
    assert np.nanmedian(result.residual) <= 0.01


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"epipolar_px": 0.0}, "epipolar_px"),
        ({"subset": 20}, "subset"),
        ({"match_shape": "cubic"}, "shape"),
    ],
)
def test_wrong_arguments_name_themselves(change: dict[str, object], words: str) -> None:
    image = np.random.default_rng(1).uniform(size=(60, 70))
    with pytest.raises(InputError, match=words):
        stereo_shape(image, image, RIG, **{"subset": 15, **change})
    with pytest.raises(InputError, match="cameras"):
        stereo_shape(image, image, RIG[:1], subset=15)
    camera = gs.Camera(70, 60, RIG[0].K)
    with pytest.raises(InputError, match="got Camera; expected those of calibrate"):
        stereo_shape(image, image, (camera, camera), subset=15)
    with pytest.raises(InputError, match="surface_strain: result; got int"):
        surface_strain(3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"K": np.eye(2)}, "K"),
        ({"R": 2 * np.eye(3)}, "R"),
        ({"t": [1.0, np.nan, 0.0]}, "t"),
        ({"distortion": np.zeros(15)}, "distortion"),
    ],
)
def test_arrays_that_make_no_camera(change: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        rig_camera((64, 48), **{"K": np.eye(3), **change})
