"""The programs of a device, each compiled once: by who asks for it first, or in threads before.

Translating a program takes 0.05 to 3 s of C code, during which Python goes on. Who knows what will
be asked for lets it be compiled meanwhile, as many programs at a time as there are processors.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import cached_property
from threading import Lock, local, main_thread
from typing import Any, cast

from gpusim.gpu.adapter import is_processor
from gpusim.gpu.context import DeviceContext
from gpusim.gpu.kernel import Kernel
from gpusim.gpu.priming import CompiledPrograms, prime
from gpusim.gpu.raster import Raster
from gpusim.gpu.wgsl import Module, load
from gpusim.parallel.machine import processors

Key = tuple[Hashable, ...]
"""(name, entry, constants) of a kernel, (name, entries, constants, formats, depth) of a raster."""


def program_key(
    name: str, entry: Hashable, constants: dict[str, float] | None, *targets: Hashable
) -> Key:
    """What a program is known by; ``targets``: formats and depth of a raster."""
    return name, entry, tuple(sorted((constants or {}).items())), *targets


class Programs:
    """What has been compiled for ``device``.

    ``asked``: every program that was asked for, in order, since that was emptied last.
    """

    def __init__(self, device: DeviceContext) -> None:
        self.device = device
        self.asked: dict[Key, None] = {}
        self._made: dict[Hashable, Future[Any]] = {}
        self._lock = Lock()
        self._threads: list[ThreadPoolExecutor] = []
        self._own = local()  # of each thread: programs of a device on which they are primed

    def program(self, key: Key) -> Any:
        """The kernel or raster of a key, compiled now if it isn't there."""
        self.asked.setdefault(key)
        return self._once(key, lambda: self._compiled(*cast(Any, key)))

    def module(self, module: Module) -> Any:
        """The wgpu module of a shader file, compiled once however many entries it has."""
        return self._once(("module", module.name), lambda: self._module(module))

    def begin(self, programs: Iterable[Sequence[Any]]) -> None:
        """Compile programs, as ``asked`` or read from JSON, in threads: those that nobody has asked
        for when it is their turn. Who asks for one that is being compiled waits for it. Faults are
        left to who asks.
        """
        keys = [key for key in map(_hashable, programs) if key not in self._made]
        if not keys:
            return
        threads = ThreadPoolExecutor(processors(), "gpusim.compile")
        for key in keys:
            threads.submit(self._compile, key)
        threads.shutdown(wait=False)  # once all is done they end, and their devices with them
        self._threads.append(threads)

    def stop(self) -> None:
        """Begin with no further program of those to be compiled in threads."""
        while self._threads:
            self._threads.pop().shutdown(wait=False, cancel_futures=True)

    def clear(self) -> None:
        """Forget everything that was compiled."""
        with self._lock:
            self._made.clear()

    @cached_property
    def _primed_before(self) -> CompiledPrograms:
        return CompiledPrograms(self.device.name)

    def _compile(self, key: Key) -> None:
        """What a thread does with a program."""
        if key in self._made or not main_thread().is_alive():
            return
        # it may be of another version of gpusim, or have a fault that will be met again
        with suppress(Exception):
            self._once(key, lambda: self._primed(key))

    def _primed(self, key: Key) -> Any:
        if is_processor(self.device.info):
            code = load(str(key[0]), self.device.real, self.device.shaders).code
            if self._primed_before.lacks(code, key):
                if not hasattr(self._own, "programs"):
                    self._own.programs = Programs(self.device.another())
                prime(self._own.programs.program(key))
                self._primed_before.add(code, key)
        return self._compiled(*cast(Any, key))

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


def _hashable(value: Any) -> Any:
    return tuple(_hashable(one) for one in value) if isinstance(value, list | tuple) else value
