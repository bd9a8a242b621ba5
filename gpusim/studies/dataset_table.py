"""``[dataset]``: what is taken from the samples of a study, labelled, for who trains or tests."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from gpusim.errors import require
from gpusim.scene import Scene
from gpusim.scene.tables.table import Count, Listed, Name, Names, Seed, Share, Table, Words, fault

Label = Literal[
    "flow", "forward_flow", "displacement", "depth", "normal", "region", "element", "visibility",
    "keypoints", "poses",
]  # fmt: skip
_UNIT = 1e-9
"""By which shares may miss 1 in all, through rounding."""


def _usual_shares() -> dict[str, float]:
    return {"train": 0.8, "val": 0.1, "test": 0.1}


class DatasetTable(Table):
    """A data set, made of the samples' pictures and truth.

    Example::

        items = "pairs"
        labels = ["forward_flow", "visibility"]
        flow_format = "flo"
        crop_px = [64, 64]
        crops = 4
        splits = { train = 0.8, val = 0.1, test = 0.1 }
    """

    items: Literal["pairs", "sequences"] = "pairs"
    """"pairs": frame 0 and a later one of a camera; "sequences": all its frames."""
    cameras: Names = ()
    """Without it all."""
    labels: Annotated[tuple[Label, ...], Listed(1, different=True)] = ("forward_flow",)
    """Layers of truth.h5; "keypoints": markers and corners of boards (COCO); "poses": of bodies
    and props (BOP)."""
    flow_format: Literal["flo", "kitti", "tiff"] = "flo"
    """Middlebury's .flo and float TIFF are exact to float32; KITTI's PNG goes in steps of 1/64
    px."""
    crop_px: Annotated[tuple[Count, Count], Listed()] | None = None
    """Width and height of what is cut out of each picture; without it they are whole."""
    crops: Literal["grid"] | Count = "grid"
    """How many of each item, at random places; "grid": as many as lie side by side."""
    seed: Seed = 0
    """Of the places of crops, and of which structure comes into which split."""
    splits: Annotated[dict[Name, Share], Field(min_length=1, default_factory=_usual_shares)]
    """Shares of items, 1 in all. What has the same structure is never in two of them."""
    shards: Count | None = None
    """Items in a tar file, as WebDataset reads them; without it files lie loose."""

    @model_validator(mode="after")
    def _check(self) -> DatasetTable:
        total = sum(self.splits.values())
        if not abs(total - 1.0) <= _UNIT:
            raise fault("splits", "shares don't add up", total, "1 in all")
        if self.crop_px is None and self.crops != "grid":
            raise fault("crop_px", "missing", Words("none"), "the size of the crops")
        return self

    @property
    def layers(self) -> tuple[str, ...]:
        """The labels that are layers of truth.h5."""
        return tuple(label for label in self.labels if label not in ("keypoints", "poses"))

    @property
    def has_points(self) -> bool:
        """Whether there are labels that are none."""
        return len(self.layers) < len(self.labels)

    def labelled(self, scene: Scene) -> Scene:
        """The scene, with all that the labels are taken from. Raises InputError for one that has no
        such pictures."""
        self._check_scene(scene)
        truth = list(dict.fromkeys((*scene.output.truth, *self.layers)))
        asked = {"output.truth": truth, "output.labels": scene.output.labels or self.has_points}
        own, files = scene.document, scene.files
        return Scene.from_document(own, source=scene.source, overrides=asked, files=files)

    def _check_scene(self, scene: Scene) -> None:
        what, known = "[dataset]", {camera.name: camera for camera in scene.cameras}
        unknown = [name for name in self.cameras if name not in known]
        require(not unknown, f"{what} cameras", unknown, f"some of {list(known)}")
        require(bool(known), what, "a scene without [[camera]]", "one that has pictures")
        count = len(scene.analysis.frame_values)
        require(count > 1, what, f"{count} frame", "a scene of two frames or more")
        bodies = bool(scene.bodies) or not self.layers
        require(bodies, f"{what} labels", f"{list(self.layers)} of no [[body]]", "a scene with one")
        for name in self.cameras or known:
            wide, high = known[name].resolution
            crop = self.crop_px or (wide, high)
            what_crop = f"{what} crop_px, camera {name!r}"
            fits = crop[0] <= wide and crop[1] <= high
            require(fits, what_crop, f"{crop[0]} x {crop[1]}", f"at most {wide} x {high}")
