"""Samples: what they change, and the keys of their rows."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.studies import load_study, samples_of
from tests.studies.small_studies import FOCAL, STUDY, YOUNG, write_study

DERIVED = """[[derived]]
key = "camera.side.position_mm"
value = ["30", "-10 * f", 5.0]
[[derived]]
key = "camera.side.resolution_px"
value = ["2 * 48", "1.6 * f"]
[[constraint]]
expression = "f < 30 or E > 65"
"""


def test_a_sample_changes_what_its_point_says(tmp_path: Path) -> None:
    samples = samples_of(load_study(write_study(tmp_path, STUDY + DERIVED)))
    assert [one.number for one in samples] == list(range(8))
    assert [one.repeat for one in samples] == [0, 1] * 4
    assert samples[1].overrides == {
        YOUNG: 60.0, FOCAL: 29.0, "camera.side.position_mm": [30, -290, 5.0],
        "camera.side.resolution_px": [96, 46.400000000000006], "sensor.seed": 1,
    }  # fmt: skip
    assert samples[7].overrides["camera.side.resolution_px"] == [96, 48]
    assert [bool(one.refused) for one in samples] == [False, False, True, True] + [False] * 4


def test_its_scene_is_that_of_set(tmp_path: Path) -> None:
    study = load_study(write_study(tmp_path))
    for sample in samples_of(study):
        direct = gs.load_scene(tmp_path / "bar.toml", sample.overrides)
        assert sample.scene(study) == direct
        assert sample.scene(study).files == direct.files


def test_a_file_that_a_sample_names_is_found_and_counts(tmp_path: Path) -> None:
    text = '[[parameter]]\nkey = "body.bar.mesh.file"\nlist = ["bar.inp", "other.inp"]\n'
    path = write_study(tmp_path, f'scene = "bar.toml"\nbackend = "numpy"\n{text}')
    (tmp_path / "other.inp").write_text((tmp_path / "bar.inp").read_text() + "** other\n")
    study = load_study(path)
    before = samples_of(study)
    assert [Path(file).name for file, _ in before[1].scene(study).files] == ["other.inp"]
    (tmp_path / "other.inp").write_text((tmp_path / "bar.inp").read_text() + "** changed\n")
    after = samples_of(study)
    assert after[0].key == before[0].key
    assert after[1].key != before[1].key
    table = 'key = "body.bar.mesh"\nlist = [{ file = "other.inp", unit = "mm" }]\n'
    path.write_text(f'scene = "bar.toml"\nbackend = "numpy"\n[[parameter]]\n{table}')
    study, keys = load_study(path), set[str]()
    for number in range(2):  # in a table, and by a file that it names
        (tmp_path / "other.inp").write_text("*INCLUDE, INPUT=inner.inp\n")
        (tmp_path / "inner.inp").write_text((tmp_path / "bar.inp").read_text() + f"** {number}\n")
        keys.add(samples_of(study)[0].key)
    assert len(keys) == 2


def test_keys_tell_all_that_results_depend_on(tmp_path: Path) -> None:
    study = load_study(write_study(tmp_path))
    keys = [one.key for one in samples_of(study)]
    assert len(set(keys)) == 8
    assert keys == [one.key for one in samples_of(load_study(tmp_path / "study.toml"))]
    longer = replace(study, tables=study.tables.model_copy(update={"repeats": 3}))
    assert set(keys) < {one.key for one in samples_of(longer)}
    for other in (replace(study, backend="gpu"),
                  replace(study, scene=study.scene.replace("solver.tolerance", 1e-5))):  # fmt: skip
        assert not set(keys) & {one.key for one in samples_of(other)}


@pytest.mark.parametrize(
    ("text", "words"),
    [('[[derived]]\nkey = "a"\nvalue = "f < 1"\n', "is a comparison; expected a number"),
     ('[[constraint]]\nexpression = "f + 1"\n', "a number; expected a comparison"),
     ('[[constraint]]\nexpression = "g < 1"\n', "unknown name; got g"),
     ('[[derived]]\nkey = "a"\nvalue = "__import__(\'os\')"\n', "not understood")],
)  # fmt: skip
def test_wrong_expressions_are_refused(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        samples_of(load_study(write_study(tmp_path, STUDY + text)))


def test_whole_numbers_are_given_as_such(tmp_path: Path) -> None:
    path = write_study(tmp_path, STUDY + '[[derived]]\nkey = "solver.tolerance"\nvalue = 5\n')
    assert type(samples_of(load_study(path))[0].overrides["solver.tolerance"]) is int


@pytest.mark.parametrize(
    ("text", "words"),
    [("list = [1979-05-27]", "a date"), ('list = [1.0]\nname = "error"', "another column")],
)
def test_parameters_that_no_table_holds_are_refused(text: str, words: str, tmp_path: Path) -> None:
    path = write_study(tmp_path, f'scene = "bar.toml"\n[[parameter]]\nkey = "{FOCAL}"\n{text}\n')
    with pytest.raises((InputError, SceneError), match=words):
        load_study(path)


def test_a_key_that_cannot_be_counted_up_is_refused(tmp_path: Path) -> None:
    path = write_study(tmp_path, 'seeds = ["sensor.format"]\n' + STUDY)
    with pytest.raises(InputError, match=r"seeds: sensor\.format; got 'png'"):
        samples_of(load_study(path))


def test_ten_thousand_take_no_time(tmp_path: Path) -> None:
    study = load_study(write_study(tmp_path, STUDY.replace("repeats = 2", "repeats = 2500")))
    start = time.process_time()
    assert len(samples_of(study)) == 10_000
    assert time.process_time() - start < 3.0
