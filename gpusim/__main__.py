"""``python -m gpusim``, and where the command ``gpusim`` begins."""

from __future__ import annotations

import signal
import sys

from gpusim.interrupts import end_at_once


def main() -> int:
    """Import the command line and run it; returns the exit code."""
    end_at_once()
    from gpusim.cli import main as command_line

    try:
        return command_line()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done and said


if __name__ == "__main__":
    sys.exit(main())
