"""Poses and keypoints of a data set's pictures: COCO's keypoints, BOP's cameras and poses.

Pixels' centres are whole numbers here, as in COCO's keypoints and OpenCV's camera matrices; COCO's
boxes count from the picture's corner, half a pixel further.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim._version import __version__
from gpusim.arrays.array_types import Float
from gpusim.studies.dataset.splits import CropWindow


@dataclass(frozen=True)
class LabelledPicture:
    """A picture of the data set: its ``file``, what is cut out of which ``camera``'s in which
    ``frame``, and the sample's ``labels`` (labels.json)."""

    file: str
    camera: str
    frame: int
    window: CropWindow
    labels: Mapping[str, Any]

    @property
    def K(self) -> Float:
        """(3, 3) px, of what is cut out."""
        matrix = np.array(self.labels["cameras"][self.camera]["K"])
        matrix[:2, 2] -= self.window[:2]
        return matrix

    @property
    def keypoints(self) -> list[Float]:
        """Of each object rows x, y, visibility (P, 3), all 0 outside of what is cut out."""
        rows = np.array(self.labels["frames"][self.frame]["keypoints"][self.camera]).reshape(-1, 3)
        rows[:, :2] -= self.window[:2]
        inside = ((rows[:, :2] >= -0.5) & (rows[:, :2] < np.subtract(self.window[2:], 0.5))).all(1)
        rows[~(inside & (rows[:, 2] > 0))] = 0.0
        counts = [len(one["points"]) for one in self.labels["objects"]]
        return np.split(rows, np.cumsum(counts)[:-1])

    @property
    def poses(self) -> Float:
        """Of each object (O, 4, 4): from itself at rest, in the world's axes, to the camera, m."""
        world = np.array(self.labels["cameras"][self.camera]["camera_from_world"])
        return np.asarray(world @ np.array(self.labels["frames"][self.frame]["poses"]))

    def facts(self) -> dict[str, Any]:
        """What the item's own JSON file says of it."""
        told = zip(self.labels["objects"], self.poses, self.keypoints, strict=True)
        objects = [
            {"name": one["name"], "camera_from_object_m": pose, "keypoints": rows}
            for one, pose, rows in told
        ]
        distortion = self.labels["cameras"][self.camera]["distortion"]
        return {"K": self.K, "distortion": distortion, "objects": objects}


def coco_keypoints(pictures: Iterable[LabelledPicture]) -> dict[str, Any]:
    """The content of a COCO file of keypoints (cocodataset.org, "Keypoint detection").

    A category is an object with its points; pictures are numbered from 0.

    Examples
    --------
    >>> from gpusim.studies.dataset.point_labels import coco_keypoints
    >>> list(coco_keypoints([]))
    ['info', 'images', 'annotations', 'categories']
    """
    images, annotations = list[dict[str, Any]](), list[dict[str, Any]]()
    categories: dict[Any, dict[str, Any]] = {}
    for number, picture in enumerate(pictures):
        size = {"width": picture.window.width, "height": picture.window.height}
        images.append({"id": number, "file_name": picture.file, **size})
        for one, rows in zip(picture.labels["objects"], picture.keypoints, strict=True):
            labelled = rows[rows[:, 2] > 0, :2]
            if not len(labelled):
                continue
            named = one["name"], tuple(one["points"])
            category = categories.setdefault(named, {
                "id": len(categories) + 1, "name": one["name"], "supercategory": one["kind"],
                "keypoints": one["points"], "skeleton": [],
            })  # fmt: skip
            low, extent = labelled.min(axis=0), np.ptp(labelled, axis=0)
            annotations.append({
                "id": len(annotations) + 1, "image_id": number, "category_id": category["id"],
                "keypoints": rows.ravel(), "num_keypoints": len(labelled),
                "bbox": [*(low + 0.5), *extent], "area": float(np.prod(extent)), "iscrowd": 0,
            })  # fmt: skip
    info = {"description": "made by gpusim", "version": __version__}
    return {"info": info, "images": images, "annotations": annotations,
            "categories": list(categories.values())}  # fmt: skip


def bop_scene(pictures: Iterable[LabelledPicture]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The contents of BOP's scene_camera.json and scene_gt.json (Hodan et al., BOP, ECCV 2018).

    Lengths are mm, matrices row by row, R and t lead from an object (at rest, in the world's axes)
    to the camera; pictures are numbered as in `coco_keypoints`, objects by their first occurrence
    from 1 on. ``depth_scale`` makes the label depth, m, mm. ``distortion`` is an addition.

    Examples
    --------
    >>> from gpusim.studies.dataset.point_labels import bop_scene
    >>> bop_scene([])
    ({}, {})
    """
    cameras, truth, known = dict[str, Any](), dict[str, Any](), dict[str, int]()
    for number, picture in enumerate(pictures):
        own = picture.labels["cameras"][picture.camera]
        world = np.array(own["camera_from_world"])
        cameras[str(number)] = {
            "cam_K": picture.K.ravel(), "depth_scale": 1e3, "cam_R_w2c": world[:3, :3].ravel(),
            "cam_t_w2c": 1e3 * world[:3, 3], "distortion": own["distortion"],
        }  # fmt: skip
        truth[str(number)] = [
            {"obj_id": known.setdefault(one["name"], len(known) + 1),
             "cam_R_m2c": pose[:3, :3].ravel(), "cam_t_m2c": 1e3 * pose[:3, 3]}
            for one, pose in zip(picture.labels["objects"], picture.poses, strict=True)
        ]  # fmt: skip
    return cameras, truth
