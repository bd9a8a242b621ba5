"""Calibration files of the cameras, for other programs."""

from __future__ import annotations

from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.optics.calibration.calibration_files import calibration_files
from gpusim.pipeline.notes import notes_of
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.scene import Scene

_TELLING = 0.01
"""Px, RMS: about what a subset's noise is. A lens that is refitted worse is warned of."""


def calibrations(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """Those that the scene asks for; what refitted lenses are off by."""
    cameras = [build_camera(camera, scene.input) for camera in scene.cameras]
    files = calibration_files(cameras, scene.output.calibration)
    facts, warnings = {}, []
    for format in scene.output.calibration:
        own = [file for file in files if file.format == format]
        fits = {fit.camera.name: fit for file in own for fit in file.fits if fit.words}
        facts[f"calibration for {format}"] = (
            "; ".join(f"camera {name}: {fit.words}" for name, fit in fits.items()) or "exact"
        )
        warnings += [
            f"calibration files, camera {name}: {fit.words}"
            for name, fit in fits.items() if not fit.rms <= _TELLING
        ]  # fmt: skip
    worst = max(fit.largest for file in files for fit in file.fits)
    words = f"off by {worst:.4f} px at most" if worst else "exact"
    contents = {f"calibration/{file.name}": file.text.encode() for file in files}
    return StageResult(contents, notes_of(warnings, facts), f"{len(files)} files, {words}")
