"""Every error that gpusim raises on purpose.

::

    GpusimError                      exit code
      InputError (ValueError)        2   an argument of the Python API is wrong
      SceneError                     2   a scene file is wrong; lists every fault
      NotConverged                   3   a solver stopped short of its tolerance
      DeviceError                    4
        NoAdapter                    4   no usable Vulkan adapter
        DeviceLost                   4   the device went away while working
        OutOfDeviceMemory            4   refused before anything was allocated
      TwinMismatch                   5   a kernel disagrees with its NumPy twin

A message says what is wrong, where, what was got and what was expected; `require` says it so, and
`nearest_name` what was probably meant.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gpusim.printable import printable

if TYPE_CHECKING:
    import numpy as np

__all__ = [
    "DeviceError",
    "DeviceLost",
    "Fault",
    "GpusimError",
    "InputError",
    "NoAdapter",
    "NotConverged",
    "OutOfDeviceMemory",
    "SceneError",
    "TwinMismatch",
]

_SHOWN = 50  # faults of a scene; who mends those sees the others


class GpusimError(Exception):
    """Base of the tree; ``exit_code`` is what the command line ends with.

    Examples
    --------
    >>> try:
    ...     gs.mesh.box(size=(1, 1, -1), divisions=(2, 2, 2))
    ... except gs.GpusimError as error:
    ...     print(error.exit_code)
    2
    """

    exit_code = 1

    def __str__(self) -> str:
        """The message; what a terminal would obey in it is escaped."""
        return printable(super().__str__(), keep="\n")


class InputError(GpusimError, ValueError):
    """An argument has the wrong shape, type, range or meaning.

    Examples
    --------
    >>> gs.mesh.box(size=(1, 1, -1), divisions=(2, 2, 2))
    Traceback (most recent call last):
        ...
    gpusim.errors.InputError: box: size; got (1, 1, -1); expected 3 numbers > 0
    """

    exit_code = 2


@dataclass(frozen=True)
class Fault:
    """One thing wrong in a scene file: where (key path), what, got, expected, nearest key.

    ``place`` is the key path with names in place of indices, if it has any.

    Examples
    --------
    >>> print(gs.errors.Fault("camera[0].focal_mm", "wrong value", got="-50", expected="above 0"))
    camera[0].focal_mm: wrong value; got -50; expected above 0
    """

    key: str
    problem: str
    got: str = ""
    expected: str = ""
    hint: str = ""
    place: str = ""

    def __str__(self) -> str:
        text = f"{self.place or self.key}: {self.problem}"
        if self.got:
            text += f"; got {self.got}"
        if self.expected:
            text += f"; expected {self.expected}"
        if self.hint:
            text += f" ({self.hint})"
        return printable(text)


class SceneError(GpusimError):
    """A scene can't be used. ``faults`` holds everything that is wrong with it, and there are
    ``more`` that nobody looked at. The message shows the first ones.

    Examples
    --------
    >>> try:
    ...     gs.load_scene("bar.toml", {"camera.0.focal_mm": -50})
    ... except gs.SceneError as error:
    ...     print(error.faults[0].key)
    camera.0.focal_mm
    """

    exit_code = 2

    def __init__(self, source: str, faults: Sequence[Fault], more: int = 0) -> None:
        self.source = source
        self.faults = tuple(faults)
        count = len(self.faults) + more
        head = f"{printable(source)}: {count} fault{'s' if count != 1 else ''}"
        lines = [f"  {fault}" for fault in self.faults[:_SHOWN]]
        if count > len(lines):
            lines.append(f"  and {count - len(lines)} more")
        super().__init__("\n".join([head, *lines]))


class NotConverged(GpusimError):
    """A solver stopped before it reached its tolerance; the message says why.

    Examples
    --------
    >>> issubclass(gs.NotConverged, gs.GpusimError), gs.NotConverged.exit_code
    (True, 3)
    """

    exit_code = 3


class DeviceError(GpusimError):
    """The device can't do what was asked.

    Examples
    --------
    >>> issubclass(gs.NoAdapter, gs.DeviceError), gs.DeviceError.exit_code
    (True, 4)
    """

    exit_code = 4


class NoAdapter(DeviceError):
    """No Vulkan adapter was found, or not the one asked for.

    Examples
    --------
    >>> try:
    ...     gs.Device(adapter="of no name")
    ... except gs.NoAdapter:
    ...     print("run `gpusim doctor`")
    run `gpusim doctor`
    """


class DeviceLost(DeviceError):
    """The device went away while it was working.

    Examples
    --------
    >>> issubclass(gs.DeviceLost, gs.DeviceError)
    True
    """


class OutOfDeviceMemory(DeviceError):
    """The request is larger than the device takes; nothing was allocated.

    Examples
    --------
    >>> try:
    ...     gs.Device(memory_limit=1000).empty(10_000, "large")
    ... except gs.OutOfDeviceMemory:
    ...     print("nothing was allocated")
    nothing was allocated
    """


class TwinMismatch(GpusimError):
    """A kernel and its NumPy twin disagree by more than the tolerance table allows.

    Examples
    --------
    >>> gs.TwinMismatch.exit_code
    5
    """

    exit_code = 5


def require(fits: bool | np.bool_, what: str, got: object, expected: str) -> None:
    """Raises InputError "what; got …; expected …" unless an argument ``fits``."""
    if not fits:
        raise InputError(f"{what}; got {got}; expected {expected}")


def similar_name(name: str, names: Iterable[str]) -> str:
    """The one of ``names`` that ``name`` may be a misspelling of, else ""; case doesn't count."""
    lower = {one.lower(): one for one in names}
    near = difflib.get_close_matches(name.lower(), list(lower), 1, 0.6)
    return lower[near[0]] if near else ""


def nearest_name(name: str, names: Iterable[str]) -> str:
    """ " (did you mean x?)" if one of the ``names`` is close, else ""."""
    near = similar_name(name, names)
    return f" (did you mean {near}?)" if near else ""


def __dir__() -> list[str]:
    return sorted(__all__)
