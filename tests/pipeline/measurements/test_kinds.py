"""A kind of measurement that one module registers: scenes, plans, runs and reports know it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import pytest

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.export.images import read_image
from gpusim.pipeline.measurements.kinds import Kind, kind_of, register
from gpusim.pipeline.measurements.results import Result
from gpusim.plan.plan import make_plan
from gpusim.scene import json_schema
from gpusim.scene.description.measure_table import TABLES
from gpusim.scene.description.model import MeasureTable, SceneTable
from gpusim.scene.faults import schema_places
from tests.support.small_scene import DOCUMENT, small_scene

TOY: dict[str, Any] = {"name": "grey", "type": "toy", "camera": "side", "expected_DN": 60.0}
FRAMES: dict[str, Any] = {"analysis": {"load_factors": [0.0, 0.5, 1.0]}, "output": {}}


def scene_of(**changes: Any) -> gs.Scene:
    return small_scene(measure=[*DOCUMENT["measure"], {**TOY, **changes}], **FRAMES)


@pytest.fixture(scope="module", autouse=True)
def registered() -> Iterator[None]:
    """Other tests see gpusim's own kinds."""
    before = dict(TABLES)
    import_module("tests.support.toy_measure")
    yield
    for kind in TABLES.keys() - before.keys():
        del TABLES[kind]
    SceneTable.model_rebuild(force=True)
    schema_places.cached_schema.cache_clear()


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[gs.Report, Path]:
    out = tmp_path_factory.mktemp("kinds") / "out"
    return gs.run(scene_of(), out, backend="numpy"), out


@pytest.mark.drawn
def test_it_is_measured_and_reported(done: tuple[gs.Report, Path]) -> None:
    report, out = done
    images = [read_image(out / "images" / "side" / f"{k:04d}.png") for k in range(3)]
    (row,) = [item for item in report.measurements if item.name == "grey: mean grey value"]
    assert row.measured == images[-1].mean() and row.truth == 60.0
    assert {"measure 'grey': this is a toy",
            "measure 'grey': toys measure 1 surfaces badly"} <= set(report.warnings)  # fmt: skip
    lines = (out / "measure" / "grey.csv").read_text().splitlines()
    assert lines == [
        "frame,camera,measured_DN", *(f"{k},side,{one.mean():.7g}" for k, one in enumerate(images))
    ]  # fmt: skip
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("grey: mean grey value") >= 2  # a row, and a plot
    said = json.loads((out / "report.json").read_text())
    assert {"name", "unit", "measured"} <= said["measurements"][-1].keys()
    assert said["measurements"][-1]["name"] == "grey: mean grey value"


def test_a_rerun_reads_it_again(done: tuple[gs.Report, Path]) -> None:
    first, out = done
    again = gs.run(scene_of(), out, backend="numpy")
    assert [one.name for one in again.stages if one.state == "run"] == ["report"] * any(
        one.name == "report" for one in again.stages
    )
    assert again.measurements == first.measurements and again.warnings == first.warnings


def test_it_is_planned(done: tuple[gs.Report, Path]) -> None:
    _, out = done
    plan = make_plan(scene_of(expected_DN=70.0), out, "numpy")
    states = {stage.name: stage.state for stage in plan.stages}
    assert states["measure"] == "run" and states["render/side/0001"] == "reused"
    assert scene_of().measures[1].pictures(3) == [("side", 0), ("side", 1), ("side", 2)]
    one = small_scene(measure=[TOY], analysis={"load_factors": [1.0]}, output={})
    assert make_plan(one)["measure"].state == "run"  # it needs no reference


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"expectd_DN": 60.0}, "measure.grey.expectd_DN: unknown key (did you mean expected_DN?)"),
        ({"expected_DN": 0.0}, "expected_DN: out of range; got 0.0; expected a number > 0"),
        ({"camera": "sied"}, "camera: no such camera; got \"sied\"; expected one of side"),
        ({"type": "toi"}, "type: unknown value"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(SceneError) as caught:
        scene_of(**changes)
    assert told in str(caught.value)


def test_the_schema_has_it() -> None:
    kinds = json_schema()["properties"]["measure"]["items"]["discriminator"]["mapping"]
    assert {"toy", "deflection", "stereo", "damage"} <= kinds.keys()


def test_a_type_belongs_to_one_kind() -> None:
    class Other(MeasureTable):
        type: Literal["toy"]

    with pytest.raises(InputError, match="'toy' twice"):
        register(Kind(Other, Result))
    assert kind_of(scene_of().measures[1]).result.__name__ == "ToyResult"


def test_another_package_names_the_module_of_its_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    class Point:
        def load(self) -> None:
            class Late(MeasureTable):
                type: Literal["late"]

            register(Kind(Late, Result))

    def points(*, group: str, name: str) -> list[Point]:
        asked.append(f"{group} {name}")
        return [Point()] if name == "late" else []

    monkeypatch.setattr("gpusim.scene.measure_kinds.entry_points", points)
    scene = small_scene(measure=[{"name": "one", "type": "late"}])
    assert scene.measures[0].type == "late" and asked == ["gpusim.measurements late"]
    small_scene(measure=[{"name": "one", "type": "late"}])
    assert len(asked) == 1
