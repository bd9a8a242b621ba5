"""MacNeal & Harder's slender beam: every element against beam theory and the published HEXA(8)."""

from __future__ import annotations

import pytest

from gpusim.errors import NotConverged
from gpusim.mesh import mesh_quality
from tests.support.verification_models import slender_beam

SHAPES = ("rectangular", "trapezoidal", "parallelogram")
# Tip displacement over beam theory: in-plane and out-of-plane bending, twist. Published for the
# HEXA(8) of MSC/NASTRAN, which is the incompatible hexahedron.
PUBLISHED_HEXA8 = {
    "rectangular": (0.978, 0.973, 0.892),
    "trapezoidal": (0.047, 0.030, 0.563),
    "parallelogram": (0.624, 0.528, 0.820),
}
QUADRATIC = [
    ("hex20", "full"), ("hex20", "reduced"), ("hex27", "full"), ("tet10", "full"),
    ("wedge15", "full"),
]  # fmt: skip


def normalised(kind: str, formulation: str, shape: str) -> dict[str, float]:
    """Tip displacements over those of beam theory."""
    # one reduced element across leaves hourglass modes free: two are needed
    problem = slender_beam(kind, shape, across=2 if formulation == "reduced" else 1)
    values = problem.solved(formulation)
    return {name: values[name] / problem.published[name] for name in values}


@pytest.mark.parametrize("shape", SHAPES)
def test_incompatible_hexahedra_give_the_published_values(shape: str) -> None:
    values = normalised("hex8", "incompatible", shape)
    assert values["extension"] == pytest.approx(1.0, abs=0.015)
    for name, published in zip(
        ("in-plane", "out-of-plane", "twist"), PUBLISHED_HEXA8[shape], strict=True
    ):
        assert values[name] == pytest.approx(published, abs=0.001)


@pytest.mark.parametrize(("kind", "formulation"), QUADRATIC)
@pytest.mark.parametrize("shape", SHAPES)
def test_quadratic_elements_bend_whatever_their_shape(
    kind: str, formulation: str, shape: str
) -> None:
    values = normalised(kind, formulation, shape)
    assert values["extension"] == pytest.approx(1.0, abs=0.01)
    least = 0.95 if shape == "rectangular" else 0.88
    for name in ("in-plane", "out-of-plane"):
        assert least <= values[name] <= 1.0
    # the published twist lies between thin- and thick-walled theory: Saint-Venant gives 1.063
    assert 0.89 <= values["twist"] <= 1.07


@pytest.mark.parametrize(("lean", "least", "most"), [(0.03, 0.9, 1.0), (0.1, 0.5, 0.7)])
def test_the_quality_report_warns_where_incompatible_modes_get_stiff(
    lean: float, least: float, most: float
) -> None:
    problem = slender_beam("hex8", "trapezoidal", lean=lean)
    values = problem.solved("incompatible")
    assert least <= values["out-of-plane"] / problem.published["out-of-plane"] <= most
    stiff = most < 0.8
    quality = mesh_quality(problem.model.mesh)
    assert (quality.distorted_bricks().size == 6) == stiff
    assert ("hex20" in quality.describe()) == stiff


@pytest.mark.parametrize("formulation", ["full", "bbar"])
def test_plain_and_bbar_hexahedra_lock_in_bending(formulation: str) -> None:
    """Known, and the reason why they aren't the default."""
    values = normalised("hex8", formulation, "rectangular")
    assert values["extension"] == pytest.approx(1.0, abs=0.015)
    assert values["in-plane"] == pytest.approx(0.095, abs=0.006)
    assert values["out-of-plane"] == pytest.approx(0.025, abs=0.002)


def test_hourglass_modes_of_a_single_row_of_reduced_elements_are_refused() -> None:
    with pytest.raises(NotConverged, match="positive definite"):
        slender_beam("hex20", "rectangular").solved("reduced")
