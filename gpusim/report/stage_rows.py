"""Stages as rows for readers: a camera's pictures that are alike are one row."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Protocol, TypeVar

SINGLE = 10
"""Frames of a camera, from the first, that are a row each."""
_PICTURE = re.compile(r"((?:.*/)?render/.*/(?:calib-)?)(\d+)")


class _Stage(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def state(self) -> str: ...
    @property
    def reason(self) -> str: ...


StageT = TypeVar("StageT", bound=_Stage)


def picture_number(name: str) -> tuple[str, int] | None:
    """The series that a stage's picture belongs to ("render/front/", "render/front/calib-"), and
    its number there; None for other stages."""
    found = _PICTURE.fullmatch(name)
    return None if found is None else (found[1], int(found[2]))


def stage_rows(stages: Sequence[StageT]) -> list[tuple[str, list[StageT]]]:
    """Names and stages of rows. Neighbours of one series, state and reason are one: all pictures of
    a calibration target, and frames from number ``SINGLE`` on."""
    rows: list[tuple[str, list[StageT]]] = []
    before: object = None
    for stage in stages:
        picture = picture_number(stage.name)
        alike = None
        if picture is not None and (picture[0].endswith("/calib-") or picture[1] >= SINGLE):
            alike = picture[0], stage.state, stage.reason
        if alike is not None and alike == before:
            row = rows[-1][1]
            row.append(stage)
            rows[-1] = f"{row[0].name}..{stage.name.removeprefix(alike[0])}", row
        else:
            rows.append((stage.name, [stage]))
        before = alike
    return rows
