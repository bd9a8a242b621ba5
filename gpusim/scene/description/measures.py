"""What is measured in a scene's images, and the states that are compared: SI, as in ``model``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

__all__ = ["Damage", "Deflection", "Measure", "Published", "Stereo", "Variant"]


@dataclass(frozen=True)
class Published:
    """A published relative error (1) and its source."""

    error: float
    source: str


@dataclass(frozen=True)
class Deflection:
    """Deflection line of the marker paints ``groups``, from the clamp; ``static`` ones stand still.

    ``direction`` ("+x" … "-z") is the positive sense; ``subset`` (px) is None to choose it.
    """

    name: str
    camera: str
    groups: tuple[str, ...]
    static: tuple[str, ...]
    subset: int | None
    direction: str
    published: Published | None = None


@dataclass(frozen=True)
class Stereo:
    """Markers of the paints ``groups`` in space, by ``cameras`` that [calibration] calibrates.

    ``lens`` is the model that the calibration finds; ``static`` and ``subset`` as for `Deflection`.
    """

    name: str
    cameras: tuple[str, ...]
    groups: tuple[str, ...]
    static: tuple[str, ...]
    lens: str
    subset: int | None
    published: Published | None = None


@dataclass(frozen=True)
class Damage:
    """Slope changes of the deflection ``of``, against a ``reference``.

    ``tolerance``, ``clearance`` in m; a clearance of None is the depth of the notched member.
    """

    name: str
    of: str
    reference: str
    tolerance: float
    significance: float
    most: int
    clearance: float | None


Measure = Deflection | Stereo | Damage


@dataclass(frozen=True)
class Variant:
    """A state: ``changes`` are dotted paths and the values that they get, as in the file."""

    name: str
    changes: dict[str, Any] = field(hash=False)
