"""A data set, written: items of pictures and labels, loose or in shards, and what tells of them."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from gpusim._version import __version__
from gpusim.export.columns import column_files, column_of
from gpusim.export.images import encoded_picture, read_image
from gpusim.files.input_file import InputFile
from gpusim.files.output_folder import inside
from gpusim.graph.folder import INNER
from gpusim.graph.stage import digest
from gpusim.graph.store import Store
from gpusim.pipeline.runner.stage_log import Progress, silent
from gpusim.studies.dataset.card import card_text
from gpusim.studies.dataset.dataset_folder import NAME, Content, DatasetFolder
from gpusim.studies.dataset.label_files import label_bytes
from gpusim.studies.dataset.point_labels import LabelledPicture, bop_scene, coco_keypoints
from gpusim.studies.dataset.sample_results import OpenedSample, SampleResults
from gpusim.studies.dataset.splits import CropWindow, crop_windows, split_of_structures

if TYPE_CHECKING:  # who calls this knows them
    from gpusim.studies.dataset_table import DatasetTable
    from gpusim.studies.rows import Row
    from gpusim.studies.samples import Sample
    from gpusim.studies.study_tables import Study

_FROM_FRAME_0 = "flow", "forward_flow", "displacement", "visibility"
"""Layers that say nothing of frame 0 itself."""
_ABOUT = "about all items"


@dataclass(frozen=True, eq=False)
class DatasetItem:
    """A part (``window``) of some ``frames`` of a ``camera`` of one sample."""

    name: str
    results: SampleResults
    camera: str
    frames: tuple[int, ...]
    window: CropWindow
    split: str = ""

    def facts(self) -> dict[str, Any]:
        """What it is made of, as the manifest and its own JSON file say it."""
        sample = self.results.sample
        return {
            "item": self.name, "split": self.split, "sample": sample.number,
            "repeat": sample.repeat, "structure": self.results.structure[:16],
            "camera": self.camera, "frames": " ".join(map(str, self.frames)),
            **{f"crop_{key}": value for key, value in self.window._asdict().items()},
            **{f"parameter.{name}": value for name, value in sample.values.items()},
        }  # fmt: skip

    def digest(self, table: DatasetTable) -> str:
        """What its files depend on."""
        made = table.labels, table.flow_format, self.results.key(self.camera)
        return digest([__version__, *made, self.facts()])


def write_dataset(
    study: Study,
    samples: Sequence[Sample],
    rows: Mapping[int, Row],
    out: Path,
    progress: Progress = silent,
) -> Path | None:
    """Make the data set of a study from the results of its samples that are done.

    What lies there already isn't written again. ``out``: the study's folder, which has the store
    of results; ``progress`` is called with ("dataset", done 0..1, text).

    Returns
    -------
    ``out``/dataset; None for a study without ``[dataset]``.

    Raises
    ------
    InputError
        A sample whose pictures are smaller than the crops.
    GpusimError
        The store lacks what a sample has made, or the disk is full.

    Examples
    --------
    >>> from pathlib import Path
    >>> from gpusim.studies import load_study
    >>> from gpusim.studies.dataset import write_dataset
    >>> _ = Path("study.toml").write_text('scene = "bar.toml"')
    >>> write_dataset(load_study("study.toml"), [], {}, Path("out")) is None
    True
    """
    table = study.tables.dataset
    if table is None:
        return None
    store, folder, digests = Store(inside(out, INNER)), DatasetFolder(out), dict[str, str]()
    done = [one for one in samples if rows.get(one.number, {}).get("status") == "done"]
    with OpenedSample() as opened:
        results = [SampleResults(study, one, store, opened) for one in done]
        units = list(_units(dataset_items(table, results), table.shards))
        for number, (unit, own) in enumerate(units, start=1):
            digests[unit] = digest([one.digest(table) for one in own])
            if not folder.holds(unit, digests[unit]):
                folder.put(unit, digests[unit], _unit_files(unit, own, table))
            kind = "shards" if table.shards else "items"
            progress(NAME, number / len(units), f"{number} of {len(units)} {kind}")
        digests[_ABOUT] = digest([digests, table.model_dump(mode="json"), len(samples)])
        if not folder.holds(_ABOUT, digests[_ABOUT]):
            folder.put(_ABOUT, digests[_ABOUT], _about(study, table, units, len(samples)))
    folder.keep(digests)
    return folder.root


def dataset_items(table: DatasetTable, results: Sequence[SampleResults]) -> list[DatasetItem]:
    """All items of the samples' results, split by split, in their order."""
    items = []
    for own in results:
        sample, later = own.sample, range(1, own.frames)
        shown = [(0, k) for k in later] if table.items == "pairs" else [tuple(range(own.frames))]
        for camera in table.cameras or tuple(own.resolutions):
            size = own.resolutions[camera]
            for frames in shown:
                name = f"{sample.number:06d}-{camera}-{frames[-1]:04d}"
                windows = crop_windows(size, table.crop_px, table.crops, table.seed, name)
                items += [
                    DatasetItem(f"{name}-{number:03d}", own, camera, frames, window)
                    for number, window in enumerate(windows)
                ]
    splits = split_of_structures([one.results.structure for one in items], table.splits, table.seed)
    placed = [replace(one, split=splits[one.results.structure]) for one in items]
    order = [*table.splits]
    return sorted(placed, key=lambda one: order.index(one.split))


def _units(
    items: Sequence[DatasetItem], shards: int | None
) -> Iterator[tuple[str, Sequence[DatasetItem]]]:
    """Items that are written together: one, or those of a shard, a tar file of that name."""
    size = shards or 1
    for split, group in groupby(items, key=lambda one: one.split):
        own = list(group)
        for first in range(0, len(own), size):
            name = f"{first // size:06d}.tar" if shards else f"{own[first].name}.json"
            yield f"{split}/{name}", own[first : first + size]


def _unit_files(
    unit: str, items: Sequence[DatasetItem], table: DatasetTable
) -> Mapping[str, Content]:
    if table.shards:
        return {unit: partial(_write_shard, items, table)}
    (item,) = items
    return {f"{item.split}/{name}": data for name, data in item_files(item, table).items()}


def _write_shard(items: Sequence[DatasetItem], table: DatasetTable, stream: BinaryIO) -> None:
    """A tar file whose bytes depend on nothing but the items."""
    with tarfile.TarFile(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as shard:
        for item in items:
            for name, data in item_files(item, table).items():
                entry = tarfile.TarInfo(name)
                entry.size = len(data)
                shard.addfile(entry, io.BytesIO(data))


def item_files(item: DatasetItem, table: DatasetTable) -> dict[str, bytes]:
    """The files of an item by name: pictures and layers of each of its frames, and a JSON file."""
    files, facts = {}, item.facts()
    for place, frame in enumerate(item.frames):
        picture = item.results.picture(item.camera, frame)
        files[f"{item.name}.{place}{item.results.suffix}"] = _cut(picture, item)
        for layer in table.layers:
            if place or layer not in _FROM_FRAME_0:
                values = item.results.layer(item.camera, frame, layer, item.window)
                ending, data = label_bytes(layer, values, table.flow_format)
                files[f"{item.name}.{place}.{layer}.{ending}"] = data
    if table.has_points:
        facts["pictures"] = [one.facts() for one in _pictures([item])]
    files[f"{item.name}.json"] = _json(facts)
    return files


def _cut(file: InputFile, item: DatasetItem) -> bytes:
    """A part of a picture's file; the file itself where that is the whole."""
    left, top, width, height = item.window
    if (width, height) == item.results.resolutions[item.camera]:
        return file.data
    part = read_image(file)[top : top + height, left : left + width]
    return encoded_picture(part, item.results.suffix)


def _pictures(items: Sequence[DatasetItem]) -> Iterator[LabelledPicture]:
    for item in items:
        for place, frame in enumerate(item.frames):
            file = f"{item.name}.{place}{item.results.suffix}"
            yield LabelledPicture(file, item.camera, frame, item.window, item.results.labels)


def _about(
    study: Study,
    table: DatasetTable,
    units: Sequence[tuple[str, Sequence[DatasetItem]]],
    samples: int,
) -> dict[str, Content]:
    """Manifests, of the whole and of each split; card; what COCO and BOP have in one file for all
    pictures of a split."""
    files: dict[str, Content] = {}
    counts: dict[str, list[int]] = {}
    for split in ("", *table.splits):
        filed = [(one, file) for file, own in units for one in own if split in ("", one.split)]
        lines = [{**one.facts(), "file": file} for one, file in filed]
        if lines:
            columns = {name: column_of([line[name] for line in lines]) for name in lines[0]}
            files |= column_files(f"{split}/manifest".lstrip("/"), columns)
        kinds = ({line[name] for line in lines} for name in ("item", "structure", "sample"))
        counts[split] = [len(one) for one in kinds]
        items = [one for one, _ in filed]
        if split and "keypoints" in table.labels:
            files[f"{split}/coco_keypoints.json"] = _json(coco_keypoints(_pictures(items)))
        if split and "poses" in table.labels:
            cameras, poses = map(_json, bop_scene(_pictures(items)))
            files |= {f"{split}/scene_camera.json": cameras, f"{split}/scene_gt.json": poses}
    used = counts.pop("")[2]
    files["README.md"] = card_text(study, counts, used, samples, [*files]).encode()
    return files


def _json(content: Any) -> bytes:
    return json.dumps(content, default=np.ndarray.tolist).encode()
