"""``python -m gpusim``."""

from __future__ import annotations

import sys

from gpusim.cli import main

sys.exit(main())
