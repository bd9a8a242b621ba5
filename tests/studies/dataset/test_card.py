"""The card of a data set."""

from __future__ import annotations

from pathlib import Path

from gpusim.studies import load_study
from gpusim.studies.dataset.card import card_text
from tests.support.stretched_bar import PARAMETERS, write_study


def test_the_card_of_repeats_in_shards_names_what_counts_up(tmp_path: Path) -> None:
    text = "repeats = 2\n" + PARAMETERS + 'flow_format = "kitti"\nshards = 9\n'
    study = load_study(write_study(tmp_path, text))
    assert study.tables.dataset is not None
    card = card_text(study, {"train": [18, 2, 9]}, 9, 16, ["manifest.csv"])
    for words in (
        "9 of 16 samples of a study; the others were refused or came to nothing",
        "crops and splits 0; sensor.seed: one more for each of 2 repeats",
        "off by up to 1/128 px", "9 items lie in a tar file",
        "  - split: train\n    path: train/manifest.csv\n",
    ):  # fmt: skip
        assert words in card
