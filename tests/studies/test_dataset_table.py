"""``[dataset]``: what is wrong in it is told before any work."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpusim.errors import InputError, SceneError
from gpusim.studies import load_study
from tests.support.stretched_bar import write_study

PARAMETERS = """
backend = "numpy"
[[parameter]]
key = "sensor.seed"
list = [0, 1]
[dataset]
"""


def test_what_labels_need_is_added_to_the_scene(tmp_path: Path) -> None:
    text = PARAMETERS + 'labels = ["depth", "flow", "poses"]\n'
    path = write_study(tmp_path, text, output={"truth": ["depth", "region"], "stl": True})
    output = load_study(path).scene.output
    assert output.truth == ("depth", "region", "flow")
    assert output.labels and output.stl


@pytest.mark.parametrize(
    ("table", "fault"),
    [
        ('labels = ["flw"]', "dataset.labels.0"),
        ("splits = { train = 0.5, test = 0.4 }", "shares don't add up"),
        ("splits = { train = 1.5, test = -0.5 }", "dataset.splits"),
        ("crops = 3", "crop_px"),
        ("crop_px = [0, 4]", "dataset.crop_px.0"),
        ("shards = 0", "dataset.shards"),
        ("flow_format = 'exr'", "dataset.flow_format"),
        (
            "cameras = ['side']",
            r"cameras; got \['side'\]; expected some of \['front'\]",
        ),
        ("crop_px = [97, 4]", r"crop_px, camera 'front'; got 97 x 4; expected at most 96 x 48"),
    ],
)
def test_bad_tables_are_refused_before_any_work(table: str, fault: str, tmp_path: Path) -> None:
    with pytest.raises((InputError, SceneError), match=fault):
        load_study(write_study(tmp_path, PARAMETERS + table))
