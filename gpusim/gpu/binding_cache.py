"""Values that many programs bind: bindings are made once for each program, and used again."""

from __future__ import annotations

from typing import Any

from gpusim.gpu.device import Device
from gpusim.gpu.kernel import Bindings, Kernel
from gpusim.gpu.recording import Recording


class Bound:
    """``values`` by their WGSL names, of which each program takes those that it uses."""

    def __init__(self, device: Device, values: dict[str, Any]) -> None:
        self._device, self._values = device, values
        self._made: dict[tuple[object, ...], tuple[Kernel, Bindings]] = {}

    def run(
        self,
        recording: Recording,
        name: str,
        entry: str = "main",
        constants: dict[str, float] | None = None,
        **sizes: Any,
    ) -> None:
        """Run a program over the ``sizes`` that `Recording.dispatch` takes.

        Raises
        ------
        InputError
            None of the sizes is given, or a value is missing that the program uses.
        """
        key = name, entry, tuple(sorted((constants or {}).items()))
        if key not in self._made:
            kernel = self._device.kernel(name, entry, constants)
            self._made[key] = kernel, kernel.bind_used(**self._values)
        recording.dispatch(*self._made[key], **sizes)
