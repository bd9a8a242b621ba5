"""The programs of a device, each compiled once: by who asks for it first, or in a thread before.

Translating a program takes 0.05 to 0.5 s of C code, during which Python goes on. Who knows what
will be asked for, from an earlier run, lets it be compiled meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import Future
from threading import Event, Lock
from typing import Any, cast

from gpusim.gpu.context import DeviceContext
from gpusim.gpu.kernel import Kernel
from gpusim.gpu.raster import Raster
from gpusim.gpu.wgsl import Module, load

__all__ = ["Programs"]

Key = tuple[Hashable, ...]
"""(name, entry, constants) of a kernel, (name, entries, constants, formats, depth) of a raster."""


class Programs:
    """What has been compiled for ``device``.

    ``asked``: every program that was asked for, in order, since that was emptied last.
    """

    def __init__(self, device: DeviceContext) -> None:
        self.device = device
        self.asked: dict[Key, None] = {}
        self._made: dict[Hashable, Future[Any]] = {}
        self._lock = Lock()

    def kernel(self, name: str, entry: str, constants: dict[str, float] | None) -> Kernel:
        """As `Device.kernel`."""
        key = (name, entry, _sorted(constants))
        self.asked.setdefault(key)
        found: Kernel = self._get(key)
        return found

    def raster(
        self,
        name: str,
        formats: tuple[str, ...],
        constants: dict[str, float] | None,
        entries: tuple[str, str],
        depth: str,
    ) -> Raster:
        """As `Device.raster`."""
        key = (name, entries, _sorted(constants), formats, depth)
        self.asked.setdefault(key)
        found: Raster = self._get(key)
        return found

    def module(self, module: Module) -> Any:
        """The wgpu module of a shader file, compiled once however many entries it has."""
        return self._once(("module", module.name), lambda: self._module(module))

    def compile(self, programs: Iterable[Sequence[Any]], enough: Event) -> None:
        """Compile programs, as ``asked`` or read from JSON, until ``enough`` is set.

        Faults are left to who asks for them.
        """
        for program in programs:
            if enough.is_set():
                return
            try:
                self._get(_hashable(program))
            except Exception:  # of another version of gpusim, or a fault that will be met again
                continue

    def clear(self) -> None:
        """Forget everything that was compiled."""
        with self._lock:
            self._made.clear()

    def _get(self, key: Key) -> Any:
        return self._once(key, lambda: self._compiled(*cast(Any, key)))

    def _once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What is made for ``key``, by the thread that asks first; an error isn't kept."""
        with self._lock:
            found = self._made.get(key)
            mine = found is None
            if found is None:
                found = self._made[key] = Future()
        if mine:
            try:
                found.set_result(make())
            except BaseException as error:
                with self._lock:
                    self._made.pop(key, None)
                found.set_exception(error)
        return found.result()

    def _compiled(
        self, name: str, entry: Any, constants: Any, formats: Any = None, depth: str = ""
    ) -> Kernel | Raster:
        module, values = load(name, self.device.real, self.device.shaders), dict(constants)
        if formats is None:
            return Kernel(self.device, module, entry, values, self.module)
        return Raster(
            self.device, module, formats, self.module,
            entries=entry, constants=values, depth=depth,
        )  # fmt: skip

    def _module(self, module: Module) -> Any:
        with self.device.guard(f"shader {module.name}"):
            return self.device.gpu.create_shader_module(
                label=f"gpusim.{module.name}", code=module.code
            )


def _sorted(constants: dict[str, float] | None) -> tuple[tuple[str, float], ...]:
    return tuple(sorted((constants or {}).items()))


def _hashable(value: Any) -> Any:
    return tuple(_hashable(one) for one in value) if isinstance(value, list | tuple) else value
