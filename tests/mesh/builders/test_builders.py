"""Builders: plate with hole, bracket, beam, notches; against closed-form volumes and areas."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.mesh import (
    Mesh,
    Notch,
    beam,
    boundary_faces,
    box,
    bracket,
    mesh_quality,
    notched,
    plate_with_hole,
    quadratic,
    set_faces,
)


def volume(mesh: Mesh) -> float:
    faces = boundary_faces(mesh)
    # a curved face isn't flat: the moment of its corners is only exact for straight ones
    return float(np.einsum("fi,fi->", faces.centroids, faces.area_vectors)) / 3.0


def area(mesh: Mesh, name: str) -> float:
    return float(set_faces(mesh, mesh.face_sets[name]).areas.sum())


def unclaimed(mesh: Mesh) -> int:
    """Boundary faces that no face set holds."""
    every = {tuple(pair) for pair in boundary_faces(mesh).pairs().tolist()}
    named = {tuple(pair) for pairs in mesh.face_sets.values() for pair in pairs.tolist()}
    assert named <= every
    return len(every - named)


@pytest.mark.parametrize(("length", "width"), [(200.0, 90.0), (90.0, 130.0), (90.0, 90.0)])
def test_plate_with_hole(length: float, width: float) -> None:
    mesh = plate_with_hole(length, width, 5.0, 40.0, around=32, radial=6, through=3)
    polygon = 0.5 * 32 * 20.0**2 * np.sin(2 * np.pi / 32)
    assert volume(mesh) == pytest.approx(5.0 * (length * width - polygon), rel=1e-12)
    assert mesh_quality(mesh).scaled_jacobian.min() > 0.5
    assert unclaimed(mesh) == 0
    assert area(mesh, "x_max") == pytest.approx(5.0 * width, rel=1e-12)
    assert area(mesh, "z_max") == pytest.approx(length * width - polygon, rel=1e-12)
    hole = mesh.points[set_faces(mesh, mesh.face_sets["hole"]).node_numbers()]
    np.testing.assert_allclose(np.hypot(hole[:, 0], hole[:, 1]), 20.0, rtol=1e-14)
    # elements at the hole are about as long as wide
    step = np.unique(np.round(np.hypot(*mesh.points[mesh.points[:, 1] == 0.0, :2].T), 9))
    assert step[1] - step[0] == pytest.approx(2 * np.pi * 20 / 32, rel=0.5)


@pytest.mark.parametrize(("element", "nodes"), [("hex20", 20), ("hex27", 27)])
def test_midside_nodes_lie_on_the_hole(element: str, nodes: int) -> None:
    mesh = plate_with_hole(60.0, 40.0, 3.0, 16.0, around=16, radial=3, through=1, element=element)
    assert mesh.cells[element].shape[1] == nodes
    assert mesh.dangling_nodes.size == 0
    hole = set_faces(mesh, mesh.face_sets["hole"])
    corner_and_middle = mesh.points[hole.node_numbers()]
    np.testing.assert_allclose(np.hypot(*corner_and_middle[:, :2].T), 8.0, rtol=1e-14)
    # parabolas instead of chords: the area is right to 1e-4 instead of 1e-2
    assert hole.areas.sum() == pytest.approx(np.pi * 16.0 * 3.0, rel=2e-4)
    coarse = plate_with_hole(60.0, 40.0, 3.0, 16.0, around=16, radial=3, through=1)
    assert mesh.node_count == quadratic(coarse, serendipity=element == "hex20").node_count


def test_bracket_has_its_volume_sets_and_frame() -> None:
    mesh = bracket(around=32, bend=40)
    holes = 2 * 0.5 * 32 * 0.006**2 * np.sin(2 * np.pi / 32) * 0.005
    turn = 0.5 * 40 * np.sin(0.5 * np.pi / 40) * (0.011**2 - 0.006**2) * 0.04
    legs = 0.04 * 0.005 * (0.06 - 0.011 + 0.08 - 0.011)
    assert volume(mesh) == pytest.approx(legs - holes + turn, rel=1e-12)
    np.testing.assert_allclose(mesh.bounds, [[0, -0.02, 0], [0.06, 0.02, 0.08]], atol=1e-15)
    assert area(mesh, "base_end") == pytest.approx(0.04 * 0.005, rel=1e-12)
    assert area(mesh, "base") == pytest.approx((0.06 - 0.011) * 0.04 - holes / 0.01, rel=1e-12)
    for name, sign in (("y_min", -1.0), ("y_max", 1.0)):
        np.testing.assert_allclose(
            set_faces(mesh, mesh.face_sets[name]).normals[:, 1], sign, rtol=1e-12
        )
    hole = mesh.points[set_faces(mesh, mesh.face_sets["wall_hole"]).node_numbers()]
    np.testing.assert_allclose(np.hypot(hole[:, 1], hole[:, 2] - 0.06), 0.006, rtol=1e-12)
    hole = mesh.points[set_faces(mesh, mesh.face_sets["base_hole"]).node_numbers()]
    np.testing.assert_allclose(np.hypot(hole[:, 1], hole[:, 0] - 0.04), 0.006, rtol=1e-12)
    assert mesh_quality(mesh).scaled_jacobian.min() > 0.5


@pytest.mark.parametrize("element", ["hex8", "hex20", "hex27"])
def test_bracket_without_a_straight_piece_beside_the_bend(element: str) -> None:
    mesh = bracket(base_length=0.051, wall_height=0.07, element=element)
    assert mesh.dangling_nodes.size == 0
    assert boundary_faces(mesh).area_vectors.sum() == pytest.approx(0.0, abs=1e-16)
    np.testing.assert_allclose(mesh.bounds[1], [0.051, 0.02, 0.07], rtol=1e-14)


def test_tapered_beam() -> None:
    mesh = beam(8.0, 1.0, 0.5, (16, 4, 2), end_width=0.4, end_height=0.3)
    np.testing.assert_allclose(mesh.bounds, [[0, -0.5, -0.25], [8, 0.5, 0.25]], atol=1e-15)
    assert area(mesh, "x_max") == pytest.approx(0.4 * 0.3, rel=1e-12)
    # prismatoid: L/6 (A1 + 4 Am + A2)
    assert volume(mesh) == pytest.approx(8 / 6 * (0.5 + 4 * 0.7 * 0.4 + 0.12), rel=1e-12)
    assert unclaimed(mesh) == 0


def test_notched_beam_of_the_paper() -> None:
    """800 x 40 x 4 mm, three notches 1 mm wide and 13.33 mm deep."""
    places = (200.0, 400.0, 600.0)
    notches = [Notch(place, 1.0, 40.0 / 3.0) for place in places]
    mesh = beam(800.0, 40.0, 4.0, (160, 8, 2), notches=notches)
    assert volume(mesh) == pytest.approx(4 * (800 * 40 - 3 * 40 / 3), rel=1e-12)
    assert unclaimed(mesh) == 0
    for number, place in enumerate(places, start=1):
        faces = set_faces(mesh, mesh.face_sets[f"notch_{number}"])
        assert faces.areas.sum() == pytest.approx(4 * (2 * 40 / 3 + 1.0), rel=1e-12)
        points = mesh.points[faces.node_numbers()]
        np.testing.assert_allclose(
            [points[:, 0].min(), points[:, 0].max(), points[:, 1].max()],
            [place - 0.5, place + 0.5, -20 + 40 / 3],
            rtol=1e-13,
        )
    x = np.unique(mesh.points[:, 0])
    step = np.diff(x)
    assert step.max() <= 5.0 * (1 + 1e-12) and step.min() == pytest.approx(0.5)
    ratio = step[1:] / step[:-1]
    assert np.maximum(ratio, 1 / ratio).max() < 1.6
    assert len(x) < 260


def test_notches_on_other_sides_and_opposite_each_other() -> None:
    notches = [
        Notch(0.5, 0.1, 0.1, axis="x", side="+z", cells=1),
        Notch(0.5, 0.1, 0.15, axis="x", side="-z"),
        Notch(0.2, 0.05, 0.05, axis="y", side="+z"),
    ]
    mesh = box((1.0, 0.4, 0.3), (10, 4, 3), notches=notches)
    cut = 0.4 * 0.1 * 0.25 + 0.05 * 0.05 - 0.1 * 0.05 * 0.05
    assert volume(mesh) == pytest.approx(0.12 - cut, rel=1e-12)
    assert area(mesh, "notch_2") == pytest.approx(0.4 * (2 * 0.15 + 0.1), rel=1e-12)


def test_cells_are_cut_from_any_mesh_and_its_sets_follow() -> None:
    grid = box((4.0, 2.0, 1.0), (8, 4, 2)).with_sets(
        node_sets={"all": np.arange(9 * 5 * 3, dtype=np.int32)},
        cell_sets={"row": np.arange(8, dtype=np.int32)},
    )
    mesh = notched(grid, [Notch(2.0, 1.0, 0.5)])
    assert mesh.cell_count == 64 - 4 and mesh.node_count == 135 - 3
    assert len(mesh.node_sets["all"]) == mesh.node_count
    np.testing.assert_array_equal(mesh.cell_sets["row"], np.arange(6))
    assert len(mesh.face_sets["notch_1"]) == 2 * 2 + 2 * 2
    assert area(mesh, "y_min") == pytest.approx(3.0)
    with pytest.raises(InputError, match="notch 1: 4 cells lie partly inside"):
        notched(grid, [Notch(2.0, 1.0, 0.7, side="+y")])


def test_a_million_elements_are_quick() -> None:
    started = time.process_time()
    mesh = box((1.0, 2.0, 3.0), (100, 100, 100))
    assert mesh.cell_count == 1_000_000
    # 0.9 s of CPU; a loop over cells would take minutes
    assert time.process_time() - started < 6.0


BAD: list[tuple[Any, str]] = [
    (lambda: plate_with_hole(1.0, 1.0, 0.1, 1.0), "hole_diameter; got 1.0"),
    (lambda: plate_with_hole(1.0, 1.0, -0.1, 0.5), "thickness"),
    (lambda: plate_with_hole(1.0, 1.0, 0.1, 0.5, around=30), "multiple of 4"),
    (lambda: plate_with_hole(1.0, 1.0, 0.1, 0.5, element="tet4"), "got 'tet4'"),
    (lambda: bracket(base_length=0.05), "base_length; got 0.05"),
    (lambda: bracket(width=float("nan")), "width; got nan"),
    (lambda: beam(1.0, 0.0, 1.0, (1, 1, 1)), "length, width, height"),
    (lambda: beam(1.0, 1.0, 1.0, (1, 1, 1), end_width=-1.0), "end_width"),
    (
        lambda: beam(9.0, 1.0, 1.0, (1, 1, 1), end_width=0.5, notches=[Notch(1.0, 0.1, 0.2)]),
        "tapered",
    ),
    (lambda: Notch(0.0, 0.1, 0.1, axis="x", side="-x"), "Notch.side; got '-x'"),
    (lambda: Notch(0.0, 0.1, float("nan")), "Notch.depth; got nan"),
    (lambda: Notch(float("inf"), 0.1, 0.1), "Notch.position"),
    (lambda: Notch(0.0, 0.1, 0.1, cells=0), "Notch.cells"),
    (lambda: box((1, 1, 1), (2, 2, 2), notches=[Notch(0.0, 0.1, 0.1)]), "leaves the body"),
    (lambda: box((1, 1, 1), (2, 2, 2), notches=[Notch(0.5, 0.1, 1.0)]), "in two"),
    (
        lambda: box((1, 1, 1), (2, 2, 2), notches=[Notch(0.5, 0.1, 0.2), Notch(0.6, 0.1, 0.2)]),
        "notch 2: meets an earlier one",
    ),
    (
        lambda: box(
            (1, 1, 1), (2, 2, 2), notches=[Notch(0.5, 0.1, 0.5), Notch(0.5, 0.1, 0.5, side="+y")]
        ),
        "notch 2: meets an earlier one",
    ),
    (
        lambda: box(
            (1, 1, 1), (2, 2, 2), notches=[Notch(0.5, 0.1, 0.5), Notch(0.2, 0.1, 0.5 + 1e-9)]
        ),
        "almost coincide",
    ),
    (lambda: notched(box((1, 1, 1), (2, 2, 2)), [Notch(5.0, 1.0, 0.5)]), "no cell lies inside"),
]


@pytest.mark.parametrize(("make", "words"), BAD)
def test_what_cannot_be_built_is_refused(make: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()
