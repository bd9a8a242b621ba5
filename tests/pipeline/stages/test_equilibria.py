"""Bodies at large displacements: from a scene's text to its output folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, NotConverged, SceneError
from gpusim.motion import Stepped, Superposed
from gpusim.pipeline.stages.equilibria import SMALL
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from gpusim.scene.frames import frame_table
from tests.pipeline.stages.test_mechanics import (
    CLAMP,
    DOWN,
    LINEAR,
    STEEL,
    displacement,
    fields,
    scene,
)

FAR = {**DOWN, "force_N": [0.0, 0.0, -2000.0]}
METAL = {**STEEL, "type": "j2", "yield_stress_MPa": 250.0, "hardening_MPa": 2000.0}
PULLED = [CLAMP, {**CLAMP, "name": "pull", "where": {"set": "x_max"},
                  "displacement_mm": [1.0, 0.0, 0.0]}]  # fmt: skip


def statics(report: gs.Report) -> dict[str, str]:
    return {name: fact for name, fact in report.facts.items() if "statics" in name}


def elastica(force: float) -> float:
    """Deflection over length of a cantilever with F L^2 / E I = ``force`` at its tip, by its
    elliptic integrals (Bisshopp & Drucker 1945)."""
    from scipy.optimize import brentq
    from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

    def phase(k: float) -> float:
        return float(np.arcsin(1.0 / (k * np.sqrt(2.0))))

    k = brentq(lambda k: ellipk(k * k) - ellipkinc(phase(k), k * k) - np.sqrt(force),
               np.sqrt(0.5) + 1e-12, 1.0 - 1e-12)  # fmt: skip
    return float(1.0 - 2.0 / np.sqrt(force) * (ellipe(k * k) - ellipeinc(phase(k), k * k)))


def test_auto_is_nonlinear_where_linear_theory_is_too_far_off(tmp_path: Path) -> None:
    """A thin strip of aluminium bends as the elastica; a small load leaves it linear."""
    strip = {**STEEL, "poissons_ratio": 0.0}
    mesh = {"builder": "box", "size_mm": [240.0, 4.0, 2.0], "divisions": [60, 1, 1]}
    stiffness = 200e9 * 0.004 * 0.002**3 / 12.0 / 0.24**2  # E I / L^2
    tips = []
    for number, force in enumerate((0.05, 1.0)):
        load = {**DOWN, "force_N": [0.0, 0.0, -force * stiffness]}
        made = scene(material=strip, mesh=mesh, load=[load], factors=[0.0, 0.5, 1.0])
        report = gs.run(made, tmp_path / str(number), backend="numpy")
        ((name, fact),) = statics(report).items()
        assert name == ("nonlinear statics, bar" if number else "linear statics, bar")
        u = displacement(tmp_path / str(number), 2)
        tips.append(float(-u[:, 2].min() / 0.24))
        assert not displacement(tmp_path / str(number), 0).any()
    linear, displaced = tips
    assert abs(linear - 0.05 / 3.0) <= 1e-3 * linear
    assert abs(displaced - elastica(1.0)) <= 2e-3 * displaced
    assert "by linear theory it turns by up to" in fact
    content = json.loads((tmp_path / "1" / "report.json").read_text())
    steps = content["mechanics"]["load_steps"]
    assert [one["frame"] for one in steps] == [1, 2] and steps[1]["iterations"] >= 2
    assert steps[1]["linear_mm"] == pytest.approx(80.0, rel=2e-3)
    # what is stored is force times way, less the way summed over the force
    x, weight = np.polynomial.legendre.leggauss(3)
    stored = displaced - 0.5 * weight @ [elastica(0.5 + 0.5 * one) for one in x]
    assert steps[1]["stored_J"] == pytest.approx(stiffness * 0.24 * stored, rel=3e-3)
    assert steps[1]["work_J"] == pytest.approx(steps[1]["stored_J"], rel=0.05)
    path = content["load_path"]
    assert path["linear_mm"][1:] == pytest.approx([40.0, 80.0], rel=0.02)
    assert path["displacement_mm"][2] < 0.95 * path["linear_mm"][2]
    (reaction,) = content["mechanics"]["reactions"]
    assert reaction["force_N"] == pytest.approx([0.0, 0.0, stiffness], abs=1e-5 * stiffness)
    assert "Newton&#39;s method" in (tmp_path / "1" / "report.html").read_text()


def test_what_is_asked_for_is_done(tmp_path: Path) -> None:
    for geometry, motion in (("linear", Superposed), ("nonlinear", Stepped)):
        made = scene(load=[FAR], analysis={"geometry": geometry})
        report = gs.run(made, tmp_path / geometry, backend="numpy")
        (fact,) = statics(report).values()
        assert fact.startswith("asked for" if motion is Stepped else "turns by up to")
        assert (tmp_path / geometry / "solution" / "steps.npz").exists() == (motion is Stepped)
        # a warning of what linear theory is off by, where it was asked for
        assert bool(report.warnings) == (motion is Superposed)
    far, near = (displacement(tmp_path / name, 1) for name in ("linear", "nonlinear"))
    difference = np.abs(far - near).max() / np.abs(far).max()
    assert SMALL < difference < 0.1
    # the linear solution itself is the same, to the last bit
    first, second = (
        (tmp_path / name / "solution" / "displacement.npz").read_bytes()
        for name in ("linear", "nonlinear")
    )
    assert first == second


def test_equal_frames_are_solved_once_and_in_order(tmp_path: Path) -> None:
    report = gs.run(scene(load=[FAR], factors=[0.0, 1.0, 0.5, 1.0, 0.0]), tmp_path, backend="numpy")
    assert report.mechanics is not None
    assert [one.frame for one in report.mechanics.load_steps] == [1, 2]
    np.testing.assert_array_equal(displacement(tmp_path, 1), displacement(tmp_path, 3))
    assert not displacement(tmp_path, 4).any()


def test_stress_is_kept_of_what_is_looked_at(tmp_path: Path) -> None:
    made = scene(load=[FAR], factors=[0.0, 0.5, 1.0])
    gs.run(made, tmp_path, backend="numpy")
    stressed = made.replace("output.stress", True)
    assert make_plan(stressed, tmp_path, "numpy")["solve"].runs
    gs.run(stressed, tmp_path / "stressed", backend="numpy")
    for folder, steps in ((tmp_path, ["1"]), (tmp_path / "stressed", ["0", "1"])):
        with np.load(folder / "solution" / "steps.npz") as stored:
            names = [name for name in stored.files if name.startswith("stress_")]
            assert [name.split("_")[1] for name in names] == steps
            assert stored["u0"].shape[0] == 2


def test_loads_with_amplitudes_of_their_own_add_up_before_they_act(tmp_path: Path) -> None:
    """Two loads in one frame are one load of their sum."""
    down = {**FAR, "amplitude": [0.0, 1.0, 1.0]}
    aside = {**FAR, "name": "aside", "force_N": [0.0, 900.0, 0.0], "amplitude": [0.0, 0.0, 1.0]}
    gs.run(scene(load=[down, aside], factors=[0.0, 0.5, 1.0]), tmp_path / "two", backend="numpy")
    both = {**FAR, "force_N": [0.0, 900.0, -2000.0]}
    gs.run(scene(load=[both]), tmp_path / "one", backend="numpy")
    u = displacement(tmp_path / "two", 2)
    assert np.abs(u - displacement(tmp_path / "one", 1)).max() <= 1e-7 * np.abs(u).max()


def test_metal_that_has_yielded_is_another_body_when_loads_come_back(tmp_path: Path) -> None:
    made = scene(material=METAL, support=PULLED, load=[], stress=True,
                 factors=[0.0, 0.5, 1.0, 1.0, 0.5, 0.0])  # fmt: skip
    states = [shown.states[0] for shown in (one.shown for one in frame_table(made))]
    assert states == [None, (0.5, 1.0), (1.0, 1.0), (1.0, 1.0), (0.5, 2.0), (0.0, 1.0)]
    report = gs.run(made, tmp_path, backend="numpy")
    (fact,) = statics(report).values()
    assert fact.startswith("linear theory doesn't know material 'steel'")
    data = [fields(tmp_path, frame).point_data for frame in range(6)]
    plastic = [one["plastic_strain"].max() if "plastic_strain" in one else 0.0 for one in data]
    assert plastic[0] == 0.0 < plastic[1] < plastic[2] == plastic[3] < plastic[5]
    # unloaded, it is pressed
    (held,) = [one for one in report.mechanics.reactions if one.name == "pull"]  # type: ignore[union-attr]
    assert held.force[0] < -1e4
    # the ends are held sideways, the middle strains a little more
    assert 1.0 <= np.median(data[2]["strain"][:, 0]) / np.log(1.0 + 1.0 / 240.0) <= 1.1
    (peak,) = report.mechanics.stresses  # type: ignore[union-attr]
    assert peak.von_mises == pytest.approx(data[5]["von_mises"].max())


def test_metal_without_way_back_is_told_by_its_loads() -> None:
    made = scene(material=METAL, support=PULLED, load=[], factors=[0.0, 0.5, 1.0])
    assert [one.shown.states[0] for one in frame_table(made)] == [None, (0.5,), (1.0,)]


def test_pressure_that_follows_turns_with_the_body(tmp_path: Path) -> None:
    """A strip under pressure: its resultant turns, and by linear theory it doesn't."""
    mesh = {"builder": "box", "size_mm": [240.0, 10.0, 2.0], "divisions": [24, 1, 1]}
    reactions = []
    for follows in (False, True):
        load = {"name": "wind", "type": "pressure", "where": {"normal": "+z"},
                "pressure_MPa": 0.02, "follows": follows}  # fmt: skip
        made = scene(mesh=mesh, load=[load])
        report = gs.run(made, tmp_path / str(follows), backend="numpy")
        assert report.mechanics is not None
        (total,) = (one.force for one in report.mechanics.loads)
        (held,) = (one.force for one in report.mechanics.reactions)
        np.testing.assert_allclose(held, -np.array(total), atol=1e-4 * 48.0)
        reactions.append(held)
    (dead, _, down), (along, _, up) = reactions
    assert abs(dead) <= 1e-4 * down and down == pytest.approx(48.0, rel=1e-6)
    assert abs(along) >= 0.1 * up


def test_heat_turns_with_the_body(tmp_path: Path) -> None:
    """Heated while it is bent, a strip gets longer along itself."""
    heat = {"name": "heat", "type": "thermal", "temperature_change_K": 400.0}
    tips = []
    for load in ([FAR], [FAR, heat]):
        gs.run(scene(load=load), tmp_path / str(len(load)), backend="numpy")
        tips.append(displacement(tmp_path / str(len(load)), 1)[-1])
    longer = np.linalg.norm([0.24, 0.0, 0.0]) * 400.0 * 1e-5
    change = tips[1] - tips[0]
    assert abs(np.linalg.norm(change) - longer) <= 0.1 * longer


@pytest.mark.parametrize(
    ("changes", "key", "problem"),
    [
        ({"material": METAL, "analysis": LINEAR}, "body.bar.material", "linear theory"),
        ({"load": [{"name": "p", "type": "pressure", "where": {"set": "z_max"},
                    "pressure_MPa": 1.0, "follows": True}], "analysis": LINEAR},
         "body.bar.load.p.follows", "nothing turns"),
        ({"material": METAL, "mesh": {"builder": "box", "size_mm": [20.0, 20.0, 10.0],
                                      "divisions": [1, 1, 1], "cells": "tet4"}},
         "body.bar.mesh.cells", "constant volume"),
        ({"material": {**METAL, "hardening_MPa": [[0.0, 240.0]]}}, "hardening_MPa", "begin"),
        ({"material": {**METAL, "hardening_MPa": [[0.0, 250.0], [0.1, 240.0]]}},
         "hardening_MPa", "falls"),
        ({"material": {**METAL, "saturation_MPa": 300.0}}, "saturation_rate", "without"),
        ({"material": {**METAL, "saturation_MPa": 200.0, "saturation_rate": 9.0}},
         "saturation_MPa", "below"),
        ({"material": {**STEEL, "yield_stress_MPa": 200.0}}, "yield_stress_MPa", "doesn't yield"),
        ({"material": {**STEEL, "type": "j2"}}, "yield_stress_MPa", "missing"),
    ],
)  # fmt: skip
def test_what_is_refused_when_it_is_read(changes: Any, key: str, problem: str) -> None:
    with pytest.raises(SceneError) as raised:
        scene(**changes)
    text = str(raised.value)
    assert key in text and problem in text and text.count("\n") == 1


def test_metal_in_elements_that_cannot_flow_is_refused_with_the_model(tmp_path: Path) -> None:
    mesh = {"builder": "box", "size_mm": [240.0, 20.0, 10.0], "divisions": [6, 2, 2],
            "cells": "hex20"}  # fmt: skip
    made = scene(material=METAL, mesh=mesh)
    with pytest.raises(InputError, match=r"24 of hex20 \('full'\); expected .*\"reduced\""):
        gs.run(made, tmp_path, backend="numpy")
    document = made.document
    document["body"][0]["formulation"] = "reduced"
    gs.run(Scene.from_document(document), tmp_path, backend="numpy")


def test_a_frame_without_equilibrium_is_named(tmp_path: Path) -> None:
    """A bar of perfectly plastic metal carries 20 x 10 mm2 x 250 MPa = 50 kN and no more."""
    soft = {**METAL, "poissons_ratio": 0.0, "hardening_MPa": 0.0}
    pull = {**DOWN, "force_N": [60e3, 0.0, 0.0]}
    mesh = {"builder": "box", "size_mm": [240.0, 20.0, 10.0], "divisions": [1, 1, 1]}
    made = scene(material=soft, load=[pull], mesh=mesh, factors=[0.0, 0.5, 0.7, 1.0])
    with pytest.raises(NotConverged, match=r"body 'bar', frame 3 \(load 1\)") as raised:
        gs.run(made, tmp_path, backend="numpy")
    assert "load_factors of frames 0 to 2" in str(raised.value)
    assert not (tmp_path / "solution" / "steps.npz").exists()
    assert json.loads((tmp_path / "report.json").read_text())["status"] == "failed"
    shorter = made.replace("analysis.load_factors", [0.0, 0.5, 0.7])
    assert gs.run(shorter, tmp_path, backend="numpy").status == "done"


def test_geometry_is_part_of_what_results_depend_on(tmp_path: Path) -> None:
    auto = scene(load=[FAR])
    gs.run(auto, tmp_path, backend="numpy")
    for geometry in ("linear", "nonlinear"):
        plan = make_plan(auto.replace("analysis.geometry", geometry), tmp_path, "numpy")
        assert plan["export"].runs
    for same in (auto, auto.replace("analysis.frame_rate_Hz", 50.0)):
        assert not make_plan(same, tmp_path, "numpy")["solve"].runs
    stressed = auto.replace("output.stress", True)
    assert not make_plan(stressed, tmp_path, "numpy")["solve"].runs
    more = auto.replace("analysis.load_factors", [0.0, 0.5, 1.0])
    assert make_plan(more, tmp_path, "numpy")["solve"].runs
    nonlinear = make_plan(auto.replace("analysis.geometry", "nonlinear"))["solve"]
    assert "nonlinear, 1 load steps" in nonlinear.detail
    assert "nonlinear if the linear solution is too far off" in make_plan(auto)["solve"].detail
    assert nonlinear.seconds > 3.0 * make_plan(auto)["solve"].seconds


def test_a_scene_as_an_object_moves_as_its_run_does(tmp_path: Path) -> None:
    made = scene(load=[FAR])
    gs.run(made, tmp_path, backend="numpy")
    solution = made.solution()["bar"]
    np.testing.assert_array_equal(solution.displacement(1), displacement(tmp_path, 1))
    assert solution.reactions(1)[0] == pytest.approx([0.0, 0.0, 2000.0], abs=1e-3)


def test_a_scene_is_solved_as_its_frames_are(tmp_path: Path) -> None:
    made = scene(load=[FAR], factors=[0.0, 0.5, 1.0, 0.5], analysis={"geometry": "nonlinear"})
    gs.run(made, tmp_path, backend="numpy")
    steps = gs.solve(made, backend="numpy").steps
    assert [step.factors.tolist() for step in steps] == [[0.5], [1.0]]
    np.testing.assert_array_equal(steps[1].u, displacement(tmp_path, 2))
    assert gs.solve(made.replace("analysis.geometry", "auto"), backend="numpy").steps == ()


def test_a_modulus_that_is_meant_otherwise_is_asked_about(tmp_path: Path) -> None:
    soft = {**STEEL, "youngs_modulus_GPa": 0.2}  # MPa taken for GPa: F L^3 / 3 E I is 691 mm
    report = gs.run(scene(material=soft), tmp_path, backend="numpy")
    (question,) = (text for text in report.warnings if "units" in text)
    assert "by linear theory displacements differ by 680 mm in frame 1" in question
    way_out = 'Then say [analysis] geometry = "nonlinear"'
    assert question.endswith(f"are units, loads and moduli meant so? {way_out}")


def test_a_body_that_is_stretched_as_it_bends_is_found(tmp_path: Path) -> None:
    """Held at both ends it turns by a third of a degree, and linear theory is 4 % too far."""
    mesh = {"builder": "box", "size_mm": [240.0, 10.0, 2.0], "divisions": [48, 2, 2]}
    where = {"x_min_mm": 119.0, "x_max_mm": 121.0}
    push = {**DOWN, "type": "nodal_force", "where": where}
    far = {**CLAMP, "name": "far", "where": {"set": "x_max"}}
    moved = []
    for number, force in enumerate((0.1, 1.0)):
        load = {**push, "force_N": [0.0, 0.0, -force]}  # on each of 9 nodes
        made = scene(mesh=mesh, support=[CLAMP, far], load=[load])
        report = gs.run(made, tmp_path / str(number), backend="numpy")
        ((name, _),) = statics(report).items()
        assert name.startswith("nonlinear" if number else "linear")
        moved.append(float(np.abs(displacement(tmp_path / str(number), 1)).max()))
    assert 0.95 <= moved[1] / (10.0 * moved[0]) <= 0.975


def test_a_column_beyond_eulers_load_is_told_of_and_one_with_a_push_buckles(tmp_path: Path) -> None:
    strip = {**STEEL, "poissons_ratio": 0.0}
    mesh = {"builder": "box", "size_mm": [240.0, 4.0, 2.0], "divisions": [30, 1, 1]}
    euler = (0.5 * np.pi) ** 2 * 200e9 * 0.004 * 0.002**3 / 12.0 / 0.24**2
    straight = {**DOWN, "force_N": [-1.5 * euler, 0.0, 0.0]}
    pushed = {**DOWN, "force_N": [-1.5 * euler, 0.0, 1.5e-3 * euler]}
    made = scene(material=strip, mesh=mesh, load=[straight], analysis={"geometry": "nonlinear"})
    report = gs.run(made, tmp_path / "straight", backend="numpy")
    assert "isn't stable" in " ".join(report.warnings)
    made = scene(material=strip, mesh=mesh, load=[pushed])
    report = gs.run(made, tmp_path / "pushed", backend="numpy")
    assert list(statics(report)) == ["nonlinear statics, bar"]
    assert "isn't stable" not in " ".join(report.warnings)
    # elastica: z / L = 2 k / K with K(k) = pi / 2 sqrt(1.5); corners of the end turn beside it
    end = displacement(tmp_path / "pushed", 1)[:, 2].max()
    assert end == pytest.approx(0.7886 * 0.24, rel=0.01)
