"""What the driver reports, turned into gpusim errors.

wgpu-py raises most faults from the call that caused them. Those that reach it between calls (a
lost device, an error seen by its polling thread) only go to its logger, where a program wouldn't
notice them: `pending` hands them to the next call. A fault that wgpu finds while *submitting*
ends the process (wgpu-native has no way to report it), so `Recording` checks before it submits.
"""

from __future__ import annotations

import logging
from collections import deque

from gpusim.errors import DeviceError, DeviceLost, OutOfDeviceMemory

_PREFIX = "Validation Error\n\nCaused by:\n"
_LOST = ("device is lost", "device was lost", "device lost")
_MEMORY = ("not enough memory", "out of memory", "outofmemory")


class _FaultLog(logging.Handler):
    """Keeps what wgpu-py only logs: the messages of its error handler."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.messages: deque[str] = deque(maxlen=16)

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one message (called by `logging`)."""
        if record.funcName == "log_error":
            self.messages.append(record.getMessage())


_log = _FaultLog()
logging.getLogger("wgpu").addHandler(_log)


def pending() -> list[str]:
    """Messages of faults that no call has raised yet; each is handed out once."""
    found = []
    while _log.messages:
        found.append(_log.messages.popleft())
    return found


def is_loss(message: str) -> bool:
    """Whether a message of wgpu says that a device went away."""
    return any(words in message.lower() for words in _LOST)


def translate(error: Exception | str, what: str) -> DeviceError:
    """The gpusim error for a fault of wgpu; ``what`` says what was being done."""
    text = str(error).removeprefix(_PREFIX).strip()
    if is_loss(text):
        return DeviceLost(f"{what}: the device was lost: {text}")
    if isinstance(error, MemoryError) or any(words in text.lower() for words in _MEMORY):
        return OutOfDeviceMemory(f"{what}: the driver has no memory left: {text}")
    return DeviceError(f"{what}: {text}")
