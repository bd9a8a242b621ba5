"""Study files: bad ones end in one clear error."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpusim.errors import GpusimError
from gpusim.scene import load_scene
from gpusim.studies import load_study
from gpusim.studies.study_tables import study_text
from tests.studies.small_studies import FOCAL, STUDY, write_study

ONE = f'[[parameter]]\nkey = "{FOCAL}"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sample = 3", "sample: unknown key (line 2) (did you mean samples?)"),
        ("samples = 0", "samples: out of range (line 2); got 0; expected a whole number from 1"),
        ("samples = 4", "samples: doesn't fit the parameters"),
        ('design = "sobl"', "(did you mean sobol?)"),
        (ONE, "not one kind of values"),
        (ONE + "list = [1.0]\nuniform = [1.0, 2.0]", 'got "list and uniform"'),
        (ONE + "list = []", "parameter.0.list: wrong length"),
        ("samples = 4\n" + ONE + "uniform = [2.0, 1.0]", "isn't a range"),
        ("samples = 4\n" + ONE + "normal = [2.0, 0.0]", "has no width"),
        ("samples = 4\n" + ONE + "log_uniform = [0.0, 1.0]", "has no logarithm"),
        ("samples = 4\n" + ONE + "uniform = [1.0, 2.0]\nlow = 1.5", "cuts off nothing"),
        ("samples = 4\n" + ONE + "uniform = [1.0, nan]", "finite number"),
        (ONE + "uniform = [1.0, 2.0]", "expected a number of points"),
        (ONE + 'list = [1.0]\nname = "sqrt"', "is a function of expressions"),
        (ONE + 'list = [1.0]\nname = "a-b"', "not a usable name"),
        (ONE + "list = [1.0]\n" + ONE + "list = [1.0]", "stands twice"),
        ("samples = 3\nsensitivity = true\n" + ONE + "uniform = [1.0, 2.0]", "not a power of 2"),
        ("sensitivity = true\n" + ONE + "list = [1.0]", "takes distributions alone"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(text: str, words: str, tmp_path: Path) -> None:
    path = write_study(tmp_path, f'scene = "bar.toml"\n{text}\n')
    with pytest.raises(GpusimError) as caught:
        load_study(path)
    assert words in str(caught.value)
    assert caught.value.exit_code == 2


def test_a_scene_and_a_study_are_told_apart(tmp_path: Path) -> None:
    """By one line, whichever stands in place of the other."""
    path = write_study(tmp_path)
    with pytest.raises(GpusimError, match=r"bar\.toml: a scene, no study; expected a file with"):
        load_study(tmp_path / "bar.toml")
    with pytest.raises(
        GpusimError, match=r"1 fault\n  scene: is that of a study; expected .*gpusim study"
    ):
        load_scene(path)


def test_a_scene_that_is_none_and_one_with_variants(tmp_path: Path) -> None:
    path = write_study(tmp_path)
    path.write_text(STUDY.replace("bar.toml", "car.toml"))
    with pytest.raises(GpusimError, match="not found"):
        load_study(path)
    path.write_text(STUDY)
    with (tmp_path / "bar.toml").open("a") as stream:
        stream.write('[[variant]]\nname = "a"\n')
    with pytest.raises(GpusimError, match="scene has variants; got a"):
        load_study(path)


def test_the_copy_of_a_study_says_the_same_anywhere(tmp_path: Path) -> None:
    loaded = load_study(write_study(tmp_path / "there"))
    copy = tmp_path / "copy.toml"
    copy.write_text(study_text(loaded))
    again = load_study(copy)
    assert again.scene == loaded.scene
    assert again.tables.parameter == loaded.tables.parameter
    assert study_text(again) == study_text(loaded)
