"""Every kind of measurement that a scene can ask for, behind one pair of functions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy.typing as npt

from gpusim.errors import GpusimError
from gpusim.input_file import Reader
from gpusim.measure.targets import Sighting
from gpusim.pipeline.deflection import DeflectionResult
from gpusim.pipeline.kept import KeptMarkers
from gpusim.pipeline.measuring import measure_deflection
from gpusim.pipeline.stereo import measure_stereo
from gpusim.pipeline.stereo_result import StereoResult
from gpusim.pipeline.things import Things
from gpusim.scene import Scene
from gpusim.scene import model as m

__all__ = ["Result", "measured", "read"]

Result = DeflectionResult | StereoResult
Image = Callable[[str, int], npt.NDArray[Any]]
Corners = Callable[[str, int], Sighting]


def measured(
    spec: m.Measure,
    scene: Scene,
    things: Things,
    image: Image,
    corners: Corners,
    markers: KeptMarkers,
) -> Result:
    """Do one measurement.

    ``image`` gives a camera's picture in a frame, ``corners`` what was found of the board
    in a calibration pose, ``markers`` follows those of a rig.
    """
    if isinstance(spec, m.Deflection):
        return measure_deflection(spec, scene, things.bodies, things.displacement, image)
    if isinstance(spec, m.Stereo):
        return measure_stereo(spec, scene, things, image, corners, markers)
    raise GpusimError(f"measure {spec.name!r}: compares variants; the scene has none")


def read(spec: m.Measure, folder: Path, reader: Reader) -> Result:
    """What an earlier run wrote for ``spec``; ``reader``: how its files are read."""
    if isinstance(spec, m.Deflection):
        return DeflectionResult.read(folder, spec, reader)
    if isinstance(spec, m.Stereo):
        return StereoResult.read(folder, spec.name, reader)
    raise GpusimError(f"measure {spec.name!r}: compares variants; the scene has none")
