"""Long arrays as textures: texel i lies at (i % 4096, i / 4096).

Where lanes read addresses of their own, software drivers fetch a texel of four numbers about as
fast as one number of a storage buffer, and real devices read it through a cache. As a storage
texture (``texture_storage_2d<…, read>``) it is fetched twice as fast as a sampled one: Mesa looks
for the level of the latter in every lane, in a function of its own. An entry point may name four
storage textures, those it writes among them; what is read most should be the rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import wgpu

from gpusim.errors import OutOfDeviceMemory
from gpusim.gpu.context import DeviceContext, DeviceMemory
from gpusim.validation import require

TEXEL_WIDTH = 4096
_BYTES = 16
_FORMATS = {"rgba32float": np.dtype(np.float32), "rgba32uint": np.dtype(np.uint32)}


def most_texels(device: Any) -> int:
    """Texels that one texture holds on a device."""
    height = int(device.limits["max-texture-dimension-2d"])
    # the height is never a power of two (see Texels)
    return TEXEL_WIDTH * (height - 1)


class Texels(DeviceMemory):
    """``count`` texels of four float32 or uint32, zero at first.

    The height is kept from being a power of two: Mesa compiles a kernel anew for textures whose
    sides are powers of two, and the width alone always is.
    """

    def __init__(self, device: DeviceContext, count: int, fmt: str, label: str) -> None:
        require(fmt in _FORMATS, f"texels {label}", repr(fmt), f"one of {sorted(_FORMATS)}")
        if not 0 <= count <= most_texels(device):
            most = f"at most {most_texels(device)} in a texture"
            raise OutOfDeviceMemory(f"texels {label}; got {count}; expected {most}")
        self.device, self.count, self.format, self.label = device, int(count), fmt, label
        self.dtype = _FORMATS[fmt]
        self.nbytes = self.footprint(count)
        height = self.nbytes // (_BYTES * TEXEL_WIDTH)
        usage = wgpu.TextureUsage
        self.gpu = device.allocate_texture(
            label, (TEXEL_WIDTH, height), fmt,
            usage.TEXTURE_BINDING | usage.STORAGE_BINDING | usage.COPY_SRC | usage.COPY_DST,
            self.nbytes,
        )  # fmt: skip
        self.view = self.gpu.create_view()

    @staticmethod
    def footprint(count: int) -> int:
        """Bytes that ``count`` texels take, whole rows."""
        height = max(3, -(-int(count) // TEXEL_WIDTH))
        if height & (height - 1) == 0:
            height += 1
        return _BYTES * TEXEL_WIDTH * height

    def write(self, array: npt.NDArray[Any], first: int = 0) -> None:
        """Copy (n,4) numbers of the texels' type into texels ``first`` … ``first`` + n - 1."""
        data = np.ascontiguousarray(array)
        fits = data.dtype == self.dtype and data.ndim == 2 and data.shape[1] == 4
        got = f"{data.dtype} of shape {data.shape}"
        require(fits, f"writing {self.label}", got, f"{self.dtype} of shape (n, 4)")
        fits = 0 <= first <= self.count - len(data)
        got = f"{len(data)} texels at {first}"
        require(fits, f"writing {self.label}", got, f"at most {self.count}")
        self.live("writing")
        done = 0
        with self.device.guard(f"writing {self.label}"):
            while done < len(data):
                row, column = divmod(first + done, TEXEL_WIDTH)
                left = len(data) - done
                rows = left // TEXEL_WIDTH if column == 0 else 0
                size = rows * TEXEL_WIDTH or min(left, TEXEL_WIDTH - column)
                self.device.gpu.queue.write_texture(
                    {"texture": self.gpu, "origin": (column, row, 0)},
                    data[done : done + size],
                    {"bytes_per_row": _BYTES * TEXEL_WIDTH, "rows_per_image": max(rows, 1)},
                    (min(size, TEXEL_WIDTH), max(rows, 1), 1),
                )
                done += size

    def read(self) -> npt.NDArray[Any]:
        """(count,4) numbers; waits until the device has finished."""
        gpu = self.live("reading")
        rows = -(-self.count // TEXEL_WIDTH)
        if rows == 0:
            return np.zeros((0, 4), self.dtype)
        with self.device.guard(f"reading {self.label}"):
            data = self.device.gpu.queue.read_texture(
                {"texture": gpu},
                {"bytes_per_row": _BYTES * TEXEL_WIDTH, "rows_per_image": rows},
                (TEXEL_WIDTH, rows, 1),
            )
        return np.frombuffer(data, self.dtype).reshape(-1, 4)[: self.count]


class TexelPool:
    """Texels of a device that one frame leaves for the next one."""

    def __init__(self, device: DeviceContext) -> None:
        self.device = device
        self._texels: dict[str, Texels] = {}
        self.notes: dict[str, object] = {}
        """What others keep on the device from one frame to the next, as long as there is room."""

    def texels(self, count: int, fmt: str, label: str) -> Texels:
        """At least ``count`` texels for one frame after the other: the last of that label if it
        suits.

        What they hold is good until the next ones of that label are asked for.
        """
        kept = self._texels.pop(label, None)
        if kept is None or kept.format != fmt or not count <= kept.count <= 4 * count + TEXEL_WIDTH:
            del kept
            kept = Texels(self.device, count, fmt, label)
        self._texels[label] = kept
        return kept

    def free(self) -> None:
        """Free all that waits."""
        self._texels.clear()
        self.notes.clear()
