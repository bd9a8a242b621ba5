"""Programs that software drivers have compiled before their first use.

Mesa lavapipe translates a program to machine code when it first runs, one program after the other,
and keeps the code on disk. Run once for nothing on another device of the same driver, in a thread
of its own, a program is there when the first picture asks for it: all processors compile at once.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import wgpu

from gpusim.files.cache_files import open_cached
from gpusim.gpu.context import DeviceContext
from gpusim.gpu.kernel import Kernel
from gpusim.gpu.raster import Raster
from gpusim.gpu.wgsl import Binding

UNIFORM_BYTES = 1 << 16
STORAGE_BYTES = 1 << 16

_MOST_BYTES = 10_000_000  # of the list of programs

TEXELS = (4096, 3)
"""Width and height of textures that hold arrays: drivers compile for powers of two apart."""


def prime(program: Kernel | Raster) -> None:
    """Let the driver compile a program for its device: run it over nothing, on zeros."""
    device = program.layout.device
    groups = program.layout.bind_groups(partial(_zero, device))
    with device.guard(f"compiling {program.name}"):
        encoder = device.gpu.create_command_encoder()
        if isinstance(program, Kernel):
            work = encoder.begin_compute_pass()
        else:
            work = encoder.begin_render_pass(**_attachments(program))
        work.set_pipeline(program.pipeline)
        for index, group in enumerate(groups):
            work.set_bind_group(index, group)
        if isinstance(program, Kernel):
            # no groups, which the driver learns too late to do without the program
            usage = wgpu.BufferUsage.INDIRECT | wgpu.BufferUsage.STORAGE
            work.dispatch_workgroups_indirect(device.gpu.create_buffer(size=16, usage=usage), 0)
        else:
            work.draw(3)
        work.end()
        device.gpu.queue.submit([encoder.finish()])
    device.sync()


def _zero(device: DeviceContext, binding: Binding) -> Any:
    if binding.space == "uniform":
        usage = wgpu.BufferUsage.UNIFORM
        return {"buffer": device.gpu.create_buffer(size=UNIFORM_BYTES, usage=usage)}
    if binding.space == "storage":
        usage = wgpu.BufferUsage.STORAGE
        return {"buffer": device.gpu.create_buffer(size=STORAGE_BYTES, usage=usage)}
    usage = wgpu.TextureUsage.TEXTURE_BINDING
    if binding.type.startswith("texture_depth"):
        usage |= wgpu.TextureUsage.RENDER_ATTACHMENT
        return _texture(device, "depth32float", usage, (3, 3))
    words = "u32" if "<u32>" in binding.type or "uint" in binding.type else "f32"
    if binding.type.startswith("texture_storage"):
        usage |= wgpu.TextureUsage.STORAGE_BINDING
    return _texture(device, {"u32": "rgba32uint", "f32": "rgba32float"}[words], usage, TEXELS)


def _texture(device: DeviceContext, fmt: str, usage: int, size: tuple[int, int]) -> Any:
    return device.gpu.create_texture(size=(*size, 1), format=fmt, usage=usage).create_view()


def _attachments(raster: Raster) -> dict[str, Any]:
    """Targets of a few pixels."""
    usage = wgpu.TextureUsage.RENDER_ATTACHMENT

    def target(fmt: str) -> Any:
        return _texture(raster.layout.device, fmt, usage, (3, 3))

    colors = [
        {"view": target(fmt), "load_op": "clear", "store_op": "store", "clear_value": (0, 0, 0, 0)}
        for fmt in raster.formats
    ]
    if raster.depth in ("none", "over"):
        return {"color_attachments": colors}
    depth = {
        "view": target("depth32float"), "depth_load_op": "clear", "depth_store_op": "store",
        "depth_clear_value": 0.0,
    }  # fmt: skip
    return {"color_attachments": colors, "depth_stencil_attachment": depth}


class CompiledPrograms:
    """Which programs a driver has in its cache, as far as `prime` has put them there.

    A list beside Mesa's own files, so that it goes where they go; without such a folder nothing can
    be kept, and nothing is known.
    """

    def __init__(self, driver: str) -> None:
        self._driver, self._path = driver, _cache_folder(os.environ)
        self._known: set[str] = set()
        if self._path is not None:
            self._path /= "gpusim-programs.txt"
            with suppress(OSError, UnicodeDecodeError):
                with open_cached(self._path, _MOST_BYTES) as stream:
                    self._known.update(stream.read().decode().split())

    def lacks(self, code: str, key: object) -> bool:
        """Whether it is worth while to `prime` a program: its WGSL, and what it was made by."""
        return self._path is not None and self._name(code, key) not in self._known

    def add(self, code: str, key: object) -> None:
        """Note that a program was compiled."""
        if self._path is None:
            return
        with suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with open_cached(self._path, _MOST_BYTES, append=True) as stream:
                stream.write(f"{self._name(code, key)}\n".encode())
        self._known.add(self._name(code, key))

    def _name(self, code: str, key: object) -> str:
        return hashlib.sha256(f"{self._driver}\n{key}\n{code}".encode()).hexdigest()[:32]


def _cache_folder(environment: Mapping[str, str]) -> Path | None:
    """Where Mesa keeps machine code, as its environment variables say; None: nowhere."""
    for name in ("MESA_SHADER_CACHE_DISABLE", "MESA_GLSL_CACHE_DISABLE"):
        if environment.get(name, "").lower() in ("1", "true", "yes", "y"):
            return None
    for name in ("MESA_SHADER_CACHE_DIR", "MESA_GLSL_CACHE_DIR", "XDG_CACHE_HOME"):
        if environment.get(name):
            return Path(environment[name]) / "mesa_shader_cache"
    home = environment.get("HOME")
    return Path(home) / ".cache" / "mesa_shader_cache" if home else None
