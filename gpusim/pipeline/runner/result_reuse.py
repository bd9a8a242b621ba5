"""What an earlier run left of a frame, looked at before it is reused."""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile
from zlib import error as ZlibError

from gpusim.files.input_file import InputFile
from gpusim.pipeline.measurements.board_corners import board_of, read_corners
from gpusim.pipeline.stages.images import read_exposure
from gpusim.plan.plan import PlannedStage
from gpusim.plan.state import StateFile
from gpusim.scene import Scene

__all__ = ["DAMAGE", "check_frame"]

DAMAGE = (
    OSError, EOFError, ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError,
    NotImplementedError, BadZipFile, ZlibError, MemoryError,
)  # fmt: skip
"""What reading a damaged file raises; `InputError` is a ValueError."""


def check_frame(scene: Scene, stage: PlannedStage, state: StateFile) -> None:
    """Raises InputError if what lies beside a picture can't be used: its exposure, the corners
    found in it."""
    for file in state.files(stage.key):
        if file.suffix == ".json":
            read_exposure(state.read(file))
    if stage.pose is not None and scene.measures_space and board_of(scene) is not None:

        def read(path: str) -> InputFile:
            return state.read(Path(path))

        read_corners(scene, state.folder, read, stage.camera or "", stage.pose)
