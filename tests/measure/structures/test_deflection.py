"""Scale, camera motion and the deflection line, on numbers worked out by hand."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import deflection_line, rigid_motion, scale_coefficient

KNOWN = np.array([[0.0, 0.0], [60.0, 0.0], [130.0, 5.0], [20.0, 45.0]])
MM_PER_PX = 0.2137


def seen(mm: np.ndarray, angle: float = 0.0) -> np.ndarray:
    """Millimetres (y up) as pixels (y down) of a camera rolled by ``angle``."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (mm @ turn.T * [1, -1]) / MM_PER_PX + [512.25, 300.5]


@pytest.mark.parametrize("angle", [0.0, 0.3, -2.9])
def test_scale_is_found_for_any_roll(angle: float) -> None:
    scale = scale_coefficient(seen(KNOWN, angle), KNOWN)
    assert scale.mm_per_px == pytest.approx(MM_PER_PX, rel=1e-13)
    assert scale.residual_px <= 1e-10
    assert np.allclose(scale.positions(seen(KNOWN, angle)), KNOWN, rtol=0, atol=1e-10)
    moved = KNOWN + np.array([1.5, -32.7])
    vectors = scale.vectors(seen(moved, angle) - seen(KNOWN, angle))
    assert np.allclose(vectors, [[1.5, -32.7]] * 4, rtol=0, atol=1e-10)


def test_positions_along_a_line_are_enough() -> None:
    along = np.array([0.0, 50.0, 130.0])
    points = seen(np.column_stack([along, np.zeros(3)]), 0.1)
    scale = scale_coefficient(points, along)
    assert scale.mm_per_px == pytest.approx(MM_PER_PX, rel=1e-13)
    # up in the image is positive
    assert scale.vectors(np.array([[0.0, -10.0]]))[0, 1] > 0


def test_residuals_tell_a_wrong_marker() -> None:
    """Nine markers in a row, one of them seen 0.8 px too low."""
    along = np.arange(9) * 25.0
    points = seen(np.column_stack([along, np.zeros(9)]))
    points[4, 1] += 0.8
    scale = scale_coefficient(points, along)
    lengths = np.linalg.norm(scale.residuals_px, axis=1)
    assert int(np.argmax(lengths)) == 4
    # the known place lies above, as seen in the image; the mean takes its share of 1/9
    assert np.allclose(scale.residuals_px[4], [0.0, -0.8 * 8 / 9], rtol=0, atol=1e-3)
    assert scale.residual_px == pytest.approx(0.8 * np.sqrt(8) / 9, rel=1e-3)


def test_uncertainty_matches_the_scatter_of_repeated_fits() -> None:
    rng = np.random.default_rng(2)
    fits = [
        scale_coefficient(seen(KNOWN) + 0.3 * rng.normal(size=(4, 2)), KNOWN) for _ in range(400)
    ]
    scatter = np.std([f.mm_per_px for f in fits])
    assert np.sqrt(np.mean([f.sigma**2 for f in fits])) == pytest.approx(scatter, rel=0.15)


def test_camera_motion_is_taken_out() -> None:
    static = np.array([[10.0, 20.0], [900.0, 40.0], [450.0, 700.0]])
    angle, shift = 0.002, np.array([3.5, -1.25])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def camera(points: np.ndarray) -> np.ndarray:
        return points @ turn.T + shift

    motion = rigid_motion(static, camera(static) - static)
    assert motion.angle == pytest.approx(angle, rel=1e-12)
    assert motion.rms <= 1e-10 and motion.count == 3
    points = seen(KNOWN)
    true = seen(KNOWN + np.array([0.0, -30.0])) - points
    line = deflection_line(
        KNOWN[:, 0],
        points,
        camera(points) - points + true,
        scale_coefficient(points, KNOWN),
        camera=motion,
    )
    assert np.allclose(line.displacement_mm, [[0.0, -30.0]] * 4, rtol=0, atol=1e-9)
    assert line.position_mm.tolist() == [0.0, 20.0, 60.0, 130.0]


def test_one_static_marker_gives_a_shift_and_lost_ones_are_left_out() -> None:
    motion = rigid_motion([[5.0, 5.0], [9.0, 1.0]], [[0.5, 0.25], [np.nan, np.nan]])
    assert motion.count == 1 and motion.angle == 0.0
    assert motion.displacement(np.array([[100.0, 3.0]])).tolist() == [[0.5, 0.25]]
    with pytest.raises(InputError, match="none was tracked"):
        rigid_motion([[5.0, 5.0]], [[np.nan, np.nan]])


def test_csv_has_a_row_per_marker_and_no_number_for_lost_ones(tmp_path: Path) -> None:
    points = seen(KNOWN)
    moved = seen(KNOWN + np.array([0.0, -30.0])) - points
    moved[1] = np.nan
    line = deflection_line(
        KNOWN[:, 0],
        points,
        moved,
        scale_coefficient(points, KNOWN),
        status=[0, 6, 0, 4],
        sigma_px=[0.01, np.nan, 0.01, 0.01],
    )
    line.write_csv(tmp_path / "line.csv")
    text = (tmp_path / "line.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    assert [row["status"] for row in rows] == ["0", "4", "6", "0"]
    assert [row["across_mm"] for row in rows] == ["-30", "", "", "-30"]
    assert float(rows[0]["sigma_mm"]) == pytest.approx(0.01 * MM_PER_PX, rel=1e-6)


def test_wrong_arguments_name_themselves() -> None:
    with pytest.raises(InputError, match="positions_mm"):
        scale_coefficient(seen(KNOWN), KNOWN[:3])
    with pytest.raises(InputError, match="NaN"):
        scale_coefficient(np.where(KNOWN == 45.0, np.nan, KNOWN), KNOWN)
    with pytest.raises(InputError, match="coincide"):
        scale_coefficient(np.ones((3, 2)), KNOWN[:3])
    with pytest.raises(InputError, match="deflection line"):
        deflection_line([0.0, 1.0], seen(KNOWN), seen(KNOWN), scale_coefficient(seen(KNOWN), KNOWN))


def test_two_points_say_nothing_of_the_scales_uncertainty() -> None:
    points = np.array([[10.0, 20.0], [110.0, 25.0], [60.0, 80.0]])
    places = np.array([[0.0, 0.0], [201.0, -9.0], [101.0, -120.0]])
    two = scale_coefficient(points[:2], places[:2])
    assert np.isnan(two.sigma) and scale_coefficient(points, places).sigma > 0.0
    moved, noise = np.array([[3.0, 4.0], [1.0, 0.0]]), np.array([0.01, 0.02])
    line = deflection_line([0.0, 1.0], points[:2], moved, two, sigma_px=noise)
    assert np.allclose(line.sigma_mm, noise * two.mm_per_px, rtol=1e-12)
