"""Where numbers are made when nobody says so: one decision for everything public.

``"auto"`` takes the device where an adapter is found and the NumPy twins elsewhere, with one
warning; ``"gpu"`` insists on a device, ``"numpy"`` on the twins.
"""

from __future__ import annotations

import os
import warnings
from functools import cache

from gpusim.errors import NoAdapter
from gpusim.gpu.adapter import find_adapter
from gpusim.gpu.device import Device, default_device
from gpusim.validation import require

BACKENDS = ("auto", "gpu", "numpy")


def working_device(what: str, backend: str, device: Device | None = None) -> Device | None:
    """The device to work on, or None for the NumPy twins.

    A ``device`` that is given is taken, but for ``"numpy"``. ``what`` names the caller.

    Raises
    ------
    InputError, NoAdapter
        Not a backend; ``"gpu"`` and no adapter.
    """
    if chosen_backend(what, backend, device) == "numpy":
        return None
    return device if device is not None else default_device()


def chosen_backend(what: str, backend: str, device: Device | None = None) -> str:
    """``"gpu"`` or ``"numpy"`` for any of `BACKENDS`, without opening a device."""
    known = backend in BACKENDS
    require(known, f"{what} backend", repr(backend), "'auto', 'gpu' or 'numpy'")
    known = isinstance(device, Device | None)
    require(known, f"{what} device", repr(device), "a Device, or None")
    if backend != "auto":
        return backend
    if device is not None:
        return "gpu"
    missing = _missing(os.environ.get("GPUSIM_ADAPTER") or None)
    if missing is None:
        return "gpu"
    _warn_once(missing)
    return "numpy"


@cache
def _missing(name: str | None) -> str | None:
    """Why there is no adapter; None if there is one."""
    try:
        find_adapter(name)
    except NoAdapter as error:
        return str(error)
    return None


@cache
def _warn_once(missing: str) -> None:
    warnings.warn(
        f"{missing}. NumPy on the processor does the work meanwhile, slower (backend 'numpy' "
        "chooses that without this warning, 'gpu' insists on an adapter)",
        UserWarning,
        stacklevel=4,
    )
