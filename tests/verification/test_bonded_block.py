"""A rubber block that is bonded to its plates: elements converge to one force."""

from __future__ import annotations

import pytest

from tests.support.bonded_block import FORCE, extrapolated, plate_force

# hex8 apart, within 0.1 % of the converged force
MESHES = [("hex20", "reduced", 6), ("tet10", "bbar", 4)]


def test_force_converges_as_cells_get_smaller() -> None:
    coarse, middle, fine = (plate_force("hex8", "incompatible", cells) for cells in (3, 6, 12))
    assert coarse > middle > fine > FORCE
    # order 1.6: the plates' edges are singular
    assert 2.0**1.4 < (coarse - middle) / (middle - fine) < 2.0**1.8
    assert extrapolated(coarse, middle, fine) == pytest.approx(FORCE, rel=2e-4)
    assert fine == pytest.approx(FORCE, rel=1e-3) and middle != pytest.approx(FORCE, rel=2e-3)


@pytest.mark.parametrize(("kind", "formulation", "cells"), MESHES)
def test_other_elements_find_the_same_force(kind: str, formulation: str, cells: int) -> None:
    assert plate_force(kind, formulation, cells) == pytest.approx(FORCE, rel=1e-3)
