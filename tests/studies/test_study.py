"""Studies worked off: shared results, the bytes of a run, what goes wrong, and the command."""

from __future__ import annotations

import csv
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from click.testing import Result
from typer.testing import CliRunner

import gpusim as gs
from gpusim.cli import app
from gpusim.errors import InputError, SceneError
from gpusim.files.input_file import InputFile
from gpusim.files.output_folder import claim
from gpusim.graph.graph import Graph
from gpusim.graph.runner import Runner
from gpusim.graph.store import Record, Store
from gpusim.pipeline.stages import measuring
from gpusim.plan.scene_stages import scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.studies import SampleTable, load_study, passing, samples_of
from gpusim.studies.rows import read_rows
from tests.studies.small_studies import STUDY, write_study

Made = tuple[Path, SampleTable]


def run_command(*arguments: object) -> Result:
    """`gpusim` with these arguments."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("study")
    heard: list[float] = []
    table = gs.study(
        write_study(folder), folder / "out", progress=lambda _, done, text: heard.append(done)
    )
    assert heard[0] == 0.0
    assert heard[-1] == 1.0
    return folder, table


def test_results_are_shared(made: Made) -> None:
    folder, table = made
    samples = samples_of(load_study(folder / "study.toml"))
    counts: Counter[str] = Counter()
    for row in read_rows(folder / "out", samples).values():
        counts.update(row["made"])
    # two structures; without load E doesn't matter; noise has a seed
    assert counts["solve"] == 2
    assert counts["measure"] == 8
    assert counts["picture"] == 2 * 2 + 2 * 2 * 2
    assert table["status"].tolist() == ["done"] * 8


def test_numbers_and_bytes_are_those_of_a_run(made: Made, tmp_path: Path) -> None:
    folder, table = made
    study = load_study(folder / "study.toml")
    sample = samples_of(study)[5]
    report = gs.run(sample.scene(study), tmp_path / "run", backend="numpy")
    for item in report.measurements:
        for kind in ("measured", "truth", "error"):
            assert table.of((item.name, item.unit), kind)[5] == getattr(item, kind)
    graph = Graph()
    graph.add(scene_stages(sample.scene(study), RunOptions("numpy")).stages)
    store = Store(folder / "out/.gpusim")
    compared = 0
    for name in ("picture/side", "measure/tip"):
        for key in graph.records[""][name]:
            record = store.find(key)
            assert record is not None
            for file, facts in record.files.items():
                if not file.startswith("."):
                    path = tmp_path / "run" / file
                    assert path.read_bytes() == store.blob(facts.sha256).read_bytes()
                    compared += 1
    assert compared >= 4


def test_a_second_call_makes_nothing(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, table = made

    def never(*_: Any) -> None:
        raise AssertionError("something was made")

    monkeypatch.setattr(Runner, "work", never)
    again = gs.study(folder / "study.toml", folder / "out")
    assert again["tip: scale coefficient error [mm/px]"].tolist() == (
        table["tip: scale coefficient error [mm/px]"].tolist()
    )


def test_tables_hold_every_number(made: Made) -> None:
    folder, table = made
    with (folder / "out/samples.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    stored = pyarrow.parquet.read_table(folder / "out/samples.parquet")
    assert [*rows[0]] == stored.column_names == [*table.columns]
    for name in ("E", "f", "tip: RMS error of all markers measured [mm]"):
        assert (
            [float(row[name]) for row in rows] == stored[name].to_pylist() == table[name].tolist()
        )
    assert len(set(table["tip: RMS error of all markers measured [mm]"].tolist())) == 8
    with pytest.raises(InputError, match="did you mean status"):
        table["statis"]


def test_samples_that_are_the_same_have_one_row(made: Made) -> None:
    folder, table = made
    path = folder / "twice.toml"
    path.write_text(STUDY.replace("29.0, 30.0", "29.0, 29.0").replace("60.0, 70.0", "60.0"))
    for out in ("out", "twice"):
        again = gs.study(path, folder / out)
        assert again["status"].tolist() == ["done"] * 4
        name = "tip: RMS error of all markers measured [mm]"
        assert again[name].tolist() == table[name][[0, 1, 0, 1]].tolist()


def test_a_longer_study_adds_what_is_new(made: Made, tmp_path: Path) -> None:
    folder, _ = made
    longer = folder / "longer.toml"
    longer.write_text(STUDY.replace("29.0, 30.0", "29.0, 30.0, 31.0").replace("60.0, 70.0", "60.0"))
    table = gs.study(longer, folder / "out")
    assert len(table) == 6
    rows = read_rows(folder / "out", samples_of(load_study(longer)))
    assert sum(bool(row["made"].get("solve")) for row in rows.values()) == 1  # by the first study


def test_what_is_wrong_costs_its_own_sample(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = STUDY.replace("repeats = 2", "").replace("29.0, 30.0", "29.0, 6.0, 30.0, 31.0")
    path = write_study(
        tmp_path, text.replace("60.0, 70.0", "60.0") + '[[constraint]]\nexpression = "f < 31"\n'
    )
    tries: list[int] = []
    measure = measuring.measure

    def fails(scene: gs.Scene, *rest: Any) -> Any:
        if scene.cameras[0].focal_mm == 29.0:
            tries.append(1)
            raise RuntimeError("bad luck")
        return measure(scene, *rest)

    monkeypatch.setattr(measuring, "measure", fails)
    table = gs.study(path, tmp_path / "out")
    assert table["status"].tolist() == ["failed", "refused", "done", "refused"]
    assert table["error"][0] == "RuntimeError: bad luck"
    assert "too small for camera 'side'" in table["error"][1]
    assert table["error"][3] == "constraint f < 31"
    assert len(tries) == 3
    assert np.isnan(table["tip: scale coefficient measured [mm/px]"]).tolist() == [1, 1, 0, 1]
    monkeypatch.setattr(measuring, "measure", measure)
    assert gs.study(path, tmp_path / "out")["status"].tolist() == [
        "done",
        "refused",
        "done",
        "refused",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (STUDY.replace("focal_mm", "focal_m"), "did you mean focal_mm"),
        (STUDY + '[[derived]]\nkey = "name"\nvalue = "__import__(\'os\')"\n', "not understood"),
        ("samples = 0\n" + STUDY, "samples: out of range"),
        (STUDY.replace("29.0, 30.0", "29.0, -30.0"), "out of range"),
    ],
)
def test_bad_input_is_one_error_and_leaves_nothing(text: str, words: str, tmp_path: Path) -> None:
    path = write_study(tmp_path / "in", text)
    done = run_command("study", path, "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert words in done.stderr
    assert done.stderr.startswith("error: ")
    assert not (tmp_path / "out").exists()


def test_a_study_file_of_the_user_stays_as_it_is(tmp_path: Path) -> None:
    text = STUDY.replace("repeats = 2", "# mine").replace("29.0, 30.0", "29.0")
    path = write_study(tmp_path, text.replace("60.0, 70.0", "60.0"))
    other = path.with_name("other.toml")
    other.write_text(path.read_text())
    with pytest.raises(InputError, match="would be overwritten"):
        gs.study(other, tmp_path)
    assert gs.study(path, tmp_path)["status"].tolist() == ["done"]
    assert path.read_text() == other.read_text()


def test_one_study_in_a_folder_at_a_time(tmp_path: Path) -> None:
    path = write_study(tmp_path)
    with claim(tmp_path / "out"), pytest.raises(InputError, match="is in use by process"):
        gs.study(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_command_plans_tells_and_runs_one_sample(made: Made) -> None:
    folder, _ = made
    plan = json.loads(run_command("study", folder / "study.toml", "--plan", "--json").stdout)
    assert plan["samples"] == 8
    assert plan["distinct"] == {"meshes": 1, "solutions": 2, "pictures": 12, "measurements": 8}
    gs.study(folder / "study.toml", folder / "out")
    status = json.loads(run_command("study", folder / "out", "--status", "--json").stdout)
    assert status["samples"] == 8
    assert status["status"] == {"done": 8}
    assert not status["running"]
    report = json.loads(
        run_command("study", folder / "out", "--sample", "5", "--json").stdout
    )  # fmt: skip
    states = {stage["name"]: stage["state"] for stage in report["stages"]}
    assert states["solve"] == states["render/side/0001"] == states["measure"] == "reused"
    assert (folder / "out/samples/5/report.html").is_file()
    assert run_command("study", folder / "out", "--sample", "8").exit_code == 2


@pytest.mark.parametrize("workers", [1, 2])
def test_numbers_alone_stay(
    made: Made, tmp_path: Path, workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(passing, "_TOGETHER", 1)
    whole = made[1]
    path = write_study(tmp_path, 'keep = "numbers"\n' + STUDY)
    pictures = [0]

    def count(*_: object) -> None:
        blobs = (tmp_path / "out/.gpusim/blobs").glob("*/*")
        pictures.append(sum(one.read_bytes()[:4] == b"\x89PNG" for one in blobs))

    table = gs.study(path, tmp_path / "out", workers=workers, progress=count)
    assert workers > 1 or 0 < max(pictures) < 12
    assert pictures[-1] == 0
    for name in whole.columns.keys() - {"seconds"}:
        assert table[name].tolist() == whole[name].tolist()
    samples = samples_of(load_study(path))
    counts: Counter[str] = Counter()
    for row in read_rows(tmp_path / "out", samples).values():
        counts.update(row["made"])
    assert (counts["solve"], counts["picture"]) == (2, 12)  # what is shared was there long enough
    graph = Graph()
    graph.add(scene_stages(samples[5].scene(load_study(path)), RunOptions("numpy")).stages)
    store = Store(tmp_path / "out/.gpusim")
    there = {
        name: store.fault(graph.records[""][name][-1], name) is None
        for name in ("solve", "picture/side", "measure/tip")
    }
    assert there == {"solve": True, "picture/side": False, "measure/tip": False}
    pages = [out / "out/report.html" for out in (made[0], tmp_path)]
    assert ['alt="sample' in page.read_text("utf-8") for page in pages] == [True, False]
    logs = [read.read_bytes() for read in (tmp_path / "out/.gpusim/samples").iterdir()]
    gs.study(path, tmp_path / "out")
    assert [read.read_bytes() for read in (tmp_path / "out/.gpusim/samples").iterdir()] == logs
    result = run_command("study", path, "-o", tmp_path / "out", "--sample", 5, "--quiet")
    assert result.exit_code == 0, result.output
    run = gs.run(samples[5].scene(load_study(path)), tmp_path / "run", backend="numpy")
    assert len(run.measurements) > 0
    for name in ("0000.png", "0001.png"):
        picture = tmp_path / "out/samples/5/images/side" / name
        assert picture.read_bytes() == (tmp_path / "run/images/side" / name).read_bytes()


def test_numbers_alone_make_no_data_set(tmp_path: Path) -> None:
    path = write_study(tmp_path, 'keep = "numbers"\n' + STUDY + "[dataset]\n")
    with pytest.raises(SceneError, match=r"keep: leaves no pictures for \[dataset\]"):
        load_study(path)


def test_a_result_that_goes_meanwhile_is_made_again(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, gone = Store.read, list[str]()

    def unlucky(self: Store, record: Record, name: str) -> InputFile:
        if name == "solution/displacement.npz" and not gone:
            gone.append(name)
            self.blob(record.files[name].sha256).unlink()
        return read(self, record, name)

    monkeypatch.setattr(Store, "read", unlucky)
    table = gs.study(write_study(tmp_path), tmp_path / "out")
    assert gone
    assert table["status"].tolist() == ["done"] * 8
    quantity = table.quantities[0]
    assert table.of(quantity).tolist() == made[1].of(quantity).tolist()
