"""Splits by structure, and crops: which items a data set has, where they are cut out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import NamedTuple

import numpy as np

from gpusim.validation import require


class CropWindow(NamedTuple):
    """A part of a picture, px: its first column and row, its width and height."""

    left: int
    top: int
    width: int
    height: int


def split_of_structures(
    structures: Sequence[str], shares: Mapping[str, float], seed: int = 0
) -> dict[str, str]:
    """The split of each structure, given that of every item (its name as often as it has items).

    Structures come in the order of their hashes, each to the split that lacks most: splits have
    their shares of the items as nearly as whole structures allow.

    Examples
    --------
    >>> from gpusim.studies.dataset.splits import split_of_structures
    >>> split_of_structures(["a", "b", "b"], {"train": 0.6, "test": 0.4})
    {'b': 'train', 'a': 'test'}
    """
    counts = Counter(structures)
    lacking = {name: share * len(structures) for name, share in shares.items()}
    found = {}
    for one in sorted(counts, key=lambda name: sha256(f"{seed} {name}".encode()).digest()):
        split = max(lacking, key=lacking.__getitem__)
        found[one] = split
        lacking[split] -= counts[one]
    return found


def crop_windows(
    resolution: tuple[int, int],
    size: tuple[int, int] | None,
    crops: int | str,
    seed: int,
    name: str,
) -> list[CropWindow]:
    """Where an item of that ``name`` is cut out of pictures of that ``resolution``: at ``crops``
    random places, or ("grid") side by side, with the rest as their border. Raises InputError for
    pictures that are smaller.

    Examples
    --------
    >>> from gpusim.studies.dataset.splits import crop_windows
    >>> [tuple(one) for one in crop_windows((70, 32), (32, 32), "grid", 0, "bar")]
    [(3, 0, 32, 32), (35, 0, 32, 32)]
    """
    width, height = size or resolution
    free = resolution[0] - width, resolution[1] - height
    most = f"at most {resolution[0]} x {resolution[1]}"
    require(min(free) >= 0, f"[dataset] crop_px, item {name}", f"{width} x {height}", most)
    if crops == "grid":
        columns, rows = resolution[0] // width, resolution[1] // height
        left, top = (resolution[0] - columns * width) // 2, (resolution[1] - rows * height) // 2
        return [
            CropWindow(left + column * width, top + row * height, width, height)
            for row in range(rows) for column in range(columns)
        ]  # fmt: skip
    hashed = int.from_bytes(sha256(f"{seed} {name}".encode()).digest()[:8])
    places = np.random.default_rng(hashed).integers(0, np.add(free, 1), (int(crops), 2))
    return [CropWindow(left, top, width, height) for left, top in places.tolist()]
