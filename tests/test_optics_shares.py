"""What single receivers see of lamps, by the device and by the host: who is asked, and alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.gpu import Device
from gpusim.optics import shares
from gpusim.optics.occlusion import lamp_masks
from gpusim.optics.shadow_probe import probe_outlines, probe_shadows
from gpusim.optics.shadow_tables import ShadowTables
from gpusim.optics.shadow_tiles import Chains
from gpusim.optics.shares import Shares

Array = npt.NDArray[np.float64]


@pytest.mark.parametrize("outlined", [False, True], ids=["faces", "outlines"])
def test_the_device_is_asked_about_many_and_never_about_long_lists(
    device: Device, monkeypatch: pytest.MonkeyPatch, outlined: bool
) -> None:
    setup = probe_outlines() if outlined else probe_shadows()
    tiles = setup.lighting.shadows
    assert tiles is not None
    receivers = shares._receivers(setup)
    want = tiles.shares(*receivers)
    asked: list[int] = []
    original = Shares._found

    def counting(self: Shares, entry: npt.NDArray[np.int64], *args: Array) -> Array:
        asked.append(len(entry))
        return original(self, entry, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(Shares, "_found", counting)
    found = Shares(device, ShadowTables(device, setup.lighting), tiles)
    got = found(*receivers)
    half = tiles.tile_of(*receivers[:2])[1] >= 0
    assert asked == [np.count_nonzero(half)] and 200 < asked[0] < len(half)
    samples = np.array([np.bitwise_count(lamp_masks(lamp)).sum() for lamp in tiles.lamps])
    assert np.abs((got - want) * samples).max() <= 2.5
    # what isn't in half shadow is the host's, to the last bit
    assert (got[~half] == want[~half]).all()
    for name, value in (("WORTH", 1 << 40), ("LOOP_TURNS", 0)):
        with monkeypatch.context() as patch:
            patch.setattr(shares, name, value)
            asked.clear()
            assert (found(*receivers) == want).all() and not asked
    # some lists too long: these are the host's, the others aren't
    turns = np.append(tiles.edge_counts, 0)[tiles.tile_of(*receivers[:2])[1]]
    limit = int(np.median(turns[turns > 0]))
    monkeypatch.setattr(shares, "LOOP_TURNS", limit)
    monkeypatch.setattr(shares, "WORTH", 1)
    asked.clear()
    mixed = found(*receivers)
    assert asked == [np.count_nonzero((turns > 0) & (turns <= limit))]
    assert (mixed[turns > limit] == want[turns > limit]).all()
    assert np.abs((mixed - want) * samples).max() <= 2.5


def test_turns_are_those_of_receivers_in_step() -> None:
    """Two tiles, each with a long list for another lamp: side by side they take both."""
    tiles = probe_shadows().lighting.shadows
    assert tiles is not None
    count = np.array([[100, 1], [1, 100]])
    own = replace(
        tiles, lamps=tiles.lamps[:2], start=np.cumsum(count).reshape(2, 2) - count, count=count,
        face=np.zeros(202, np.int64), edges=np.full(202, 15, np.uint8), chains=Chains.none(2, 2),
    )  # fmt: skip
    in_step = 4 * int(count.max(axis=0).sum())
    assert own.edge_counts.max() >= in_step > 4 * int(count.sum(axis=1).max())
