"""What a run of the hostile suites says of itself."""

from __future__ import annotations

from tests.hostile.amount import SEED, SHARE


def pytest_report_header() -> str:
    return f"hostile: SEED={SEED} HOSTILE_SHARE={SHARE:g}"
