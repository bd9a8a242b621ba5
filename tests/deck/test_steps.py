"""What the steps of a deck add up to: forces, supports, amplitudes, temperatures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.solver.reference import reference_solution
from benchmarks.stability.hard_bodies import bar
from gpusim.deck import Deck, Step, load_deck
from gpusim.errors import InputError
from gpusim.fem import Equations, Isotropic, Model, solve, thermal
from tests.support.deck_texts import FIXED, LABELS, MODEL, POINTS, deck, step, write

EDGE = "*AMPLITUDE, NAME=OWN\n0., 0., 2., 4., 6., 5.\n"
TOTAL = "*AMPLITUDE, NAME=CLOCK, TIME=TOTAL TIME\n0., 0., 2., 4., 6., 5.\n"


def load(folder: Path, *parts: str, **blocks: str) -> Deck:
    return load_deck(write(folder, deck(*parts, **blocks)))


def at(label: int) -> int:
    return int(np.flatnonzero(label == LABELS)[0])


def force(one: Step, label: int) -> list[float]:
    return one.forces[at(label)].tolist()


def test_the_model_of_a_step(tmp_path: Path) -> None:
    found = load(tmp_path, step("*CLOAD", "22, 2, -4.", "*NODE PRINT, NSET=ALL", "U"))
    assert found.materials == (Isotropic(200.0, 0.25, 3.0, 2e-3),)
    assert found.formulation == {"hex8": "full"}
    assert found.cell_labels.tolist() == [7, 9]
    assert found.node_labels.tolist() == LABELS.tolist()
    assert found.ignored == ("*HEADING", "*NODE PRINT")
    model = found.model(1)
    assert np.flatnonzero(model.fixed.all(axis=1)).tolist() == [at(k) for k in (11, 14, 17, 20)]
    assert model.load_cases.sum() == -4.0
    assert model.load_cases[0, at(22), 1] == -4.0


def test_forces_add_up_in_a_step_and_are_replaced_in_a_later_one(tmp_path: Path) -> None:
    found = load(
        tmp_path,
        step("*CLOAD", "22, 2, 1.", "22, 2, 1.5", "*CLOAD", "22, 2, 2.", "RIGHT, 1, 7."),
        step("*CLOAD", "22, 2, 10."),
        step("*CLOAD, OP=NEW", "13, 3, 6.", "*CLOAD, OP=NEW", "13, 3, 1."),
    )
    assert [force(one, 22) for one in found.steps] == [[7, 4.5, 0], [7, 10, 0], [0, 0, 0]]
    assert [force(one, 13) for one in found.steps] == [[7, 0, 0], [7, 0, 0], [0, 0, 7]]


def test_pressures_and_body_forces(tmp_path: Path) -> None:
    """Totals: pressure times area, density times volume times acceleration."""
    found = load(
        tmp_path,
        step("*DLOAD", "9, P4, 2."),
        step("*DLOAD, OP=NEW", "BRICKS, GRAV, 10., 0., 0., -4."),
        step("*DSLOAD, OP=NEW", "END, P, 3.", "*DLOAD", "9, P4, 1."),
        step("*DLOAD, OP=NEW", ", BX, 2.", "7, BZ, 1."),
        step("*DLOAD, OP=NEW", "7, CENTRIF, 4., 0., 1., 0., 0., 0., 2."),
        step("*DLOAD, OP=NEW", "9, P4, 2.", "7, P6, 5.", "BRICKS, P1, 1."),
    )
    totals = [one.forces.sum(axis=0) for one in found.steps]
    volume = np.array([30.0, 60.0])
    np.testing.assert_allclose(totals[0], [-30, 0, 0], atol=1e-12)
    np.testing.assert_allclose(totals[1], [0, 0, -30 * volume.sum()], atol=1e-11)
    np.testing.assert_allclose(totals[2], [-60, 0, 0], atol=1e-12)
    np.testing.assert_allclose(totals[3], [2 * volume.sum(), 0, volume[0]], atol=1e-11)
    # density x volume x omega^2 x distance of the centroid (1, 1.5) from the axis (0, 1)
    np.testing.assert_allclose(totals[4], [360 * 1.0, 360 * 0.5, 0], atol=1e-11)
    np.testing.assert_allclose(totals[5], [-30 + 75, 0, 18], atol=1e-11)
    share = found.steps[0].forces[:, 0]
    np.testing.assert_allclose(share[POINTS[:, 0] == 6.0], -7.5)
    assert not share[POINTS[:, 0] < 6.0].any()


def test_supports_stay_change_and_go(tmp_path: Path) -> None:
    found = load(
        tmp_path,
        step("*BOUNDARY", "13, 2, 3, 0.5"),
        step("*BOUNDARY", "13, 3, 3, 0.25", "22, XSYMM"),
        step("*BOUNDARY, OP=NEW", "LEFT, ENCASTRE", "22, 1, 6"),
    )
    prescribed = [one.prescribed[at(13)].tolist() for one in found.steps]
    assert prescribed == [[0, 0.5, 0.5], [0, 0.5, 0.25], [0, 0, 0]]
    held = [one.fixed[at(22)].tolist() for one in found.steps]
    assert held == [[False] * 3, [True, False, False], [True] * 3]
    assert not found.steps[2].fixed[at(13)].any()
    assert found.steps[2].fixed[at(14)].all()


def test_amplitudes(tmp_path: Path) -> None:
    """Over the step's time a load keeps its last value, over the total time it goes on."""
    found = load(
        tmp_path,
        step("*CLOAD, AMPLITUDE=own", "22, 1, 1.", static="*STATIC\n1., 1.5"),
        step("*CLOAD, AMPLITUDE=CLOCK", "22, 2, 1.", static="*STATIC\n1., 0.25"),
        step("*CLOAD", "22, 3, 1.", static="*STATIC\n1., 2.25"),
        step("*CLOAD", "22, 2, 1."),
        material=EDGE + TOTAL + deck("", model="", fixed=""),
    )
    assert [one.time for one in found.steps] == [1.5, 1.75, 4.0, 5.0]
    assert force(found.steps[0], 22) == [3.0, 0.0, 0.0]
    assert force(found.steps[1], 22) == [3.0, 3.5, 0.0]
    assert force(found.steps[2], 22) == [3.0, 4.5, 1.0]
    assert force(found.steps[3], 22) == [3.0, 1.0, 1.0]


def test_amplitudes_scale_pressures_supports_and_temperatures(tmp_path: Path) -> None:
    found = load(
        tmp_path,
        step(
            "*DLOAD, AMPLITUDE=CLOCK", "9, P4, 2.", "7, GRAV, 1., 0., 1., 0.",
            "*BOUNDARY, AMPLITUDE=CLOCK", "13, 2, 2, 0.5",
            "*TEMPERATURE, AMPLITUDE=CLOCK", "ALL, 10.",
        ),
        step("*CLOAD", "22, 3, 0."),
        material=TOTAL + deck("", model="", fixed=""),
    )  # fmt: skip
    for one, factor in zip(found.steps, (2.0, 4.0), strict=True):
        np.testing.assert_allclose(one.prescribed[at(13), 1], 0.5 * factor)
        np.testing.assert_allclose(one.temperature, 10.0 * factor)
        total = one.forces.sum(axis=0)
        np.testing.assert_allclose(total, [-30 * factor, 90 * factor, 0], atol=1e-11)


def test_temperature_counts_from_the_initial_one(tmp_path: Path) -> None:
    initial = "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 20.\n"
    found = load(
        tmp_path,
        initial,
        step("*TEMPERATURE", "ALL, 70.", "*BOUNDARY", "13, 3"),
        step("*TEMPERATURE", "11, 120."),
        step("*TEMPERATURE, OP=NEW", "22, 30."),
    )
    changes = [one.temperature for one in found.steps]
    np.testing.assert_array_equal(changes[0], np.full(12, 50.0))
    np.testing.assert_array_equal(changes[1], [100.0, *[50.0] * 11])
    np.testing.assert_array_equal(changes[2], [*[0.0] * 11, 10.0])
    expected = thermal(found.mesh, found.materials, 50.0, formulation="full")
    np.testing.assert_allclose(found.steps[0].forces, expected, atol=1e-12)


def test_free_expansion_is_exact(tmp_path: Path) -> None:
    found = load(
        tmp_path,
        "*BOUNDARY\n11, 1, 3\n13, 2, 3\n14, 3\n",
        step("*TEMPERATURE", "ALL, 50."),
        fixed="",
    )
    (solution,) = found.solve(backend="numpy", tolerance=1e-9)
    np.testing.assert_allclose(solution.u, 0.1 * POINTS, atol=1e-9)
    assert solution.energy_balance <= 1e-9


def test_steps_of_equal_supports_become_load_cases(tmp_path: Path) -> None:
    found = load(
        tmp_path,
        step("*CLOAD", "22, 3, 1."),
        step("*CLOAD, OP=NEW", "22, 1, 1."),
        step("*BOUNDARY", "13, 1, 3, 0.01"),
        step("*CLOAD, OP=NEW", "22, 3, 2."),
    )
    both = found.model(1, 2)
    assert both.load_cases.shape == (2, 12, 3)
    solutions = found.solve(backend="numpy", tolerance=1e-10)
    assert [one.u.shape for one in solutions] == [(12, 3)] * 4
    assert all(one.converged for one in solutions)
    np.testing.assert_allclose(solutions[2].u[at(13)], 0.01)
    # superposition: load of step 4 = twice step 1, its support = step 3 less the load of step 2
    support = load(tmp_path, step("*BOUNDARY", "13, 1, 3, 0.01")).solve(backend="numpy")[0].u
    held = (
        load(tmp_path, step("*BOUNDARY", "13, 1, 3, 0.", "*CLOAD", "22, 3, 2."))
        .solve(backend="numpy", tolerance=1e-10)[0]
        .u
    )
    np.testing.assert_allclose(solutions[3].u, support + held, atol=1e-6 * np.abs(held).max())
    reaction = solutions[0].reactions.sum(axis=0)
    np.testing.assert_allclose(reaction, [0, 0, -1], atol=1e-8)


def test_abaqus_part_and_instance(tmp_path: Path) -> None:
    """One part with one instance of it in place, as Abaqus writes a model of one body."""
    text = (
        "*Part, name=Body\n" + MODEL.split("*HEADING\ntwo bricks\n")[1]
        + "*Solid Section, elset=BRICKS, material=STEEL\n,\n*End Part\n"
        + "*Assembly, name=Whole\n*Instance, name=Body-1, part=Body\n*End Instance\n"
        + "*Nset, nset=Held, instance=Body-1\n11, 14, 17, 20\n*End Assembly\n"
        + "*Material, name=STEEL\n*Elastic\n200., 0.25\n"
        + "*Step, name=Push, nlgeom=NO\n*Static\n1., 1., 1e-05, 1.\n*Boundary\nHeld, ENCASTRE\n"
        + "*Dsload\nEND, P, 2.\n*Cload\nBody-1.RIGHT, 3, 1.\n"
        + "*Output, field, variable=PRESELECT\n*End Step\n"
    )  # fmt: skip
    found = load_deck(write(tmp_path, text))
    assert found.steps[0].name == "Push"
    np.testing.assert_allclose(found.steps[0].forces.sum(axis=0), [-30, 0, 4], atol=1e-12)
    assert found.steps[0].fixed.sum() == 12


def test_turned_axes_of_supports_and_forces(tmp_path: Path) -> None:
    """In axes turned by 90 degrees about z, direction 1 is y; a cylinder's is the radius."""
    turned = "*TRANSFORM, NSET=RIGHT, TYPE=R\n0., 1., 0., -1., 0., 0.\n"
    found = load(tmp_path, turned, step("*CLOAD", "22, 1, 5.", "*BOUNDARY", "13, 1, 1, 0.5"))
    assert force(found.steps[0], 22) == [0.0, 5.0, 0.0]
    assert found.steps[0].fixed[at(13)].tolist() == [False, True, False]
    assert found.steps[0].prescribed[at(13)].tolist() == [0.0, 0.5, 0.0]
    assert found.steps[0].constraints == ()
    round_ = "*TRANSFORM, NSET=RIGHT, TYPE=C\n0., -3., 0., 0., -3., 1.\n"
    found = load(tmp_path, round_, step("*CLOAD", "22, 1, 5.", "22, 2, 1.", "16, 3, 2."))
    radial = np.array([6.0, 6.0, 0.0]) / np.sqrt(72.0)
    expected = 5.0 * radial + [-radial[1], radial[0], 0.0]
    np.testing.assert_allclose(found.steps[0].forces[at(22)], expected, atol=1e-14)
    assert force(found.steps[0], 16) == [0.0, 0.0, 2.0]


def test_a_skew_support_is_held_by_an_equation(tmp_path: Path) -> None:
    """A support along (1, 1, 0) alone: u_x + u_y = 0 there, and its force has that direction."""
    skew = "*NSET, NSET=ONE\n22\n*TRANSFORM, NSET=ONE, TYPE=R\n1., 1., 0., -1., 1., 0.\n"
    found = load(tmp_path, skew, "*BOUNDARY\nONE, 1\n", step("*CLOAD", "13, 1, 3.", "13, 3, 1."))
    (solution,) = found.solve(backend="numpy")
    u, reaction = solution.u[at(22)], solution.reactions[at(22)]
    assert abs(u[0] + u[1]) <= 1e-12 * np.abs(solution.u).max()
    assert abs(u[0]) > 1e-4 * np.abs(solution.u).max()
    np.testing.assert_allclose(reaction[:2], np.full(2, reaction[:2].mean()), rtol=1e-9)
    np.testing.assert_allclose(solution.reactions.sum(axis=0), [-3, 0, -1], atol=1e-9)
    assert solution.converged and solution.error_estimate <= 1e-10


def test_equations_tie_nodes_together(tmp_path: Path) -> None:
    """u_x of the end's nodes equal, and node 13's u_z half of node 22's."""
    ties = "*EQUATION\n2\n13, 1, 1., 22, 1, -1.\n2\n16, 1, 2., 22, 1, -2.\n"
    more = "3\n13, 3, 2., 22, 3, -1.,\n19, 2, 0.\n"
    found = load(tmp_path, ties, more, step("*CLOAD", "22, 1, 3.", "19, 3, 1."))
    (solution,) = found.solve(backend="numpy")
    u = solution.u
    size = np.abs(u).max()
    assert abs(u[at(13), 0] - u[at(22), 0]) <= 1e-12 * size
    assert abs(u[at(16), 0] - u[at(22), 0]) <= 1e-12 * size
    assert abs(2 * u[at(13), 2] - u[at(22), 2]) <= 1e-12 * size
    assert abs(u[at(13), 2]) > 1e-3 * size
    assert solution.energy_balance <= 1e-10


TIED = """*NODE, NSET=ALL
1, 0., 0., 0.
2, 2., 0., 0.
3, 2., 3., 0.
4, 0., 3., 0.
5, 0., 0., 5.
6, 2., 0., 5.
7, 2., 3., 5.
8, 0., 3., 5.
11, {gap}, 1., 1.
12, 6., 1., 1.
13, 6., 2., 1.
14, {gap}, 2., 1.
15, {gap}, 1., 3.
16, 6., 1., 3.
17, 6., 2., 3.
18, {gap}, 2., 3.
*ELEMENT, TYPE=C3D8, ELSET=BRICKS
1, 1, 2, 3, 4, 5, 6, 7, 8
2, 11, 12, 13, 14, 15, 16, 17, 18
*NSET, NSET=LEFT
1, 4, 5, 8
*NSET, NSET=RIGHT
12, 13, 16, 17
*SURFACE, NAME=BIG
1, S4
*SURFACE, NAME=SMALL
2, S6
"""


def test_a_tie_between_meshes_that_do_not_match(tmp_path: Path) -> None:
    """A small brick on a large one: under one temperature both expand freely and stay joined."""
    held = "*BOUNDARY\n1, 1, 3\n4, 1\n4, 3\n5, 1, 2\n8, 1\n"
    found = load(
        tmp_path, "*TIE, NAME=T\nSMALL, BIG\n", step("*TEMPERATURE", "ALL, 50."),
        model=TIED.format(gap="2."), fixed=held,
    )  # fmt: skip
    (solution,) = found.solve(backend="numpy")
    np.testing.assert_allclose(solution.u, 0.1 * found.mesh.points, atol=1e-12)


def test_tied_nodes_follow_their_face(tmp_path: Path) -> None:
    found = load(
        tmp_path, "*TIE, NAME=T\nSMALL, BIG\n", step("*CLOAD", "RIGHT, 3, 1."),
        model=TIED.format(gap="2."),
    )  # fmt: skip
    (solution,) = found.solve(backend="numpy")
    row = {int(label): k for k, label in enumerate(found.node_labels)}
    # node 11 at y = 1 of 3, z = 1 of 5 of the face 2 3 7 6
    weights = {2: 2 / 3 * 4 / 5, 3: 1 / 3 * 4 / 5, 7: 1 / 3 * 1 / 5, 6: 2 / 3 * 1 / 5}
    expected = sum(weight * solution.u[row[label]] for label, weight in weights.items())
    size = np.abs(solution.u).max()
    np.testing.assert_allclose(solution.u[row[11]], expected, atol=1e-12 * size)
    left = [row[label] for label in (1, 4, 5, 8)]
    np.testing.assert_allclose(solution.reactions[left].sum(axis=0), [0, 0, -4], atol=1e-9)


def test_a_tie_over_a_gap(tmp_path: Path) -> None:
    """Nodes aren't moved: a gap within the tolerance needs ADJUST=NO."""
    model, load_ = TIED.format(gap="2.05"), step("*CLOAD", "RIGHT, 1, 1.")
    with pytest.raises(InputError, match=r"node 11 would have to be moved by 0\.05"):
        load(tmp_path, "*TIE, NAME=T\nSMALL, BIG\n", load_, model=model)
    with pytest.raises(InputError, match="node 11 lies off the surface BIG"):
        load(tmp_path, "*TIE, NAME=T, POSITION TOLERANCE=0.01\nSMALL, BIG\n", load_, model=model)
    found = load(tmp_path, "*TIE, NAME=T, ADJUST=NO\nSMALL, BIG\n", load_, model=model)
    (solution,) = found.solve(backend="numpy")
    assert solution.converged
    assert solution.energy_balance <= 1e-10


def test_initial_stress_pushes_like_the_load_that_holds_it(tmp_path: Path) -> None:
    """A uniform stress s wants to let go: it moves the end as a pressure -s there does."""
    initial = "*INITIAL CONDITIONS, TYPE=STRESS\nBRICKS, -3., 0., 0., 0., 0., 0.\n"
    free = "*BOUNDARY\nLEFT, 1\n11, 2, 3\n17, 2\n"
    found = load(tmp_path, initial, step("*NODE PRINT", "U"), fixed=free)
    (solution,) = found.solve(backend="numpy", tolerance=1e-9)
    expected = POINTS * [3.0 / 200.0, -0.25 * 3.0 / 200.0, -0.25 * 3.0 / 200.0]
    np.testing.assert_allclose(solution.u, expected, atol=1e-9)
    stress = found.point_stress(1, solution.u)["hex8"]
    np.testing.assert_allclose(stress, np.zeros((2, 8, 6)), atol=1e-7)
    one = "*INITIAL CONDITIONS, TYPE=STRESS\n9, 3, 1., 2., 3., 4., 5., 6.\n"
    found = load(tmp_path, one, step("*NODE PRINT", "U"))
    at_rest = found.point_stress(1, np.zeros((12, 3)))["hex8"]
    np.testing.assert_array_equal(at_rest[1, 2], [1, 2, 3, 4, 6, 5])
    assert np.count_nonzero(at_rest) == 6


def test_redundant_equations_are_legal(tmp_path: Path) -> None:
    tie = "*EQUATION\n2\n13, 1, 1., 22, 1, -1.\n"
    again = "*EQUATION\n2\n22, 1, 3., 13, 1, -3.\n*EQUATION\n2\n11, 1, 1., 14, 1, 1.\n"
    load_ = step("*CLOAD", "22, 1, 3.")
    once = load(tmp_path, tie, load_).solve()[0].u
    twice = load(tmp_path, tie, again, load_).solve()[0].u
    np.testing.assert_allclose(twice, once, atol=1e-12 * np.abs(once).max())


@pytest.mark.parametrize("kind", ["C3D8I", "C3D8"])
def test_formulation_follows_the_element_type(kind: str, tmp_path: Path) -> None:
    text = MODEL.replace("C3D8", kind)
    found = load(tmp_path, step("*CLOAD", "RIGHT, 3, 1."), model=text, fixed=FIXED)
    expected = {"C3D8I": "incompatible", "C3D8": "full"}[kind]
    assert found.formulation == {"hex8": expected}


def test_equations_along_a_slender_body_keep_its_digits() -> None:
    """With residuals of an assembled stiffness a slenderness of 1000 was refused, and 100 was
    5.7e-8 off at a stated 1.8e-8."""
    model = bar((1000.0, 1.0, 0.7), (100, 1, 1))
    assert model.fixed is not None
    model = Model(model.mesh, model.materials, model.fixed, model.load_cases[0])
    wanted = reference_solution(model, {"hex8": "incompatible"}).u[0]
    freed, last = np.array(model.fixed), int(np.flatnonzero(model.fixed[:, 0])[-1])
    freed[last] = False
    held = Equations.build([([3 * last + k], [1.0], 0.0) for k in range(3)], freed.size)
    own = Model(model.mesh, model.materials, freed, model.forces, constraints=[held])
    found = solve(own, backend="numpy", tolerance=1e-8)
    error = np.abs(found.u - wanted).max() / np.abs(wanted).max()
    assert error <= found.error_estimate <= 1e-8


def test_steps_with_the_same_constraints_become_load_cases(tmp_path: Path) -> None:
    skew = "*NSET, NSET=ONE\n12\n*TRANSFORM, NSET=ONE, TYPE=R\n1., 1., 0., -1., 1., 0.\n"
    found = load(
        tmp_path, skew, "*TIE, NAME=T\nSMALL, BIG\n*BOUNDARY\nONE, 1\n",
        step("*CLOAD", "RIGHT, 3, 1."), step("*CLOAD, OP=NEW", "RIGHT, 2, 1."),
        step("*BOUNDARY", "ONE, 1, 1, 0.1"), model=TIED.format(gap="2."),
    )  # fmt: skip
    both = found.model(1, 2)
    assert both.load_cases.shape == (2, 16, 3) and len(both.constraints) == 2
    with pytest.raises(InputError, match="steps 1 and 3 hold different"):
        found.model(1, 3)
    solutions = found.solve(backend="numpy", tolerance=1e-10)
    for k, one in enumerate(solutions[:2]):
        alone = solve(found.model(k + 1), backend="numpy", tolerance=1e-10, formulation="full")
        np.testing.assert_allclose(one.u, alone.u[0], atol=1e-9 * np.abs(alone.u).max())
    moved = solutions[2].u[np.flatnonzero(found.node_labels == 12)[0]]
    assert moved[:2].sum() / np.sqrt(2.0) == pytest.approx(0.1, abs=1e-12)


def test_a_reference_node_takes_a_force(tmp_path: Path) -> None:
    """A node of no element that moves as the mean of two; without an equation it is refused."""
    extra = MODEL.replace("*ELEMENT", "*NODE\n99, 20., 0., 0.\n*ELEMENT", 1)
    mean = "*EQUATION\n3\n99, 3, 2., 22, 3, -1., 13, 3, -1.\n"
    push = step("*CLOAD", "99, 3, 4.")
    (solution,) = load(tmp_path, mean, push, model=extra).solve(backend="numpy", tolerance=1e-10)
    shared = load(tmp_path, step("*CLOAD", "22, 3, 2.", "13, 3, 2.")).solve(tolerance=1e-10)[0]
    np.testing.assert_allclose(solution.u[:12], shared.u, atol=1e-9 * np.abs(shared.u).max())
    with pytest.raises(InputError, match="node 99 belongs to no solid element"):
        load(tmp_path, push, model=extra)
