"""Loads over time, stress, reactions: from a scene's text to its output folder."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.fem import von_mises
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from gpusim.scene.amplitudes import load_groups
from tests.support.scene_models import scene_model

Float = npt.NDArray[np.float64]

STEEL = {
    "name": "steel", "youngs_modulus_GPa": 200.0, "poissons_ratio": 0.3, "density_kg_m3": 8000.0,
    "expansion_per_K": 1e-5,
}  # fmt: skip
CLAMP = {"name": "clamp", "where": {"set": "x_min"}, "fix": ["x", "y", "z"]}
LINEAR = {"geometry": "linear"}
DOWN = {"name": "down", "type": "force", "where": {"set": "x_max"}, "force_N": [0.0, 0.0, -50.0]}
ASIDE = {"name": "aside", "type": "force", "where": {"set": "x_max"}, "force_N": [0.0, 30.0, 0.0]}


def scene(**changes: Any) -> Scene:
    """A clamped bar of 240 x 20 x 10 mm without a camera."""
    materials = [copy.deepcopy(changes.get("material", STEEL)), *changes.get("others", [])]
    document: dict[str, Any] = {
        "schema": 1,
        "name": "bar",
        "material": materials,
        "body": [
            {
                "name": "bar",
                "material": changes.get("material", STEEL)["name"],
                "mesh": changes.get("mesh", {
                    "builder": "box", "size_mm": [240.0, 20.0, 10.0], "divisions": [12, 2, 2],
                }),
                "part": changes.get("part", []),
                "support": copy.deepcopy(changes.get("support", [CLAMP])),
                "load": copy.deepcopy(changes.get("load", [DOWN])),
                "paint": [{"name": "grey", "type": "plain", "albedo": 0.5}],
            }
        ],
        "analysis": {"load_factors": changes.get("factors", [0, 1]), **changes.get("analysis", {})},
        "solver": {"tolerance": 1e-9},
        "output": {"vtu": True, "stress": changes.get("stress", False)},
    }  # fmt: skip
    return Scene.from_document(document)


def fields(out: Path, frame: int) -> meshio.Mesh:
    return meshio.read(out / "solution" / f"bar-{frame:04d}.vtu")


def displacement(out: Path, frame: int) -> Float:
    u: Float = fields(out, frame).point_data["u"]
    return u


def test_forces_and_stress_reach_the_report(tmp_path: Path) -> None:
    factors = [0.0, 0.5, 1.0, 0.0]
    report = gs.run(scene(stress=True, factors=factors), tmp_path, backend="numpy")
    content = json.loads((tmp_path / "report.json").read_text())["mechanics"]
    assert content["frame"] == 2 and 0.0 <= content["energy_balance"] <= 1e-9
    (load,), (reaction,) = content["loads"], content["reactions"]
    assert load == {"body": "bar", "force_N": pytest.approx([0.0, 0.0, -50.0], abs=1e-9)}
    assert reaction["support"] == "clamp"
    assert reaction["force_N"] == pytest.approx([0.0, 0.0, 50.0], abs=1e-6)
    (peak,) = content["stress"]
    # the beam's M c / I is 36 MPa at the clamp, 34.5 MPa in the middle of the first element
    assert 34e6 <= peak["von_mises_Pa"] <= 50e6 and peak["position_m"][0] <= 0.02
    assert 0.02 <= peak["error_relative"] <= 0.3
    assert report.mechanics is not None
    page = (tmp_path / "report.html").read_text()
    assert "Greatest von Mises stress" in page and "<td>clamp</td>" in page
    half, full = fields(tmp_path, 1), fields(tmp_path, 2)
    stress = full.point_data["stress"]
    np.testing.assert_allclose(stress, 2.0 * half.point_data["stress"], rtol=1e-9, atol=1.0)
    np.testing.assert_allclose(full.point_data["von_mises"], von_mises(stress), rtol=1e-12)
    assert full.point_data["von_mises"].max() == pytest.approx(peak["von_mises_Pa"])
    (share,) = full.cell_data["error_share"]
    assert np.sqrt((share**2).sum()) == pytest.approx(peak["error_relative"])
    assert not fields(tmp_path, 0).point_data["stress"].any()
    # in the middle, away from clamp and load: M c / I with the bar's exact distribution
    middle = np.isclose(full.points[:, 0], 0.12)
    expected = 50.0 * 0.12 * (full.points[middle, 2] - 0.005) / (0.02 * 0.01**3 / 12.0)
    np.testing.assert_allclose(stress[middle, 0], expected, rtol=2e-3, atol=2e4)
    again = gs.run(scene(stress=True, factors=factors), tmp_path, backend="numpy")
    assert {s.name: s.state for s in again.stages}["stress"] == "reused"
    assert again.mechanics == report.mechanics


def test_stress_is_skipped_and_said_so(tmp_path: Path) -> None:
    report = gs.run(scene(), tmp_path, backend="numpy")
    (stage,) = (s for s in report.stages if s.name == "stress")
    assert (stage.state, stage.reason) == ("skipped", "not asked for: [output] stress is false")
    assert set(fields(tmp_path, 1).point_data) == {"u"}
    assert report.mechanics is not None and report.mechanics.stresses == ()
    # asked for later: nothing is solved again
    more = gs.run(scene(stress=True), tmp_path, backend="numpy")
    states = {s.name: s.state for s in more.stages}
    assert (states["solve"], states["stress"], states["export"]) == ("reused", "run", "run")
    assert "stress" in fields(tmp_path, 1).point_data


def test_loads_with_their_own_amplitudes_add_up(tmp_path: Path) -> None:
    down = {**DOWN, "amplitude": [0.0, 1.0, 0.0, 1.0, -1.0]}
    aside = {**ASIDE, "amplitude": [0.0, 0.0, 1.0, 2.0, 0.5]}
    both = scene(load=[down, aside], factors=[0.0, 1.0, 2.0, 3.0, 4.0], stress=True)
    report = gs.run(both, tmp_path / "both", backend="numpy")
    u = [displacement(tmp_path / "both", frame) for frame in range(5)]
    size = np.abs(u[3]).max()
    assert not u[0].any() and np.abs(u[1]).max() > 0.1 * size
    assert np.abs(u[1] + 2.0 * u[2] - u[3]).max() <= 1e-14 * size
    # against one solve of the combined load
    push = {**DOWN, "force_N": [0.0, 15.0, 50.0]}
    gs.run(scene(load=[push]), tmp_path / "one", backend="numpy")
    one = displacement(tmp_path / "one", 1)
    assert np.abs(one - u[4]).max() <= 1e-8 * np.abs(one).max()
    assert report.mechanics is not None
    assert report.mechanics.loads[0].force == pytest.approx((0.0, 15.0, 50.0), abs=1e-9)
    assert report.mechanics.reactions[0].force == pytest.approx((0.0, -15.0, -50.0), abs=1e-6)
    stress = fields(tmp_path / "both", 3).point_data["stress"]
    parts = [fields(tmp_path / "both", frame).point_data["stress"] for frame in (1, 2)]
    np.testing.assert_allclose(stress, parts[0] + 2.0 * parts[1], rtol=1e-9, atol=1.0)


def test_a_moved_support_has_its_own_amplitude(tmp_path: Path) -> None:
    press = {"name": "press", "where": {"set": "x_max"}, "fix": ["z"],
             "displacement_mm": [0.0, 0.0, -2.0], "amplitude": [0.0, 1.0, 0.5]}  # fmt: skip
    aside = {**ASIDE, "amplitude": [0.0, 0.0, 1.0]}
    moved = scene(support=[CLAMP, press], load=[aside], factors=[0.0, 1.0, 1.0])
    report = gs.run(moved, tmp_path, backend="numpy")
    u = [displacement(tmp_path, frame) for frame in range(3)]
    end = np.isclose(fields(tmp_path, 0).points[:, 0], 0.24)
    np.testing.assert_allclose(u[1][end, 2], -2e-3, rtol=1e-12)
    np.testing.assert_allclose(u[2][end, 2], -1e-3, rtol=1e-12)
    assert np.abs(u[1][end, 1]).max() <= 1e-4 * 2e-3 < np.abs(u[2][end, 1]).max()
    assert report.mechanics is not None
    clamp, held = (np.array(item.force) for item in report.mechanics.reactions)
    np.testing.assert_allclose(clamp + held, [0.0, -30.0, 0.0], atol=1e-5)
    # 3 E I w / L^3 for w = 1 mm
    assert held[2] == pytest.approx(-3 * 200e9 * 0.02 * 0.01**3 / 12 * 1e-3 / 0.24**3, rel=0.03)


def test_linear_statics_bent_too_far_is_warned_of(tmp_path: Path) -> None:
    soft = {**STEEL, "youngs_modulus_GPa": 0.2}  # MPa taken for GPa: F L^3 / 3 E I is 691 mm
    (warning,) = gs.run(scene(material=soft, analysis=LINEAR), tmp_path, backend="numpy").warnings
    assert "differ by 680 mm in frame 1, 282 % of its size" in warning
    assert gs.run(scene(), tmp_path, backend="numpy").warnings == ()


def test_collinear_amplitudes_are_scaled_not_solved() -> None:
    twice = {**ASIDE, "amplitude": [0.0, 2.0, 3.0]}
    none = {**ASIDE, "name": "none", "amplitude": [0.0, 0.0, 0.0]}
    made = scene(load=[DOWN, twice, none], factors=[0.0, 1.0, 1.5])
    (group,) = load_groups(made.bodies[0], made.analysis.load_factors)
    assert group.loads == ((0, 1.0), (1, 2.0)) and group.amplitude == (0.0, 1.0, 1.5)
    model = scene_model(made)
    np.testing.assert_allclose(model.load_cases[0].sum(axis=0), [0.0, 60.0, -50.0], atol=1e-12)
    apart = scene(load=[DOWN, {**ASIDE, "amplitude": [0.0, 2.0, 3.1]}], factors=[0.0, 1.0, 1.5])
    assert len(load_groups(apart.bodies[0], apart.analysis.load_factors)) == 2
    assert gs.solve(apart, backend="numpy").u.shape[0] == 2


def test_scaling_loads_does_not_change_the_answer(tmp_path: Path) -> None:
    twice = {**ASIDE, "amplitude": [0.0, 2.0, -1.0]}
    made = scene(load=[DOWN, twice], factors=[0.0, 1.0, -0.5], stress=True)
    for name, skip in (("scaled", True), ("solved", False)):
        gs.run(made, tmp_path / name, backend="numpy", skip=skip)
        with np.load(tmp_path / name / "solution" / "displacement.npz") as stored:
            assert len(stored["u0"]) == (1 if skip else 2)
    for frame in (1, 2):
        one, two = (fields(tmp_path / name, frame).point_data for name in ("scaled", "solved"))
        assert np.abs(one["u"] - two["u"]).max() <= 1e-8 * np.abs(one["u"]).max()
        assert np.abs(one["stress"] - two["stress"]).max() <= 1e-7 * np.abs(one["stress"]).max()


def test_what_an_amplitude_changes(tmp_path: Path) -> None:
    def plan_of(amplitude: list[float], force: float = -50.0) -> dict[str, str]:
        load = {**DOWN, "amplitude": amplitude, "force_N": [0.0, 0.0, force]}
        plan = make_plan(scene(load=[load, ASIDE], analysis=LINEAR), tmp_path, "numpy")
        return {stage.name: stage.state for stage in plan.stages}

    first = scene(load=[{**DOWN, "amplitude": [1.0, 0.0]}, ASIDE], analysis=LINEAR)
    gs.run(first, tmp_path, backend="numpy")
    assert plan_of([1.0, 0.0])["solve"] == plan_of([1.0, 0.0])["export"] == "reused"
    assert plan_of([1.0, 0.5])["solve"] == "reused" and plan_of([1.0, 0.5])["export"] == "run"
    assert plan_of([1.0, 0.0], -51.0)["solve"] == "run"
    # now a multiple of the load factors: another group
    assert plan_of([0.0, 3.0])["solve"] == "run"


def test_the_amplitude_of_a_load_alone_solves_nothing_again(tmp_path: Path) -> None:
    def alone(amplitude: list[float]) -> Scene:
        # each a multiple of the factors
        return scene(load=[{**DOWN, "amplitude": amplitude}], analysis=LINEAR)

    gs.run(alone([0.0, 0.5]), tmp_path, backend="numpy")
    half = displacement(tmp_path, 1)
    report = gs.run(alone([0.0, 0.75]), tmp_path, backend="numpy")
    assert {stage.name: stage.state for stage in report.stages}["solve"] == "reused"
    np.testing.assert_allclose(displacement(tmp_path, 1), 1.5 * half, rtol=1e-12)


def test_nothing_moves_with_amplitudes_of_zero(tmp_path: Path) -> None:
    still = scene(load=[{**DOWN, "amplitude": [0.0, 0.0]}], stress=True)
    plan = make_plan(still, tmp_path, "numpy")
    assert plan["solve"].state == plan["stress"].state == "skipped"
    assert plan["solve"].reason == "every load factor is 0"
    moving = scene(load=[{**DOWN, "amplitude": [0.0, 1.0]}], factors=[0.0, 0.0])
    assert make_plan(moving, tmp_path, "numpy")["solve"].state == "run"


def test_heat(tmp_path: Path) -> None:
    """Symmetry planes leave free expansion; the far end held, s = -E a dT."""
    planes = [
        {"name": f"plane-{axis}", "type": "symmetry", "where": {"set": f"{axis}_min"}}
        for axis in "xyz"
    ]
    warm = {"name": "warm", "type": "thermal", "temperature_change_K": 50.0,
            "amplitude": [0.0, 1.0, 0.5]}  # fmt: skip
    made = scene(support=planes, load=[warm], factors=[0.0, 0.0, 0.0], stress=True)
    report = gs.run(made, tmp_path / "free", backend="numpy")
    grid = fields(tmp_path / "free", 1)
    np.testing.assert_allclose(grid.point_data["u"], 5e-4 * grid.points, atol=1e-12)
    half = displacement(tmp_path / "free", 2)
    np.testing.assert_allclose(half, 2.5e-4 * grid.points, atol=1e-12)
    assert report.mechanics is not None
    assert report.mechanics.stresses[0].von_mises <= 100.0  # Pa, of 100 MPa if held
    wall = {"name": "wall", "where": {"set": "x_max"}, "fix": ["x"]}
    held = scene(support=[*planes, wall], load=[warm], factors=[0.0, 0.0, 0.0], stress=True)
    report = gs.run(held, tmp_path / "held", backend="numpy")
    stress = fields(tmp_path / "held", 1).point_data["stress"]
    np.testing.assert_allclose(stress[:, 0], -200e9 * 1e-5 * 50.0, rtol=1e-6)
    assert report.mechanics is not None
    wall_force = {f.name: f.force for f in report.mechanics.reactions}["wall"]
    assert wall_force[0] == pytest.approx(-50e6 * 2e-4, rel=1e-6)


def test_rotation_lines_and_orthotropic_bodies(tmp_path: Path) -> None:
    wood = {
        "name": "wood", "type": "orthotropic", "youngs_modulus_GPa": [12.0, 0.9, 0.5],
        "poissons_ratio": [0.4, 0.5, 0.02], "shear_modulus_GPa": [0.7, 0.06, 0.6],
        "density_kg_m3": 500.0, "axis_1": [0.0, 0.0, 2.0], "axis_2": [1.0, 0.0, 0.5],
        "expansion_per_K": [4e-6, 3e-5, 5e-5],
    }  # fmt: skip
    spin = {"name": "spin", "type": "centrifugal", "axis_point_mm": [-60.0, 10.0, 0.0],
            "axis": [0.0, 0.0, 1.0], "speed_rpm": 600.0}  # fmt: skip
    line = {"name": "line", "type": "line_force", "force_N": [0.0, 0.0, -7.0],
            "where": {"x_min_mm": 240.0, "z_min_mm": 10.0}}  # fmt: skip
    made = scene(material=wood, load=[spin, line])
    model = scene_model(made)
    omega = 600.0 * 2.0 * np.pi / 60.0
    mass = 500.0 * 0.24 * 0.02 * 0.01
    expected = [mass * omega**2 * 0.18, 0.0, -7.0]
    np.testing.assert_allclose(model.load_cases[0].sum(axis=0), expected, rtol=1e-12, atol=1e-9)
    (material,) = model.materials
    assert isinstance(material, gs.Orthotropic)
    np.testing.assert_allclose(material.axes, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)
    compliance = np.linalg.inv(material.stiffness())
    np.testing.assert_allclose(1e-9 / np.diag(compliance)[:3], [0.9, 0.5, 12.0], rtol=1e-12)
    np.testing.assert_allclose(compliance[0, 2], -0.4 / 12e9, rtol=1e-12)
    np.testing.assert_allclose(material.expansion_strain()[:3], [3e-5, 5e-5, 4e-6], rtol=1e-12)
    report = gs.run(made, tmp_path, backend="numpy")
    assert report.solution is not None and report.solution.converged
    assert Scene.from_document(made.document) == made


def test_a_bimetal_strip_bends(tmp_path: Path) -> None:
    """Timoshenko (1925): curvature 3/2 (difference of expansion) dT / h for equal layers."""
    brass = {**STEEL, "name": "brass", "expansion_per_K": 2e-5}
    planes = [
        {"name": f"plane-{axis}", "type": "symmetry", "where": {"set": f"{axis}_min"}}
        for axis in "xy"
    ]
    foot = {"name": "foot", "where": {"x_max_mm": 0.0, "y_max_mm": 0.0, "z_max_mm": 0.0},
            "fix": ["z"]}  # fmt: skip
    strip = {"builder": "box", "size_mm": [100.0, 5.0, 2.0], "divisions": [50, 2, 4]}
    heat = {"name": "heat", "type": "thermal", "temperature_change_K": 100.0}
    made = scene(
        others=[brass], mesh=strip, support=[*planes, foot], load=[heat], stress=True,
        part=[{"material": "brass", "where": {"z_max_mm": 1.0}}],
    )  # fmt: skip
    report = gs.run(made, tmp_path, backend="numpy")
    grid = fields(tmp_path, 1)
    line = np.isclose(grid.points[:, 1], 0.0) & np.isclose(grid.points[:, 2], 0.0)
    x, w = grid.points[line, 0], grid.point_data["u"][line, 2]
    order = np.argsort(x)
    curvature = 1.5 * 1e-5 * 100.0 / 2e-3
    # brass below: the strip curls up
    assert w[order[-1]] - w[order[0]] == pytest.approx(0.5 * curvature * 0.1**2, rel=0.01)
    # outside: half of E d(alpha) dT in the layer less 3/4 of it in bending; more where the width
    # hinders, about 1 / (1 - nu) of it
    inner = np.isclose(grid.points[:, 0], 0.04) & np.isclose(grid.points[:, 1], 0.0)
    top = inner & np.isclose(grid.points[:, 2], 2e-3)
    stress = grid.point_data["stress"][top, 0]
    assert -55e6 / 0.7 <= stress <= -48e6 and report.mechanics is not None
    assert np.abs(report.mechanics.loads[0].force).max() <= 1e-6
    with pytest.raises(gs.InputError, match="part 0 of 'brass': where: no elements found; got "):
        part = {"material": "brass", "where": {"z_min_mm": 11.0}}
        scene_model(scene(others=[brass], part=[part]))
    with pytest.raises(gs.InputError, match="unknown set of elements; got 'core'"):
        part = {"material": "brass", "where": {"set": "core"}}
        scene_model(scene(others=[brass], part=[part]))


def test_faults_in_supports_and_loads_name_their_place() -> None:
    round_plane = {"name": "plane", "type": "symmetry", "where": {"x_max_mm": 40.0}}
    with pytest.raises(gs.InputError, match=r"'plane': symmetry: the .* aren't in one plane"):
        scene_model(scene(support=[CLAMP, round_plane]))
    area = {"name": "line", "type": "line_force", "where": {"set": "x_max"}, "force_N": [1.0, 0, 0]}
    with pytest.raises(gs.InputError, match="load 'line': line_force: the nodes form an area"):
        scene_model(scene(load=[area]))
    first = {"name": "first", "where": {"set": "x_max"}, "fix": ["z"],
             "displacement_mm": [0.0, 0.0, 1.0], "amplitude": [0.0, 1.0]}  # fmt: skip
    second = {**first, "name": "second", "amplitude": [0.0, 2.0]}
    with pytest.raises(gs.InputError, match=r"support 'second': 9 of its nodes .*'first'"):
        scene_model(scene(support=[CLAMP, first, second]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"load": [{**DOWN, "amplitude": [1.0]}]},
         r"body.[a-z]+.load.[a-z]+.amplitude: not one factor per frame.*1 factors.*2, as many"),
        ({"load": [{"name": "t", "type": "thermal", "temperature_change_K": 1.0}],
          "material": {**STEEL, "expansion_per_K": 0.0}}, "without thermal expansion"),
        ({"load": [{"name": "c", "type": "centrifugal", "speed_rpm": 1.0}],
          "material": {**STEEL, "density_kg_m3": 0.0}}, "rotation of a material without density"),
        ({"load": [{"name": "c", "type": "centrifugal", "speed_rpm": 1.0, "axis": [0.0, 0, 0]}]},
         "axis: has no direction"),
        ({"part": [{"material": "wood", "where": {"x_max_mm": 1.0}}]},
         "part.0.material: no such material"),
        ({"part": [{"material": "steel", "where": {"normal": "+x"}}]}, "which look nowhere"),
        ({"part": [{"material": "steel", "where": {}}]}, "selects the whole body"),
        ({"support": [{**CLAMP, "amplitude": [0.0, 1.0]}]}, "of a support that doesn't move"),
        ({"support": [{**CLAMP, "type": "symmetry", "fix": ["x"]}]}, "given for a symmetry"),
        ({"material": {**STEEL, "poissons_ratio": 0.5}}, "poissons_ratio: out of range"),
        ({"material": {**STEEL, "youngs_modulus_GPa": "stiff"}}, "a number > 0, or a list"),
        ({"material": {**STEEL, "youngs_modulus_GPa": [1.0, 2.0, 3.0]}},
         "three numbers for an isotropic"),
        ({"material": {**STEEL, "shear_modulus_GPa": [1.0, 2.0, 3.0]}},
         "given for an isotropic material"),
        ({"material": {**STEEL, "type": "orthotropic"}}, "one number for an orthotropic"),
    ],
)  # fmt: skip
def test_faults_of_the_file(change: dict[str, Any], words: str) -> None:
    with pytest.raises(gs.SceneError, match=words):
        scene(**change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"shear_modulus_GPa": None}, "shear_modulus_GPa: missing"),
        ({"poissons_ratio": [0.3, 0.3, 0.3]}, "nu31 makes the stiffness indefinite"),
        ({"youngs_modulus_GPa": [1.0, 1.0, 1.0], "poissons_ratio": [0.6, 0.6, 0.6]},
         "makes the stiffness indefinite"),
        ({"axis_1": [0.0, 0.0, 0.0]}, "axis_1: has no direction"),
        ({"axis_2": [-2.0, 0.0, 0.0]}, "axis_2: parallel to axis_1"),
    ],
)  # fmt: skip
def test_faults_of_orthotropic_materials(change: dict[str, Any], words: str) -> None:
    wood: dict[str, Any] = {
        "name": "wood", "type": "orthotropic", "youngs_modulus_GPa": [12.0, 0.9, 0.5],
        "poissons_ratio": [0.4, 0.5, 0.02], "shear_modulus_GPa": [0.7, 0.06, 0.6],
    }  # fmt: skip
    wood = {key: value for key, value in {**wood, **change}.items() if value is not None}
    with pytest.raises(gs.SceneError, match=words):
        scene(material=wood)


def test_the_bimetal_example_is_measured_right(checkout: Path, tmp_path: Path) -> None:
    """Images of a heated strip against Timoshenko's formula, and against the elements."""
    report = gs.run(gs.load_scene(checkout / "examples" / "bimetal.toml"), tmp_path)
    tip = report.measurements[0]
    theory = 0.5 * 0.525 * 0.098**2 * 1e3
    assert tip.measured == pytest.approx(theory, rel=3e-3)
    assert abs(tip.error) <= 1e-3 * tip.truth
    assert report.mechanics is not None
    # in both layers E d(alpha) dT / 2 = 70 MPa, hindered in the width as well: over 1 - nu
    assert report.mechanics.stresses[0].von_mises == pytest.approx(100e6, rel=0.12)
    assert report.warnings == ()
