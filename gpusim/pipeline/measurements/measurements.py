"""Every kind of measurement that a scene can ask for, behind one pair of functions."""

from __future__ import annotations

from pathlib import Path

from gpusim.errors import GpusimError
from gpusim.files.input_file import Reader
from gpusim.pipeline.build.scene_objects import SceneObjects
from gpusim.pipeline.measurements.deflection import DeflectionResult
from gpusim.pipeline.measurements.deflection_stage import measure_deflection
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.measurements.stereo import measure_stereo
from gpusim.pipeline.measurements.stereo_result import StereoResult
from gpusim.scene import Scene
from gpusim.scene.description import model as m

__all__ = ["Result", "read", "run_measure"]

Result = DeflectionResult | StereoResult


def run_measure(spec: m.Measure, scene: Scene, objects: SceneObjects, sources: Sources) -> Result:
    """Do one measurement."""
    if isinstance(spec, m.Deflection):
        return measure_deflection(spec, scene, objects.bodies, objects.displacement, sources.image)
    if isinstance(spec, m.Stereo):
        return measure_stereo(spec, scene, objects, sources)
    raise GpusimError(f"measure {spec.name!r}: compares variants; the scene has none")


def read(spec: m.Measure, folder: Path, reader: Reader) -> Result:
    """What an earlier run wrote for ``spec``; ``reader``: how its files are read."""
    if isinstance(spec, m.Deflection):
        return DeflectionResult.read(folder, spec, reader)
    if isinstance(spec, m.Stereo):
        return StereoResult.read(folder, spec.name, reader)
    raise GpusimError(f"measure {spec.name!r}: compares variants; the scene has none")
