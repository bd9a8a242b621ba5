"""What a structure does in its last loaded frame: support forces, energy balance, stress."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gpusim.report.numbers import json_number

__all__ = ["BodyForce", "Mechanics", "StressPeak"]

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class BodyForce:
    """A force (N) on a body: of the support ``name``, or of all its loads together."""

    body: str
    name: str
    force: Triple


@dataclass(frozen=True)
class StressPeak:
    """The greatest von Mises stress (Pa) of a body, and the node where it is (m).

    ``error_relative`` estimates the stress error of the whole body (Zienkiewicz-Zhu, energy norm);
    at a re-entrant corner or a point load the peak grows without bound as the mesh gets finer.
    """

    body: str
    von_mises: float
    position: Triple
    error_relative: float


@dataclass(frozen=True)
class Mechanics:
    """Forces and stress in ``frame``; ``energy_balance`` compares work and strain energy.

    ``stresses`` is empty where the scene doesn't ask for stress.
    """

    frame: int
    energy_balance: float
    reactions: tuple[BodyForce, ...] = ()
    loads: tuple[BodyForce, ...] = ()
    stresses: tuple[StressPeak, ...] = ()

    def content(self) -> dict[str, Any]:
        """For report.json; a number that isn't finite is null."""
        return {
            "frame": self.frame,
            "energy_balance": json_number(self.energy_balance),
            "reactions": [
                {"body": f.body, "support": f.name, "force_N": [json_number(v) for v in f.force]}
                for f in self.reactions
            ],
            "loads": [
                {"body": f.body, "force_N": [json_number(v) for v in f.force]} for f in self.loads
            ],
            "stress": [
                {
                    "body": peak.body,
                    "von_mises_Pa": json_number(peak.von_mises),
                    "position_m": [json_number(v) for v in peak.position],
                    "error_relative": json_number(peak.error_relative),
                }
                for peak in self.stresses
            ],
        }
