"""A display without a screen (Xvfb), its picture, and a mouse and keyboard for it (XTest)."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import POINTER, byref, c_char_p, c_int, c_uint, c_ulong, c_void_p
from ctypes.util import find_library
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["XDisplay", "missing_display", "x_display"]

SIZE = (1000, 700)


class _XImage(ctypes.Structure):
    _fields_ = [
        ("width", c_int), ("height", c_int), ("xoffset", c_int), ("format", c_int),
        ("data", c_void_p), ("byte_order", c_int), ("bitmap_unit", c_int),
        ("bitmap_bit_order", c_int), ("bitmap_pad", c_int), ("depth", c_int),
        ("bytes_per_line", c_int), ("bits_per_pixel", c_int),
    ]  # fmt: skip


def missing_display() -> str:
    """What isn't there of all that this needs, or ""."""
    if shutil.which("Xvfb") is None:
        return "Xvfb is not installed"
    lacking = [name for name in ("X11", "Xtst") if find_library(name) is None]
    return f"no library {lacking[0]}" if lacking else ""


class XDisplay:
    """A connection to a display: what it shows, and what a user would do at it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.x: Any = ctypes.CDLL(find_library("X11"))
        self.test: Any = ctypes.CDLL(find_library("Xtst"))
        self.x.XOpenDisplay.restype = c_void_p
        self.x.XDefaultRootWindow.restype = c_ulong
        self.x.XGetImage.restype = POINTER(_XImage)
        self.x.XStringToKeysym.restype = c_ulong
        self.display = c_void_p(self.x.XOpenDisplay(c_char_p(name.encode())))
        assert self.display.value, f"no display {name}"
        self.root = c_ulong(self.x.XDefaultRootWindow(self.display))

    def picture(self) -> npt.NDArray[np.uint8]:
        """(H, W, 3): all of the screen."""
        width, height = SIZE
        found = self.x.XGetImage(
            self.display, self.root, 0, 0, c_uint(width), c_uint(height), c_ulong(0xFFFFFFFF), 2
        )
        image = found.contents
        raw = ctypes.string_at(image.data, image.bytes_per_line * height)
        self.x.XDestroyImage(found)
        rows = np.frombuffer(raw, np.uint8).reshape(height, -1)[:, : 4 * width]
        return np.ascontiguousarray(rows.reshape(height, width, 4)[:, :, 2::-1])

    def move(self, x: int, y: int) -> None:
        """Move the mouse to a place of the screen."""
        self._done(self.test.XTestFakeMotionEvent(self.display, -1, x, y, c_ulong(0)))

    def button(self, number: int, down: bool) -> None:
        """X counts left, middle, right; 4 and 5 are the wheel."""
        self._done(self.test.XTestFakeButtonEvent(self.display, number, int(down), c_ulong(0)))

    def click(self, number: int = 1) -> None:
        """Press and release a button."""
        self.button(number, True)
        self.button(number, False)

    def drag(self, start: tuple[int, int], stop: tuple[int, int], button: int = 1) -> None:
        """Move the mouse with a button down, in ten steps."""
        self.move(*start)
        self.button(button, True)
        for share in np.linspace(0.0, 1.0, 10):
            self.move(*(round(a + share * (b - a)) for a, b in zip(start, stop, strict=True)))
            time.sleep(0.03)
        self.button(button, False)

    def key(self, name: str) -> None:
        """Type a key by the name that X has for it: a, Home, period."""
        symbol = c_ulong(self.x.XStringToKeysym(c_char_p(name.encode())))
        code = self.x.XKeysymToKeycode(self.display, symbol)
        for down in (1, 0):
            self._done(self.test.XTestFakeKeyEvent(self.display, c_uint(code), down, c_ulong(0)))

    def clipboard(self) -> str:
        """What another program would paste now."""
        ask = "import glfw; glfw.init(); glfw.window_hint(glfw.VISIBLE, 0); " \
              "glfw.create_window(9, 9, '', None, None); " \
              "print(glfw.get_clipboard_string(None).decode())"  # fmt: skip
        return subprocess.run(
            [sys.executable, "-c", ask], env={**os.environ, "DISPLAY": self.name},
            capture_output=True, text=True, check=True, timeout=60.0,
        ).stdout  # fmt: skip

    def window_at(self, x: int, y: int) -> int:
        """The topmost window there, 0 for none."""
        child, at = c_ulong(0), (c_int(0), c_int(0))
        self.x.XTranslateCoordinates(
            self.display, self.root, self.root, x, y, byref(at[0]), byref(at[1]), byref(child)
        )
        return int(child.value)

    def close(self) -> None:
        self.x.XCloseDisplay(self.display)

    def _done(self, worked: int) -> None:
        assert worked
        self.x.XFlush(self.display)
        time.sleep(0.02)


@contextmanager
def x_display() -> Iterator[XDisplay]:
    """A display of its own."""
    reads, writes = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writes), "-screen", "0", f"{SIZE[0]}x{SIZE[1]}x24",
         "-nolisten", "tcp"],
        pass_fds=(writes,), stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(writes)
    try:
        with os.fdopen(reads) as answer:
            display = XDisplay(f":{answer.readline().strip()}")
        yield display
        display.close()
    finally:
        server.terminate()
        server.wait()
