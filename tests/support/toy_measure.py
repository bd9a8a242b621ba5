"""A kind of measurement that gpusim doesn't have: the mean grey value of a camera's pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from gpusim.pipeline.measurements.kinds import Kind, Unloaded, register
from gpusim.pipeline.measurements.results import PointTable, Reported, Result
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.report import Measurement, Series
from gpusim.scene import Scene
from gpusim.scene.description.model import MeasureTable


class ToyTable(MeasureTable):
    """The mean grey value of every picture of a camera."""

    type: Literal["toy"]
    references: ClassVar[Mapping[str, str]] = {"camera": "camera"}
    least_frames = 1

    camera: str
    """Whose pictures."""
    expected_DN: Annotated[float, Field(gt=0)] = 100.0
    """What it should be."""


@dataclass(frozen=True, eq=False)
class ToyResult(Result):
    """``expected``: what the mean should be."""

    expected: float

    @property
    def warnings(self) -> list[str]:
        return [f"measure {self.name!r}: this is a toy"]

    def report(self, scene: Scene, out: Path) -> Reported:
        mean = self.table["measured_DN"][:, 0]
        true = np.full_like(mean, self.expected)
        name = f"{self.name}: mean grey value"
        return Reported(
            [Measurement.compare(name, "DN", float(mean[-1]), self.expected)],
            [Series(name, np.arange(0.0, len(mean)), mean, true, "frame", "mean grey value", "DN")],
        )


def measure_toy(spec: ToyTable, scene: Scene, objects: SceneObjects, sources: Sources) -> ToyResult:
    frames = {
        frame: {"measured_DN": np.array([sources.image(camera, frame).mean()])}
        for camera, frame in spec.pictures(len(scene.analysis.load_factors))
    }
    return ToyResult(spec.name, PointTable.of("camera", [spec.camera], frames), spec.expected_DN)


def doubts(spec: ToyTable, scene: Scene, unloaded: Unloaded) -> list[str]:
    """Said by plans, and once more in the report."""
    return [f"measure {spec.name!r}: toys measure {len(unloaded.surfaces)} surfaces badly"]


register(Kind(ToyTable, ToyResult, measure_toy, doubts))
