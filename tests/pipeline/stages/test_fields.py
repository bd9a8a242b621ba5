"""Pictures of fields in a run: which there are, when they are made again; the load path."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.export.images import read_image
from gpusim.gpu import Device
from gpusim.plan.decision import decide, states_of
from gpusim.plan.stages import RunOptions
from tests.support.report_figures import figures_drawn
from tests.support.small_scene import DOCUMENT, small_scene

FACTORS = [0.0, 0.25, 0.5, 1.0]


def plain(**changes: Any) -> gs.Scene:
    """Without what is measured or written."""
    return small_scene(**{"measure": [], "output": {}, "analysis": {"load_factors": FACTORS}}
                       | changes)  # fmt: skip


def will_draw(scene: gs.Scene, out: Path) -> bool:
    decision = decide(states_of(scene), out, RunOptions("gpu"))
    (key,) = decision.graph.records[""]["fields"]
    return decision.graph.tasks[key].runs


@pytest.fixture(scope="module")
def done(device: Device, tmp_path_factory: pytest.TempPathFactory) -> tuple[gs.Report, Path]:
    out = tmp_path_factory.mktemp("fields")
    with figures_drawn():
        return gs.run(plain(), out, backend="gpu"), out


def test_pictures_and_their_numbers(done: tuple[gs.Report, Path]) -> None:
    report, out = done
    found = {one.field: one for one in report.fields}
    assert list(found) == ["displacement", "von_mises", "principal_strain_1"]
    solution = gs.solve(plain())
    length = 1e3 * np.linalg.norm(solution.u, axis=1)
    one = found["displacement"]
    assert one.largest == pytest.approx(length.max(), rel=1e-9) and one.unit == "mm"
    node = 1e-3 * np.array(one.position_mm)
    where = np.linalg.norm(solution.model.mesh.points - node, axis=1).argmin()
    assert length[where] == pytest.approx(length.max())
    stress = gs.fem.stress(solution.model, solution.u)
    assert found["von_mises"].largest == pytest.approx(1e-6 * stress.von_mises.max(), rel=1e-9)
    assert one.frame == 3 and one.factor > 1.0
    assert report.highlights["Largest displacement"][0] == f"{length.max():.3f} mm"
    for item in found.values():
        assert read_image(out / item.file).shape[1:] == (1280, 3)
    told = json.loads((out / "report.json").read_text("utf-8"))
    assert [row["file"] for row in told["fields"]] == [row.file for row in report.fields]


def test_the_load_path_is_that_of_the_load(done: tuple[gs.Report, Path]) -> None:
    path = done[0].load_path
    assert path is not None and path.held and path.frames == (0, 1, 2, 3)
    np.testing.assert_allclose(path.reaction_N, 50.0 * np.array(FACTORS), atol=1e-6)
    most = 1e3 * np.linalg.norm(gs.solve(plain()).u, axis=1).max()
    np.testing.assert_allclose(path.displacement_mm, most * np.array(FACTORS), rtol=1e-6)
    assert path.stiffness == pytest.approx(50.0 / most, rel=1e-6)
    assert (done[1] / "figures/load-path.png").is_file()


def test_they_are_drawn_again_for_what_they_show_alone(done: tuple[gs.Report, Path]) -> None:
    _, out = done
    assert not will_draw(plain(), out)
    assert not will_draw(plain(sensor={"seed": 7}), out)
    paint = copy.deepcopy(DOCUMENT["body"])
    paint[0]["paint"][0]["albedo"] = 0.2
    assert not will_draw(plain(body=paint), out)
    load = copy.deepcopy(DOCUMENT["body"])
    load[0]["load"][0]["force_N"] = [0.0, 0.0, -60.0]
    assert will_draw(plain(body=load), out)
    moved = copy.deepcopy(DOCUMENT["camera"])
    moved[0]["position_mm"] = [120.0, -900.0, 300.0]
    assert will_draw(plain(camera=moved), out)


def test_who_does_not_want_them_has_none(device: Device, tmp_path: Path) -> None:
    report = gs.run(plain(output={"fields": False}), tmp_path, backend="gpu")
    assert report.fields == () and report.load_path is None
    assert not (tmp_path / "fields").exists() and not report.highlights


def test_large_meshes_show_stress_only_when_asked(
    device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gpusim.pipeline.stages.fields.CHEAP_CELLS", 5)
    report = gs.run(plain(), tmp_path, backend="gpu")
    assert [one.field for one in report.fields] == ["displacement"]
    assert report.facts["fields"].startswith("no stress or strain of 24 elements: [output] stress")
    report = gs.run(plain(output={"stress": True}), tmp_path, backend="gpu")
    assert len(report.fields) == 3 and "fields" not in report.facts


def test_what_has_not_moved_is_not_drawn(device: Device, tmp_path: Path) -> None:
    """Two loads cancel each other."""
    body = copy.deepcopy(DOCUMENT["body"])
    push = body[0]["load"][0]
    body[0]["load"].append({**push, "name": "pull", "force_N": [0.0, 0.0, 50.0]})
    report = gs.run(plain(body=body, camera=[]), tmp_path, backend="gpu")
    assert report.fields == () and report.load_path is None and not report.highlights


def test_without_a_device_there_are_numbers_but_no_pictures(tmp_path: Path) -> None:
    report = gs.run(plain(camera=[]), tmp_path, backend="numpy")
    assert report.fields == () and report.load_path is not None


def test_the_load_of_a_body_that_a_support_moves_is_that_support_s(
    device: Device, tmp_path: Path
) -> None:
    """Together the two grips of a tensile test hold each other; metal that yields leaves the
    dashed line of linear theory."""
    material = [{**DOCUMENT["material"][0], "type": "j2", "yield_stress_MPa": 40.0,
                 "hardening_MPa": 500.0}]  # fmt: skip
    body = copy.deepcopy(DOCUMENT["body"])
    clamp = body[0]["support"][0]
    pull = {"name": "grip", "where": {"set": "x_max"}, "displacement_mm": [0.3, 0.0, 0.0]}
    body[0] |= {"support": [clamp, pull], "load": []}
    analysis = {"load_factors": [0.0, 0.1, 1.0]}
    made = plain(material=material, body=body, camera=[], analysis=analysis)
    path = gs.run(made, tmp_path, backend="gpu").load_path
    assert path is not None and path.support == "grip" and path.held
    np.testing.assert_allclose(path.displacement_mm, [0.0, 0.03, 0.3], rtol=1e-9)
    np.testing.assert_allclose(path.linear_mm, path.displacement_mm, rtol=1e-9)
    _, elastic, flowing = path.reaction_N
    assert elastic == pytest.approx(path.linear_N[1], rel=1e-3) and elastic > 0.0
    assert flowing < 0.6 * path.linear_N[2]


@pytest.mark.parametrize(("force", "bends"), [(50.0, True), (1.0, False)])
def test_of_a_steady_vibration_the_phase_that_moves_most(
    force: float, bends: bool, device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At resonance it is a quarter of a period late: at phase 0 next to nothing has moved."""
    steady = {"type": "harmonic", "frequencies_Hz": [143.5, 400.0], "phases": 4,
              "damping": {"ratio": 0.02}}  # fmt: skip
    body = copy.deepcopy(DOCUMENT["body"])
    body[0]["load"][0]["force_N"] = [0.0, 0.0, -force]
    scene = plain(analysis=steady, body=body, camera=[])
    report = gs.run(scene, tmp_path, backend="gpu")
    bar = scene.solution()["bar"]
    moved = [1e3 * np.linalg.norm(bar.displacement(k), axis=1).max() for k in range(9)]
    assert max(moved) > 2.0 * moved[1]
    frames = {1 + int(np.argmax(moved[1:5])), 5 + int(np.argmax(moved[5:9]))}
    shown = [one for one in report.fields if one.field == "displacement"]
    assert {one.frame for one in shown} == frames
    value, place = report.highlights["Largest displacement"]
    most = int(np.argmax(moved))
    assert float(value.split()[0]) == pytest.approx(moved[most], rel=1e-3)
    assert place.startswith(f"frame {most}, bar at ") and "phase 90 deg" in place
    told = [text for text in report.warnings if "linear theory makes it" in text]
    assert [text.startswith("body 'bar': it turns by up to ") for text in told] == [True] * bends
    # of one picture alone it is the frame of all that moves most
    monkeypatch.setattr("gpusim.plan.scene_stages._MOST_PICTURED", 1)
    late = scene.replace("analysis.frequencies_Hz", [400.0, 143.5])
    report = gs.run(late, tmp_path / "late", backend="gpu")
    assert {one.frame for one in report.fields} == {most + 4}
