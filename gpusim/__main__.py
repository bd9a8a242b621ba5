"""``python -m gpusim``, and where the command ``gpusim`` begins."""

from __future__ import annotations

import sys

from gpusim.interrupts import end_at_once


def main() -> int:
    """Import the command line and run it; returns the exit code."""
    end_at_once()
    from gpusim.cli import main as command_line

    return command_line()


if __name__ == "__main__":
    sys.exit(main())
