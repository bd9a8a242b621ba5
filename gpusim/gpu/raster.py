"""Raster programs (vertex + fragment) and the textures that they draw into."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import wgpu

from gpusim.errors import InputError, OutOfDeviceMemory
from gpusim.gpu.context import DeviceContext
from gpusim.gpu.kernel import Program
from gpusim.gpu.wgsl import Module

_OVER = {
    "color": {"src_factor": "src-alpha", "dst_factor": "one-minus-src-alpha", "operation": "add"},
    "alpha": {"src_factor": "one", "dst_factor": "one-minus-src-alpha", "operation": "add"},
}


class Texture:
    """A two-dimensional render target that kernels can read."""

    def __init__(
        self, device: DeviceContext, width: int, height: int, fmt: str, label: str
    ) -> None:
        limit = device.limits["max-texture-dimension-2d"]
        if not (0 < width <= limit and 0 < height <= limit):
            got = f"{width}x{height}"
            raise OutOfDeviceMemory(f"texture {label}; got {got}; expected at most {limit} a side")
        usage = wgpu.TextureUsage
        self.width, self.height, self.format = width, height, fmt
        self.nbytes = width * height * _texel_bytes(fmt)
        # copies to buffers need rows of whole 256 bytes
        self.stride = -(-width * _texel_bytes(fmt) // 256) * 256
        self.gpu = device.allocate_texture(
            label, (width, height), fmt,
            usage.RENDER_ATTACHMENT | usage.TEXTURE_BINDING | usage.COPY_SRC, self.nbytes,
        )  # fmt: skip
        self.view = self.gpu.create_view()


def _texel_bytes(fmt: str) -> int:
    """Bytes per pixel from a WebGPU format's name: rgba16float, r32uint, depth32float, ..."""
    match = re.match(r"(rgba|bgra|rg|r|depth)(\d+)", fmt)
    if match is None:
        raise InputError(f"texture format; got {fmt!r}; expected one like 'rgba32float'")
    channels = {"rgba": 4, "bgra": 4, "rg": 2}.get(match.group(1), 1)
    return channels * int(match.group(2)) // 8


class Raster(Program):
    """A triangle-list pipeline with a float32 reversed depth buffer (nearer is larger).

    Vertices are pulled from storage buffers by index; ``entries`` are (vertex, fragment).
    ``compiled`` gives the wgpu module of a shader file.
    ``depth``: how what is drawn compares with what is there; only "greater" changes the depth.
    "none" has no depth buffer: what is drawn last is seen. "over" has none either, and colours
    cover what is there by their alpha.
    """

    def __init__(
        self,
        device: DeviceContext,
        module: Module,
        color_formats: tuple[str, ...],
        compiled: Callable[[Module], Any],
        *,
        entries: tuple[str, str],
        constants: dict[str, float],
        depth: str,
    ) -> None:
        self.name, self.formats, self.depth = module.name, color_formats, depth
        super().__init__(device, module, dict(zip(("vertex", "fragment"), entries, strict=True)),
                         constants)  # fmt: skip
        with device.guard(f"raster {module.name}"):
            shader = {"module": compiled(module), "constants": constants}
            blend = {"blend": _OVER} if depth == "over" else {}
            targets = [{"format": fmt, **blend} for fmt in color_formats]
            compared = {"format": "depth32float", "depth_write_enabled": depth == "greater",
                        "depth_compare": depth}  # fmt: skip
            self.pipeline: Any = device.gpu.create_render_pipeline(
                label=f"gpusim.{module.name}",
                layout=self.layout.pipeline,
                vertex={**shader, "entry_point": entries[0], "buffers": []},
                fragment={**shader, "entry_point": entries[1], "targets": targets},
                primitive={"topology": "triangle-list", "cull_mode": "none"},
                depth_stencil=None if depth in ("none", "over") else compared,
            )
