"""The pictures of a scene correlated: points, masks, and what was found at them.

This sees pictures and calibrations alone. Where points are in the reference picture comes from the
region of interest, which the truth draws as a tester would by hand.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim import measure
from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import InputError
from gpusim.pipeline.measurements.dic.lone_points import without_chance_matches
from gpusim.pipeline.measurements.sources import Sources
from gpusim.scene.description import model as m

LEAST_SHARE = 0.5
"""Of a subset, within the region: less of it, as in a corner, tells little."""


def points_within(what: str, mask: Bool, spec: m.DicTable) -> Float:
    """Places (M, 2) px ``step_px`` apart within a ``mask`` (H, W), whose subsets are in the picture
    and at least half in the mask. Raises InputError if there are none."""
    got = f"a region without room for a subset of {spec.subset_px} px"
    none = InputError(f"{what}: roi; got {got}; expected a larger one, or smaller subsets")
    if not mask.any():
        raise none
    height, width = mask.shape
    half = spec.subset_px // 2
    row, column = np.nonzero(mask)
    places = []
    for size, inside in ((width, column), (height, row)):
        low, high = int(inside.min()), int(inside.max())
        start = low + (high - low) % spec.step_px // 2
        grid = np.arange(start, high + 1, spec.step_px)
        places.append(grid[(grid >= half) & (grid < size - half)])
    x, y = (axis.ravel() for axis in np.meshgrid(*places))
    size = spec.subset_px, spec.subset_px
    share = cv2.boxFilter(mask.astype(np.float64), -1, size, borderType=cv2.BORDER_CONSTANT)
    kept = mask[y, x] & (share[y, x] >= LEAST_SHARE)
    if not kept.any():
        raise none
    return np.stack([x[kept], y[kept]], axis=1).astype(np.float64)


def advice_on(
    what: str, sources: Sources, camera: str, mask: Bool, still: int | None
) -> measure.Advice:
    """Settings for a camera's first picture within a ``mask`` (H, W), its noise as the picture
    shows it, or beside the one of a frame ``still`` at rest. Raises InputError if it has no
    pattern or is too small."""
    row, column = np.nonzero(mask)
    try:
        return measure.advise(
            sources.image(camera, 0),
            still=None if still is None else sources.image(camera, still),
            roi=(int(column.min()), int(row.min()), int(column.max()), int(row.max())), mask=mask,
            device=sources.device, backend="numpy" if sources.device is None else "gpu",
        )  # fmt: skip
    except InputError as error:
        raise InputError(f'{what}: settings = "best": {error}') from None


def correlate_pictures(
    spec: m.DicTable, sources: Sources, points: Float, mask: Bool, frames: tuple[int, ...]
) -> list[measure.DicResult]:
    """One camera's pictures of ``frames`` against the first one, at ``points`` (M, 2) px."""
    (camera,), options = spec.views, _options(spec, sources)
    reference = sources.image(camera, 0)
    found = measure.dic_sequence(
        reference, _pictures(sources, camera, frames), points=points, mask=mask, **options
    )
    if options.pop("update") != "never":  # what is beside points doesn't follow the references
        return found
    pictures = zip(found, _pictures(sources, camera, frames), strict=True)
    return [
        without_chance_matches(one, partial(measure.dic, reference, picture, **options))
        for one, picture in pictures
    ]


def correlate_pairs(
    spec: m.DicTable,
    sources: Sources,
    points: Float,
    masks: tuple[Bool, Bool],
    rig: tuple[measure.CalibratedCamera, measure.CalibratedCamera],
    frames: tuple[int, ...],
) -> list[measure.StereoResult]:
    """The pictures of a pair of cameras in ``frames`` against the first ones."""
    left, right = spec.views
    return measure.stereo_dic(
        sources.image(left, 0), sources.image(right, 0),
        _pictures(sources, left, frames), _pictures(sources, right, frames), rig,
        points=points, mask=masks[0], mask_right=masks[1], **_options(spec, sources),
    )  # fmt: skip


def _pictures(sources: Sources, camera: str, frames: tuple[int, ...]) -> Iterator[npt.NDArray[Any]]:
    """One at a time."""
    return (sources.image(camera, frame) for frame in frames)


def _options(spec: m.DicTable, sources: Sources) -> dict[str, Any]:
    """Arguments of every correlation."""
    return {
        "subset": spec.subset_px, "shape": spec.shape, "start": spec.start,
        "search_px": spec.search_px, "blur_px": spec.blur_px, "min_zncc": spec.min_zncc,
        "update": "auto" if spec.reference == "updated" else "never",
        "device": sources.device, "backend": "numpy" if sources.device is None else "gpu",
    }  # fmt: skip
