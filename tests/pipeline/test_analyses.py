"""A kind of motion that one module registers: scenes, plans, runs and reports know it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import gpusim as gs
from gpusim.cli import app
from gpusim.errors import InputError, SceneError
from gpusim.plan.plan import make_plan
from gpusim.scene import json_schema
from gpusim.scene.analyses import ANALYSES, add_analysis
from gpusim.scene.description.analysis.analysis_table import TABLES
from gpusim.scene.description.scene_table import SceneTable
from gpusim.scene.faults import schema_places
from gpusim.scene.frames import frame_table
from gpusim.view.content.loading import load_content
from tests.support.small_scene import DOCUMENT, small_scene

ANGLES = [0.0, 0.01, 0.02]
BAR: dict[str, Any] = {**DOCUMENT["body"][0], "load": [], "support": []}


def scene_of(angles: list[float] = ANGLES, **changes: Any) -> gs.Scene:
    analysis = {"type": "swing", "load_factors": angles}
    return small_scene(analysis=analysis, body=[BAR], **changes)


@pytest.fixture(scope="module", autouse=True)
def registered() -> Iterator[None]:
    """Other tests see gpusim's own kinds."""
    assert "swing" not in ANALYSES
    import_module("tests.support.toy_analysis")
    with pytest.raises(InputError, match="got 'swing' twice"):
        add_analysis("swing", ANALYSES["static"])
    yield
    del ANALYSES["swing"], TABLES["swing"]
    SceneTable.model_rebuild(force=True)
    schema_places.cached_schema.cache_clear()


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[gs.Report, Path]:
    out = tmp_path_factory.mktemp("swing") / "out"
    return gs.run(scene_of(), out, backend="numpy"), out


def states(plan_or_report: Any) -> dict[str, str]:
    return {stage.name: stage.state for stage in plan_or_report.stages}


def test_it_is_planned() -> None:
    plan = make_plan(scene_of(), backend="numpy")
    reasons = {stage.name: stage.reason for stage in plan.stages if stage.state == "skipped"}
    assert reasons == dict.fromkeys(("model", "solve", "stress"), "bodies only swing")
    assert states(plan)["render/side/0002"] == "run"
    (last,) = [stage for stage in plan.stages if stage.name == "render/side/0002"]
    assert "load x 0.02" in last.detail
    assert [instant.shown.unloaded for instant in frame_table(scene_of())] == [True, False, False]


def test_bodies_move_as_it_says(done: tuple[gs.Report, Path]) -> None:
    report, out = done
    # the marker at the end is 230 mm away from the axis
    tip = report.measurements[0]
    assert report.status == "done" and report.solution is None
    fall = 5.0 - 5.0 * np.cos(ANGLES[-1]) + 230.0 * np.sin(ANGLES[-1])
    assert abs(tip.truth - fall) <= 1e-6 * fall
    assert abs(tip.measured - fall) <= 0.01
    said = json.loads((out / "report.json").read_text())
    assert {"solve", "render/side/0001", "truth"} <= {one["name"] for one in said["stages"]}
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "bodies only swing" in page and "load factor 0 and 0.02" in page


def test_a_second_run_reuses_what_is_equal(done: tuple[gs.Report, Path]) -> None:
    first, out = done
    again = gs.run(scene_of(), out, backend="numpy")
    assert {name for name, state in states(again).items() if state == "run"} <= {"report"}
    assert again.measurements == first.measurements
    plan = states(make_plan(scene_of([0.0, 0.01, 0.03]), out, "numpy"))
    assert [plan[f"render/side/000{frame}"] for frame in range(3)] == ["reused", "reused", "run"]


def test_a_plan_of_it_builds_no_model(tmp_path: Path) -> None:
    """A body that nothing holds is no fault where nothing is solved."""
    (tmp_path / "swing.toml").write_text(scene_of().to_toml())
    result = CliRunner().invoke(app, ["plan", str(tmp_path / "swing.toml")])
    assert result.exit_code == 0 and "bar: valid" in result.stdout, result.stderr


def test_schema_and_messages_name_it() -> None:
    kinds = ["static", "field", "modal", "transient", "harmonic", "buckling", "swing"]
    schema: Any = json_schema()["properties"]["analysis"]
    assert sorted(schema["discriminator"]["mapping"]) == sorted(kinds)
    with pytest.raises(SceneError, match=r'"swing" \(rigid\)'):
        small_scene(analysis={"type": "spin"})
    with pytest.raises(SceneError, match=r'times: unknown key.*a key of "field"'):
        small_scene(analysis={"type": "swing", "times": [0.0, 1.0]})


def test_a_window_has_nothing_to_solve(tmp_path: Path) -> None:
    (tmp_path / "swing.toml").write_text(scene_of().to_toml())
    content = load_content(tmp_path / "swing.toml")
    assert not content.is_solvable and not content.unloaded
