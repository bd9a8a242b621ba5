"""Results of samples that don't stay: ``keep = "numbers"``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path

from gpusim.errors import GpusimError
from gpusim.files.output_folder import inside
from gpusim.graph.folder import INNER
from gpusim.graph.store import Store
from gpusim.studies.batch import result_keys
from gpusim.studies.samples import Sample
from gpusim.studies.study_tables import Study

_PASSING = "picture", "calib-picture", "measure"
"""Kinds of stages whose results are large, and different in each sample."""
_TOGETHER = 32


class Passing:
    """Pictures and fields of ``samples`` in ``out``, which stay until the last sample that needs
    them has its row."""

    def __init__(self, study: Study, samples: Sequence[Sample], out: Path) -> None:
        self._store = Store(inside(out, INNER))
        self._needs = {sample.number: _passing(study, sample) for sample in samples}
        self._users = Counter(key for own in self._needs.values() for key in own)

    def drop(self, left: Collection[int]) -> None:
        """Delete what none of the samples that are ``left`` needs, of many samples together."""
        ended = self._needs.keys() - left
        if len(ended) >= _TOGETHER or not left:
            keys = [key for number in ended for key in self._needs.pop(number)]
            self._users.subtract(keys)
            self._store.drop({key for key in keys if not self._users[key]})


def _passing(study: Study, sample: Sample) -> set[str]:
    try:
        stages = result_keys(study, sample)[1].items()
    except GpusimError:  # its row will say so
        return set()
    return {key for name, own in stages if name.split("/")[0] in _PASSING for key in own}
