"""The one place where the version stands; the wheel, the command line and reports read it."""

from __future__ import annotations

__version__ = "0.1.0"
