"""JSON of what was measured."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

__all__ = ["plain_json"]


def plain_json(content: Any) -> str:
    """JSON knows no NaN: what wasn't measured is null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(one) for key, one in value.items()}
        if isinstance(value, list):
            return [plain(one) for one in value]
        return None if isinstance(value, float) and not np.isfinite(value) else value

    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"
