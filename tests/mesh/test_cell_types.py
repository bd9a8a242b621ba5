"""Cell types, shape functions and quadrature, for every type alike."""

from __future__ import annotations

from itertools import product
from math import factorial

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.mesh import CELL_TYPES
from gpusim.mesh.quadrature import FULL_POINTS, cell_rule, face_rule
from gpusim.mesh.shape_functions import (
    FACE_TYPES,
    reference_nodes,
    shape_functions,
    shape_gradients,
)

Float = npt.NDArray[np.float64]
NODES = {
    "hex8": 8, "hex20": 20, "hex27": 27, "tet4": 4, "tet10": 10, "wedge6": 6, "wedge15": 15,
    "pyramid5": 5, "pyramid13": 13,
}  # fmt: skip
VOLUME = {"hex8": 8.0, "tet4": 1 / 6, "wedge6": 1.0, "pyramid5": 4 / 3}
KINDS = tuple(CELL_TYPES)
SHAPES = (*KINDS, *FACE_TYPES)


def inside(kind: str, count: int = 7) -> Float:
    """Points well inside a reference cell or face: convex combinations of its corners."""
    corners = CELL_TYPES[kind].corners if kind in CELL_TYPES else 3 + kind.startswith("quad")
    share = np.random.default_rng(1).dirichlet(np.full(corners, 2.0), count)
    return np.asarray(share @ reference_nodes(kind)[:corners])


@pytest.mark.parametrize("kind", SHAPES)
def test_shape_functions_are_one_at_their_node_and_add_up_to_one(kind: str) -> None:
    nodes = reference_nodes(kind)
    np.testing.assert_allclose(shape_functions(kind, nodes), np.eye(len(nodes)), atol=1e-14)
    values = shape_functions(kind, inside(kind))
    np.testing.assert_allclose(values.sum(axis=1), 1.0, rtol=1e-14)
    # and reproduce the coordinates
    np.testing.assert_allclose(values @ nodes, inside(kind), atol=1e-14)


@pytest.mark.parametrize("kind", SHAPES)
def test_gradients_are_the_derivatives_of_the_shape_functions(kind: str) -> None:
    place, step = inside(kind), 1e-5
    exact = shape_gradients(kind, place)
    for axis in range(place.shape[1]):
        ahead, behind = place.copy(), place.copy()
        ahead[:, axis] += step
        behind[:, axis] -= step
        numeric = (shape_functions(kind, ahead) - shape_functions(kind, behind)) / (2 * step)
        np.testing.assert_allclose(exact[:, :, axis], numeric, atol=2e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_quadratic_types_contain_every_quadratic(kind: str) -> None:
    degree = 1 if CELL_TYPES[kind].linear == kind else 2
    nodes, place = reference_nodes(kind), inside(kind)
    for a, b, c in product(range(degree + 1), repeat=3):
        if a + b + c <= degree:
            field = (nodes ** [a, b, c]).prod(axis=1)
            exact = (place ** [a, b, c]).prod(axis=1)
            np.testing.assert_allclose(shape_functions(kind, place) @ field, exact, atol=1e-14)


def moment(shape: str, a: int, b: int, c: int) -> float:
    """Exact integral of x^a y^b z^c over a reference cell."""

    def line(power: int) -> float:
        return 0.0 if power % 2 else 2.0 / (power + 1)

    def beta(p: int, q: int) -> float:
        return factorial(p) * factorial(q) / factorial(p + q + 1)

    if shape == "hex8":
        return line(a) * line(b) * line(c)
    if shape == "tet4":
        return factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 3)
    if shape == "wedge6":
        return factorial(a) * factorial(b) / factorial(a + b + 2) * line(c)
    return line(a) * line(b) * beta(c, a + b + 2)


EXACT = {
    "hex8": {1: 1, 8: 3, 27: 5},
    "tet4": {1: 1, 4: 2, 14: 5},
    "wedge6": {2: 1, 6: 2, 9: 2, 18: 4},
    "pyramid5": {1: 1, 8: 3, 27: 5},
}


@pytest.mark.parametrize(
    ("kind", "points"), [(kind, count) for kind, rules in EXACT.items() for count in rules]
)
def test_quadrature_is_exact_up_to_its_degree(kind: str, points: int) -> None:
    place, weight = cell_rule(kind, points)
    assert len(place) == len(weight) == points
    assert weight.min() > 0.0
    degree = EXACT[kind][points]
    worst_beyond = 0.0
    for a, b, c in product(range(degree + 2), repeat=3):
        total = weight @ (place ** [a, b, c]).prod(axis=1)
        error = abs(total - moment(kind, a, b, c))
        if a + b + c <= degree:
            assert error <= 5e-16 * VOLUME[kind], (a, b, c)
        elif a + b + c == degree + 1:
            worst_beyond = max(worst_beyond, error)
    assert worst_beyond > 1e-6  # the degree is not just a lower bound


@pytest.mark.parametrize(
    ("kind", "points", "degree"),
    [("tri3", 1, 1), ("tri3", 3, 2), ("tri6", 6, 4), ("quad4", 1, 1), ("quad4", 4, 3),
     ("quad9", 9, 5)],
)  # fmt: skip
def test_face_quadrature_is_exact_up_to_its_degree(kind: str, points: int, degree: int) -> None:
    place, weight = face_rule(kind, points)
    for a, b in product(range(degree + 1), repeat=2):
        if a + b <= degree:
            exact = (
                factorial(a) * factorial(b) / factorial(a + b + 2)
                if kind.startswith("tri")
                else (1 - a % 2) * (1 - b % 2) * 4.0 / ((a + 1) * (b + 1))
            )
            total = weight @ (place ** [a, b]).prod(axis=1)
            assert abs(total - exact) <= 5e-16 * weight.sum(), (a, b)


@pytest.mark.parametrize("kind", KINDS)
def test_faces_close_the_cell_and_look_outward(kind: str) -> None:
    cell, nodes = CELL_TYPES[kind], reference_nodes(kind)
    assert cell.nodes == NODES[kind] == len(nodes)
    assert cell.corners == NODES[cell.linear]
    centre = nodes[: cell.corners].mean(axis=0)
    total, volume = np.zeros(3), 0.0
    walked = []
    for face in cell.faces:
        ring = [corner for corner in face[:4] if corner >= 0]
        p = nodes[ring]
        last = p[3] if len(ring) == 4 else p[2]
        area = 0.5 * np.cross(p[2] - p[0], last - p[1])
        assert area @ (p.mean(axis=0) - centre) > 0.0
        total += area
        volume += area @ p.mean(axis=0) / 3.0
        walked += [*zip(ring, ring[1:] + ring[:1], strict=True)]
        for side in range(len(ring)) if face.size > 4 else ():
            middle = 0.5 * (p[side] + p[(side + 1) % len(ring)])
            np.testing.assert_array_equal(nodes[face[4 + side]], middle)
        if face.size > 8 and face[8] >= 0:
            np.testing.assert_array_equal(nodes[face[8]], p.mean(axis=0))
    np.testing.assert_allclose(total, 0.0, atol=1e-14)
    assert volume == pytest.approx(VOLUME[cell.linear], rel=1e-14)
    # each edge is walked once in each direction, and the list of edges is complete
    assert len(set(walked)) == len(walked)
    assert {(b, a) for a, b in walked} == set(walked)
    assert {tuple(sorted(edge)) for edge in cell.edges.tolist()} == {
        tuple(sorted(map(int, edge))) for edge in walked
    }


@pytest.mark.parametrize("kind", KINDS)
def test_full_rule_measures_the_volume_of_the_reference_cell(kind: str) -> None:
    _, weight = cell_rule(kind, FULL_POINTS[kind])
    assert weight.sum() == pytest.approx(VOLUME[CELL_TYPES[kind].linear], rel=1e-15)


def test_node_order_is_that_of_vtk_and_abaqus() -> None:
    expected = {
        "hex20": {8: (0, -1, -1), 11: (-1, 0, -1), 13: (1, 0, 1), 16: (-1, -1, 0), 19: (-1, 1, 0)},
        "hex27": {20: (-1, 0, 0), 21: (1, 0, 0), 22: (0, -1, 0), 23: (0, 1, 0), 24: (0, 0, -1),
                  25: (0, 0, 1), 26: (0, 0, 0)},
        "tet10": {4: (0.5, 0, 0), 5: (0.5, 0.5, 0), 6: (0, 0.5, 0), 7: (0, 0, 0.5),
                  8: (0.5, 0, 0.5), 9: (0, 0.5, 0.5)},
        "wedge15": {6: (0.5, 0, -1), 8: (0, 0.5, -1), 10: (0.5, 0.5, 1), 12: (0, 0, 0),
                    14: (0, 1, 0)},
        "pyramid13": {5: (0, -1, 0), 8: (-1, 0, 0), 9: (-0.5, -0.5, 0.5), 11: (0.5, 0.5, 0.5)},
    }  # fmt: skip
    for kind, places in expected.items():
        for node, place in places.items():
            np.testing.assert_array_equal(reference_nodes(kind)[node], place)
