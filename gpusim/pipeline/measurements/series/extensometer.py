"""The kind "extensometer": the length between two ends, and its engineering strain."""

from __future__ import annotations

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float
from gpusim.pipeline.measurements.results import Columns
from gpusim.pipeline.measurements.series.measuring import Sample, SeriesKind, register_series
from gpusim.pipeline.measurements.series.placing import ReferencePicture
from gpusim.scene.description import model as m


def _ends(spec: m.ExtensometerTable, picture: ReferencePicture) -> dict[str, Float]:
    """As many subsets side by side as the line that each end is has room for, at least one, from
    its middle outwards."""
    ends = picture.pixels("ends")
    along = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-300)
    count = max(int(spec.width_px / spec.subset_px), 1)
    steps = spec.subset_px * np.array(sorted(np.arange(count) - 0.5 * (count - 1), key=abs))
    across = steps[:, None] * np.array([-along[1], along[0]])
    return {f"ends[{number}]": end + across for number, end in enumerate(ends)}


def _length(spec: m.ExtensometerTable, sample: Sample) -> Columns:
    """Strain, length, and how much it grew, (1,)."""
    ends = [_mean(sample, number) for number in (0, 1)]
    places, moved = (np.array(one) for one in zip(*ends, strict=True))
    length, longer, strain = measure.extensometer(places, moved)
    unit = sample.unit
    found = {"strain": strain, f"length_{unit}": length, f"elongation_{unit}": longer}
    return {name: np.array([value]) for name, value in found.items()}


def _mean(sample: Sample, end: int) -> tuple[Float, Float]:
    """Mean place and displacement of the subsets of an end that were followed."""
    known = np.isfinite(sample.places + sample.moved).all(axis=1) & (sample.subsets.place == end)
    if not known.any():
        return np.full((2, sample.places.shape[1]), np.nan)[0], sample.moved[0] * np.nan
    return sample.places[known].mean(axis=0), sample.moved[known].mean(axis=0)


register_series(m.ExtensometerTable, SeriesKind("length", _ends, _length, joined=True))
