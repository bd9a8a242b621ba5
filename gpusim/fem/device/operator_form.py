"""The form in which a stiffness goes to a device: by its elements, or as rows of blocks."""

from __future__ import annotations

import numpy as np

from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.device.arena import Allocator
from gpusim.fem.device.block_texels import block_texels_bytes
from gpusim.fem.device.stiffness import DeviceStiffness
from gpusim.fem.device.tet_elements import TetElements, tet_elements
from gpusim.fem.device.tet_forces import DeviceTets
from gpusim.fem.device.tet_texels import TetTexels, tet_texels_bytes

__all__ = ["DeviceOperator", "device_tets", "operator_bytes", "upload_operator"]

DeviceOperator = DeviceStiffness | DeviceTets


def device_tets(device: Allocator, assembled: Assembled) -> TetElements | None:
    """The elements, where the device should multiply by them: tet10 of isotropic materials that
    don't repeat. Their matrices are ten times their geometry."""
    nodes = assembled.rows.node_count
    elements = tet_elements(assembled.groups)
    fits = elements is not None and TetTexels.fits(device, elements, nodes)
    return elements if fits else None


def operator_bytes(assembled: Assembled, elements: TetElements | None) -> int:
    """Bytes on a device; never less."""
    rows = assembled.rows
    if elements is not None:
        return tet_texels_bytes(elements, rows.node_count)
    return block_texels_bytes(rows.degree, np.diff(rows.table_start), exact=True)


def upload_operator(
    device: Allocator,
    assembled: Assembled,
    elements: TetElements | None,
    scale: float,
    cases: int,
) -> DeviceOperator:
    """K / ``scale`` for ``cases`` load cases; ``elements`` of ``device_tets``."""
    if elements is None:
        return DeviceStiffness(device, assembled.rows, scale, cases)
    return DeviceTets(device, elements, assembled.rows.node_count, scale, cases)
