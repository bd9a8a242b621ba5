"""What the store has of a sample: pictures, truth and labels."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import h5py
import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.export.layers import LAYERS
from gpusim.files.atomic_files import safe_name
from gpusim.files.input_file import InputFile
from gpusim.graph.stage import digest
from gpusim.graph.store import Record, Store
from gpusim.pipeline.pictures.file_names import image_name
from gpusim.studies.batch import result_keys
from gpusim.studies.dataset.splits import CropWindow

if TYPE_CHECKING:  # who calls this knows them
    from gpusim.studies.samples import Sample
    from gpusim.studies.study_tables import Study


class OpenedSample(ExitStack):
    """What was read of one sample, until something of another is: a data set of many takes no more
    memory than that of a few."""

    def __init__(self) -> None:
        super().__init__()
        self._number, self._values = -1, dict[str, Any]()

    def value(self, number: int, name: str, read: Callable[[], Any]) -> Any:
        """Something of the sample of that ``number``, read if it isn't there."""
        if number != self._number:
            self.close()
            self._number, self._values = number, {}
        if name not in self._values:
            self._values[name] = read()
        return self._values[name]


class SampleResults:
    """Results of a ``sample`` of a study, found in a ``store`` by their keys.

    ``structure``: the same for samples of which the same is solved, whatever their load factors;
    where nothing is, for the same meshes, given motions and props; ``resolutions`` px
    of the cameras by name; ``frames``: how many; ``suffix``: that of pictures, with its dot.
    ``opened`` is shared by all samples of a data set.
    """

    def __init__(self, study: Study, sample: Sample, store: Store, opened: OpenedSample) -> None:
        self.sample, self._store, self._opened = sample, store, opened
        scene, self._keys = result_keys(study, sample)
        shapes = [
            own for name, own in sorted(self._keys.items())
            if name.split("/")[0] in ("mesh", "motion", "props")
        ]  # fmt: skip
        self.structure = digest(self._keys.get("solve") or shapes)
        self.resolutions = {camera.name: camera.resolution for camera in scene.cameras}
        self.frames = len(scene.analysis.frame_values)
        self.suffix = Path(image_name(scene, "", 0)).suffix

    def key(self, camera: str) -> list[str]:
        """Keys of all that may be taken of a camera."""
        names = (f"picture/{camera}", "truth", "labels")
        return [key for name in names for key in self._keys.get(name, ())]

    def picture(self, camera: str, frame: int) -> InputFile:
        """A picture's file."""
        record = self._record(f"picture/{camera}", frame)
        (name,) = record.files
        return self._store.read(record, name)

    def layer(self, camera: str, frame: int, layer: str, window: CropWindow) -> Float:
        """A part of a layer of truth.h5, (h, w) or (h, w, k)."""
        left, top, width, height = window
        truth = self._opened.value(self.sample.number, "truth", self._truth)
        group = truth[f"camera/{safe_name(camera)}/frame/{frame:04d}"]
        if layer in group:
            return np.asarray(group[layer][top : top + height, left : left + width], np.float64)
        known = LAYERS[layer]  # of a frame that sees no body
        shape = (height, width, known.components)[: 2 + (known.components > 1)]
        return np.full(shape, known.fill)

    @property
    def labels(self) -> dict[str, Any]:
        """labels.json."""
        return cast(dict[str, Any], self._opened.value(self.sample.number, "labels", self._labels))

    def _labels(self) -> dict[str, Any]:
        content = self._store.read(self._record("labels"), "labels.json").data
        return cast(dict[str, Any], json.loads(content))

    def _truth(self) -> h5py.File:
        stream = self._opened.enter_context(self._store.open(self._record("truth"), "truth.h5"))
        return self._opened.enter_context(h5py.File(stream, "r"))

    def _record(self, stage: str, number: int = 0) -> Record:
        record = self._store.find(self._keys[stage][number])
        if record is None:
            what = f"data set: sample {self.sample.number}: {stage} isn't in {self._store.root}"
            raise GpusimError(f"{what}; delete that folder, and run the study again")
        return record
