"""Tables of times beside videos."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.files.recording import read_times, times_file, write_times

HEAD = "frame,time_s,line_time_s\n"


def test_times_come_back_to_the_last_digit(tmp_path: Path) -> None:
    times = np.array([0.1, 1 / 3, 0.7000000000000001])
    for place in (tmp_path / "film.mkv", tmp_path):
        file = write_times(place, times, line_time=1.5e-5)
        assert file == times_file(place)
        for some in (np.arange(3), np.array([0, 2])):  # and of a film in which one is lost
            read = read_times(place, some)
            assert read is not None and read[1] == 1.5e-5
            np.testing.assert_array_equal(read[0], times[some])
    assert (tmp_path / "film.times.csv").read_text().splitlines()[
        2
    ] == "1,0.3333333333333333,1.5e-05"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + "0,0.0,0\n", "1 rows; expected 2, one a frame of film.mkv"),
        (HEAD + "0,0.0,0\n1,soon,0\n", "aren't numbers, or don't grow"),
        (HEAD + "0,0.5,0\n1,0.5,0\n", "aren't numbers, or don't grow"),
        (HEAD + "0,0.5,0\n1,nan,0\n", "aren't numbers, or don't grow"),
        (HEAD + "0\n1\n", "aren't numbers, or don't grow"),
    ],
)
def test_a_damaged_table_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "film.times.csv").write_text(text)
    with pytest.raises(InputError, match=rf"film\.times\.csv.*{message}"):
        read_times(tmp_path / "film.mkv", np.arange(2))


def test_somebody_elses_table_is_left_alone(tmp_path: Path) -> None:
    assert read_times(tmp_path, np.arange(2)) is None
    (tmp_path / "times.csv").write_text("load,time\n1,2\n3,4\n")
    assert read_times(tmp_path, np.arange(2)) is None
