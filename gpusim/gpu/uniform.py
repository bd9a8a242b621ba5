"""Uniform structs: checked, packed, and written to the device once for all that bind them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import wgpu

from gpusim.errors import InputError
from gpusim.gpu.context import DeviceContext
from gpusim.validation import require


class Uniform:
    """The values of a uniform struct, for several programs to bind."""

    def __init__(self, device: DeviceContext, values: Any, label: str) -> None:
        self.device, self.values, self.label = device, values, label
        self._buffers: dict[np.dtype[np.void], Any] = {}

    def live(self, dtype: np.dtype[np.void], where: str) -> Any:
        """The wgpu buffer with the values laid out as ``dtype``; ``where`` names it in errors.

        Raises
        ------
        InputError
            See `pack`.
        """
        if dtype not in self._buffers:
            data = pack(self.values, dtype, where)
            size = -(-data.nbytes // 16) * 16
            usage = wgpu.BufferUsage.UNIFORM | wgpu.BufferUsage.COPY_DST
            self._buffers[dtype] = self.device.create(self.label, size, data, usage)
        return self._buffers[dtype]

    def update(self, values: Any) -> None:
        """Other values from the next submit on."""
        self.values = values
        with self.device.guard(f"updating {self.label}"):
            for dtype, gpu in self._buffers.items():
                self.device.write(gpu, pack(values, dtype, self.label))


def pack(values: dict[str, Any], dtype: np.dtype[np.void], where: str) -> npt.NDArray[np.void]:
    """A dict as one WGSL struct; every member must be given, none may be unknown.

    Raises
    ------
    InputError
        Members missing or unknown, a wrong shape, NaN or infinity, or a number that the member's
        type can't hold (a fraction or a negative number as u32, 1e39 as f32).
    """
    mapped = isinstance(values, Mapping)
    require(mapped, where, type(values).__name__, "a dict of the members")
    names = set(dtype.names or ())
    if set(values) != names:  # no `require`: it is called for every pass of a frame
        raise InputError(f"{where}; got members {sorted(values)}; expected {sorted(names)}")
    record = np.zeros((), dtype)
    for key, value in values.items():
        member = dtype[key]
        at = f"{where}.{key}"
        record[key] = pack(value, member, at) if member.names else _numbers(value, member, at)
    return record


def _numbers(value: Any, member: np.dtype[Any], where: str) -> npt.NDArray[Any]:
    given = np.asarray(value)
    if given.shape != member.shape or given.dtype.kind not in "biuf":
        raise InputError(f"{where}; got {value!r}; expected numbers of shape {member.shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        stored = given.astype(member.base)
    held = stored == given if member.base.kind in "iu" else np.isfinite(stored)
    if not (np.isfinite(given).all() and held.all()):
        raise InputError(f"{where}; got {value!r}; expected finite values that {member.base} holds")
    return stored
