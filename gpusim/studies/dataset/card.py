"""The card of a data set: how it was made, what its labels mean, how much there is of what."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gpusim._version import __version__
from gpusim.graph.stage import digest
from gpusim.pipeline.pictures.file_names import image_name

if TYPE_CHECKING:  # who calls this knows them
    from gpusim.studies.dataset_table import DatasetTable
    from gpusim.studies.study_tables import Study

MANIFESTS = "manifest.parquet", "manifest.csv"
_FLOW = {
    "flo": "Middlebury's .flo, float32; 1e10 where nothing is known",
    "kitti": "KITTI's PNG of 16 bit: (red - 32768) / 64, (green - 32768) / 64, blue 1 where it is "
    "known. Rounded to 1/64 px, so off by up to 1/128 px; of 512 px and more it isn't known",
    "tiff": "TIFF of float32 with three samples a pixel: u, v, and 1 where they are known (else "
    "NaN, NaN, 0)",
}
_MEANING = {
    "flow": "px, from a pixel of this picture back to where its material point is in the unloaded "
    "structure (picture 0, if nothing is loaded there); {flow}",
    "forward_flow": "px, from a pixel of picture 0 to where its material point is in this picture, "
    "hidden or not; {flow}",
    "displacement": "m, world: of the material point that a pixel of this picture sees, from the "
    "unloaded structure; TIFF of float32, NaN where no body is seen",
    "depth": "m, along the optical axis; TIFF of float32, NaN where no body is seen",
    "normal": "outward unit normal of the deformed surface, world; TIFF of float32, NaN where no "
    "body is seen",
    "region": "number of the paint; TIFF of int32, -1 where no body is seen",
    "element": "number of the finite element; TIFF of int32, -1 where no body is seen",
    "visibility": "1 where the unloaded structure shows this material point, too, 0 where it "
    "doesn't, -1 where no body is seen; TIFF of int32",
    "keypoints": "px: middles of markers and dots, inner corners of boards; x, y, visibility (2 "
    "seen, 1 hidden, 0 outside) in the JSON file of each item and in coco_keypoints.json of each "
    "split. bbox counts from the picture's corner, half a pixel further than keypoints",
    "poses": "from an object at rest, in the world's axes, to the camera: in m in the JSON file of "
    "each item, in mm in scene_camera.json and scene_gt.json of each split, as BOP has them; of a "
    "deformed body the nearest rigid motion. Pictures have the numbers of coco_keypoints.json: two "
    "or more an item, in the order of the manifest. cam_K is without the lens's distortion, which "
    "stands beside it",
}


def card_text(
    study: Study,
    table: DatasetTable,
    counts: Mapping[str, tuple[int, int, int]],
    samples: int,
    files: Sequence[str],
) -> str:
    """The card, README.md: ``counts`` of items, structures and samples by split, ``samples`` of the
    study, ``files`` beside it."""
    manifest = next((name for name in MANIFESTS if name in files), MANIFESTS[-1])
    tables, suffix = study.tables, Path(image_name(study.scene, "", 0)).suffix
    seeds = f"design {tables.seed}, crops and splits {table.seed}"
    if tables.repeats > 1:
        seeds += f"; {', '.join(tables.seeds)}: one more for each of {tables.repeats} repeats"
    content = [tables.model_dump(mode="json", by_alias=True), study.scene.digest()]
    used = sum(own for _, _, own in counts.values())
    crop = "whole" if table.crop_px is None else (
        f"{table.crop_px[0]} x {table.crop_px[1]} px, {table.crops} of each")  # fmt: skip
    lines = [
        "---", "configs:", "- config_name: default", "  data_files:",
        *(f"  - split: {split}\n    path: {split}/{manifest}"
          for split, own in counts.items() if own[0]),
        "---",
        f"# {study.scene.name}: {table.items}, {crop}",
        "",
        f"Made by gpusim {__version__} (Python {platform.python_version()}) from "
        f"{used} of {samples} samples of a study"
        f"{'' if used == samples else '; the others were refused or came to nothing'}.",
        f"Seeds: {seeds}. Study and scene: SHA-256 `{digest(content)}`.",
        "",
        "| split | share | items | structures | samples |", "|---|---|---|---|---|",
        *(f"| {split} | {table.splits[split]:g} | {' | '.join(map(str, own))} |"
          for split, own in counts.items()),
        "",
        "No structure (bodies and what they are solved for) is in two splits.",
        "",
        f"An item `NAME` is `NAME.0{suffix}`, `NAME.1{suffix}`, ... (frames of one camera in "
        "their order), `NAME.K.LABEL.*` of the K-th picture, and `NAME.json`. "
        + (f"{table.shards} items lie in a tar file, as WebDataset reads them."
           if table.shards else "They lie in the folder of their split."),
        f"`{manifest}` has a line for each, that of a split's folder those of the split.",
        "Pixels: x right, y down; a whole number is a pixel's middle, (0, 0) the first one's.",
        "",
        "| label | what it is |", "|---|---|",
        *(f"| {label} | {_MEANING[label].format(flow=_FLOW[table.flow_format])} |"
          for label in table.labels),
        "",
    ]  # fmt: skip
    return "\n".join(lines)
