"""Finding the adapter: Vulkan (or the system's native interface), the fastest first."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import glob
from typing import Any

import wgpu
from wgpu.backends.wgpu_native import ffi
from wgpu.backends.wgpu_native.extras import set_instance_extras

from gpusim.errors import NoAdapter
from gpusim.gpu.declarations import parse_names_alone
from gpusim.parallel.machine import available_memory

# what a graphics card's driver makes under Linux, Windows' subsystem included
_HARDWARE = ("/dev/dri/renderD*", "/dev/nvidia*", "/dev/dxg", "/dev/mali*", "/dev/kgsl*")
_ORDER = {"DiscreteGPU": 0, "IntegratedGPU": 1, "VirtualGPU": 2, "Unknown": 3, "CPU": 4}


def find_adapter(name: str | None) -> Any:
    """The first adapter with ``name`` in its summary, or the fastest kind when it is None; a number
    counts those of that kind round and round, so that many processes share them.

    Raises
    ------
    NoAdapter
    """
    parse_names_alone(ffi)
    try:
        with _no_display():
            # "Primary" leaves OpenGL out, whose start-up opens window systems and prints; an
            # instance that somebody else made before is taken as it is
            with suppress(RuntimeError):
                set_instance_extras(backends=["Primary"])
            adapters = wgpu.gpu.enumerate_adapters_sync()
    except Exception as error:
        raise NoAdapter(f"no Vulkan adapter: {error}") from error
    adapters = [a for a in adapters if a.info.get("backend_type") != "OpenGL"]
    adapters.sort(key=_kind)
    if not adapters:
        raise NoAdapter(
            "no Vulkan adapter found; install a driver (Debian/Ubuntu: apt-get install "
            "mesa-vulkan-drivers libvulkan1 works on any machine, without a GPU too)"
        )
    if name is None:
        return adapters[0]
    if name.isdecimal():
        alike = [a for a in adapters if _kind(a) == _kind(adapters[0])]
        return alike[int(name) % len(alike)]
    for adapter in adapters:
        if name.lower() in str(adapter.summary).lower():
            return adapter
    have = "; ".join(str(a.summary) for a in adapters)
    raise NoAdapter(f"adapter; got {name!r}; expected part of one of: {have}")


def _kind(adapter: Any) -> int:
    """The slower an adapter's kind, the larger."""
    return _ORDER.get(str(adapter.info.get("adapter_type")), 3)


def software_adapter() -> bool:
    """Whether the adapter that would be used is the CPU itself (lavapipe), or there is none."""
    named = os.environ.get("GPUSIM_ADAPTER") or None
    if named is None and sys.platform == "linux" and not any(map(glob, _HARDWARE)):
        return True  # asking the drivers takes a third of a second
    try:
        adapter = find_adapter(named)
    except NoAdapter:
        return True
    return is_processor(dict(adapter.info))


def is_processor(info: dict[str, Any]) -> bool:
    """Whether an adapter is the processor itself, by what wgpu says of it."""
    return str(info.get("adapter_type")) == "CPU"


@contextmanager
def _no_display() -> Iterator[None]:
    """Keep Mesa's device-selection layer from complaining that no desktop session runs.

    The layer asks Wayland for the desktop's GPU while adapters are listed; libwayland prints
    "XDG_RUNTIME_DIR is invalid" to the terminal unless that holds some absolute path.
    """
    if "XDG_RUNTIME_DIR" in os.environ or os.name != "posix":
        yield
        return
    os.environ["XDG_RUNTIME_DIR"] = os.devnull
    try:
        yield
    finally:
        del os.environ["XDG_RUNTIME_DIR"]


def free_memory(info: dict[str, Any]) -> int | None:
    """Bytes that a CPU adapter may take (90 % of what is free); None: the driver decides."""
    available = available_memory() if is_processor(info) else None
    return None if available is None else available * 9 // 10
