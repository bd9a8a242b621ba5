"""What the store has of a sample: pictures, truth and labels."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import GpusimError
from gpusim.export.layers import LAYERS
from gpusim.files.atomic_files import safe_name
from gpusim.files.input_file import InputFile
from gpusim.graph.graph import Graph
from gpusim.graph.stage import digest
from gpusim.graph.store import Record, Store
from gpusim.pipeline.pictures.file_names import image_name
from gpusim.plan.scene_stages import scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.studies.dataset.splits import CropWindow
from gpusim.studies.samples import Sample
from gpusim.studies.study_tables import Study


class SampleResults:
    """Results of a ``sample`` of a study, found in a ``store`` by their keys.

    ``structure``: the same for samples whose bodies are the same and loaded alike (nothing that is
    solved for differs; where nothing is, neither meshes nor motions nor props); ``resolutions`` px
    of the cameras by name; ``frames``: how many; ``suffix``: that of pictures, with its dot.
    """

    def __init__(self, study: Study, sample: Sample, store: Store) -> None:
        self.sample, self._store = sample, store
        scene, graph = sample.scene(study), Graph()
        graph.add(scene_stages(scene, RunOptions(study.backend)).stages)
        self._keys = graph.records[""]
        solved = {
            name for name, keys in self._keys.items()
            if keys and graph.tasks[keys[0]].stage.public(0) == "solve"
        }  # fmt: skip
        shapes = {name for name in self._keys if name.split("/")[0] in ("mesh", "motion", "props")}
        self.structure = digest([self._keys[name] for name in sorted(solved or shapes)])
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
        group = self._truth[f"camera/{safe_name(camera)}/frame/{frame:04d}"]
        if layer in group:
            return np.asarray(group[layer][top : top + height, left : left + width], np.float64)
        known = LAYERS[layer]  # of a frame that sees no body
        shape = (height, width, known.components)[: 2 + (known.components > 1)]
        return np.full(shape, known.fill)

    @cached_property
    def labels(self) -> dict[str, Any]:
        """labels.json."""
        content = self._store.read(self._record("labels"), "labels.json").data
        labels: dict[str, Any] = json.loads(content)
        return labels

    @cached_property
    def _truth(self) -> h5py.File:
        return h5py.File(self._store.open(self._record("truth"), "truth.h5"), "r")

    def forget(self) -> None:
        """Let go of what was read."""
        vars(self).pop("labels", None)
        if "_truth" in vars(self):
            self._truth.close()
            del self._truth

    def _record(self, stage: str, number: int = 0) -> Record:
        record = self._store.find(self._keys[stage][number])
        if record is None:
            what = f"data set: sample {self.sample.number}: {stage} isn't in {self._store.root}"
            raise GpusimError(f"{what}; delete that folder, and run the study again")
        return record
