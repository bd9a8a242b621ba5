"""What a study would make, beside what the graph of all of its samples has; and its refusals."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError, SceneError
from gpusim.graph.graph import Graph
from gpusim.plan.scene_stages import scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.studies import load_study, samples_of, study_plan
from gpusim.studies.plan import check_samples
from tests.studies.small_studies import FOCAL, STUDY, write_study

MORE = """[[parameter]]
key = "body.bar.load.push.force_N"
list = [[0, 0, -900], [0, 0, -950], [0, 0, -990]]
"""


def test_distinct_results_are_those_of_one_graph_of_all(tmp_path: Path) -> None:
    study = load_study(write_study(tmp_path, STUDY + MORE))
    samples = samples_of(study)
    graph = Graph()
    for sample in samples:
        graph.add(scene_stages(sample.scene(study), RunOptions("numpy")).stages, str(sample.number))
    counts = Counter(task.stage.name.split("/")[0] for task in graph.tasks.values())
    plan = study_plan(study, samples)
    assert dict(plan.distinct) == {
        "meshes": counts["mesh"], "solutions": counts["solve"], "pictures": counts["picture"],
        "measurements": counts["measure"],
    }  # fmt: skip
    assert plan.samples == len(samples) == 24
    same = [graph.records[str(sample.number)]["solve"][0] for sample in samples]
    for k, structure in enumerate(plan.structures):
        assert [key == same[k] for key in same] == (plan.structures == structure).tolist()


def test_ten_thousand_samples_are_planned_at_once(tmp_path: Path) -> None:
    text = STUDY.replace("repeats = 2", "repeats = 2500")
    study = load_study(write_study(tmp_path, text))
    start = time.process_time()
    samples = samples_of(study)
    check_samples(study, samples)
    plan = study_plan(study, samples)
    assert time.process_time() - start < 5.0
    assert plan.distinct["solutions"] == 2
    assert plan.distinct["measurements"] == 10_000
    assert len(np.unique(plan.structures)) == 2


def test_shaders_are_compiled_once_and_radiance_is_exposed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GPUSIM_NO_CACHE", "1")  # reference costs

    def seconds(focals: int, repeats: int, backend: str) -> float:
        parameter = f'key = "{FOCAL}"\nlist = {[29.0 + 0.01 * k for k in range(focals)]}\n'
        head = f'scene = "bar.toml"\nbackend = "{backend}"\nrepeats = {repeats}\n'
        study = load_study(write_study(tmp_path, f"{head}[[parameter]]\n{parameter}"))
        return study_plan(study, samples_of(study)).seconds

    one, many, repeated = (
        [seconds(*counts, backend) for backend in ("numpy", "gpu")]
        for counts in ((1, 1), (101, 1), (1, 101))
    )
    assert many[1] - one[1] == pytest.approx(many[0] - one[0]) and one[1] > one[0] + 1.0
    # two pictures more of each sample: 0.1 s each to render, half of it to expose again
    assert many[0] - repeated[0] == pytest.approx(200 * 0.05, rel=0.01)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('key = "camera.side.focal_m"\nlist = [30.0]', "(did you mean focal_mm?)"),
        ('key = "camera.front.focal_mm"\nlist = [30.0]', "no such item"),
        (f'key = "{FOCAL}"\nlist = [30.0, -1.0]', "out of range"),
        (f'key = "{FOCAL}"\nlist = [30.0, "long"]', "without quotes"),
        ('key = "sensor.bits"\nuniform = [6.0, 9.0]', "expected one of 8"),
    ],
)
def test_values_that_a_key_never_takes_are_refused(text: str, words: str, tmp_path: Path) -> None:
    samples = "samples = 8\n" if "uniform" in text else ""
    study = load_study(
        write_study(
            tmp_path, f'scene = "bar.toml"\nbackend = "numpy"\n{samples}[[parameter]]\n{text}\n'
        )
    )
    with pytest.raises(SceneError) as caught:
        check_samples(study, samples_of(study))
    assert words in str(caught.value)


@pytest.mark.parametrize("key", ["camera.0.focal_mm", "camera.0", "camera.side"])
def test_a_key_that_overwrites_another_is_refused(key: str, tmp_path: Path) -> None:
    value = "29.0" if key.endswith("mm") else "{}"
    study = load_study(
        write_study(tmp_path, STUDY + f'[[parameter]]\nkey = "{key}"\nlist = [{value}]\n')
    )
    with pytest.raises(InputError, match=f"{key} overwrites {FOCAL}"):
        check_samples(study, samples_of(study))


def test_what_is_wrong_beside_other_values_alone_is_left_to_the_samples(tmp_path: Path) -> None:
    text = STUDY + (
        '[[parameter]]\nkey = "body.bar.paint.1.name"\nlist = ["side", "other"]\n'
        '[[parameter]]\nkey = "measure.tip.groups"\nlist = [["side"], ["other"]]\n'
    )
    study = load_study(write_study(tmp_path, text))
    samples = samples_of(study)
    check_samples(study, samples)
    samples[0].scene(study)
    with pytest.raises(SceneError, match="other"):
        samples[2].scene(study)
