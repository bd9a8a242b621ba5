"""Cook's membrane, NAFEMS LE1 and LE10: our value against the published one."""

from __future__ import annotations

import pytest

from tests.support.verification_models import cook_membrane, elliptic_plate, node_at

# tolerance: what the mesh is good for, as a fraction of the published value
COOK = [
    ("hex8", "incompatible", 24, 0.003), ("hex20", "full", 12, 0.003),
    ("hex20", "reduced", 12, 0.003), ("hex27", "full", 8, 0.003), ("tet10", "full", 10, 0.003),
    ("wedge15", "full", 10, 0.003), ("hex8", "full", 24, 0.02), ("hex8", "bbar", 24, 0.01),
]  # fmt: skip
LE1 = [
    ("hex8", "incompatible", (24, 32, 1), 0.005), ("hex20", "full", (12, 16, 1), 0.005),
    ("hex20", "reduced", (8, 12, 1), 0.01), ("hex27", "full", (8, 12, 1), 0.005),
    ("tet10", "full", (8, 12, 1), 0.005), ("wedge15", "full", (8, 12, 1), 0.005),
]  # fmt: skip
LE10 = [
    ("hex8", "incompatible", (16, 24, 12), 0.03), ("hex20", "full", (8, 12, 6), 0.015),
    ("hex20", "reduced", (8, 12, 6), 0.01), ("hex27", "full", (8, 12, 6), 0.015),
    ("tet10", "full", (6, 8, 4), 0.01), ("wedge15", "full", (6, 8, 4), 0.015),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "formulation", "n", "tolerance"), COOK)
def test_cook_membrane(kind: str, formulation: str, n: int, tolerance: float) -> None:
    value = cook_membrane(kind, n).solved(formulation)["deflection"]
    assert value == pytest.approx(23.96, rel=tolerance)


@pytest.mark.parametrize(("kind", "formulation", "divisions", "tolerance"), LE1)
def test_le1_elliptic_membrane(
    kind: str, formulation: str, divisions: tuple[int, int, int], tolerance: float
) -> None:
    value = elliptic_plate(kind, divisions, thick=False).solved(formulation)["stress yy at D"]
    assert value == pytest.approx(92.7, rel=tolerance)


@pytest.mark.parametrize(("kind", "formulation", "divisions", "tolerance"), LE10)
def test_le10_thick_plate(
    kind: str, formulation: str, divisions: tuple[int, int, int], tolerance: float
) -> None:
    value = elliptic_plate(kind, divisions, thick=True).solved(formulation)["stress yy at D"]
    assert value == pytest.approx(-5.38, rel=tolerance)


def test_the_elliptic_plate_is_the_published_one() -> None:
    mesh = elliptic_plate("hex20", (4, 6, 2), thick=True).model.mesh
    for corner in ((2.0, 0.0), (3.25, 0.0), (0.0, 1.0), (0.0, 2.75)):
        node_at(mesh, (*corner, 0.3))
    x, y, _ = mesh.points.T
    assert ((x / 2.0) ** 2 + y**2).min() == pytest.approx(1.0, rel=1e-12)
    assert ((x / 3.25) ** 2 + (y / 2.75) ** 2).max() == pytest.approx(1.0, rel=1e-12)
