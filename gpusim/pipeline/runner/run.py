"""A scene run into a folder: what `gpusim.run` and ``gpusim run`` do."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from gpusim.errors import InputError
from gpusim.files.output_folder import claim
from gpusim.gpu import chosen_backend
from gpusim.pipeline.checks.resources import check_folders
from gpusim.pipeline.runner.run_record import write_page
from gpusim.pipeline.runner.stage_runner import Progress, StageRunner
from gpusim.pipeline.runner.variants import run_variants
from gpusim.plan.stages import RunOptions
from gpusim.report import Report
from gpusim.scene import Scene

__all__ = ["run", "run_claimed"]


def run(
    scene: Scene,
    out: str | PathLike[str],
    *,
    backend: str = "auto",
    fresh: bool = False,
    skip: bool = True,
    progress: Progress | None = None,
) -> Report:
    """Run ``scene`` into the folder ``out`` and return its report.

    Parameters
    ----------
    backend : ``"auto"``: on the device where an adapter is found, else by the NumPy twins, with one
        warning; ``"gpu"``: on a device or not at all; ``"numpy"``: the twins.
    fresh : reuse nothing of an earlier run.
    skip : False switches every shortcut off, those of the renderer too
        (`gpusim.plan.stages.RunOptions`).
    progress : called with (stage, done 0..1, text).

    Raises
    ------
    InputError, SceneError, NoAdapter
        Before anything is written into ``out``; also where another run has it.
    NotConverged, DeviceError, GpusimError
        While working: ``report.json`` then says what failed; finished stages are kept.

    Examples
    --------
    >>> report = gs.run(gs.load_scene("bar.toml"), "out/bar", backend="numpy")
    >>> report.status
    'done'
    """
    if not isinstance(scene, Scene):
        raise InputError(f"run: scene; got {type(scene).__name__}; expected a Scene (load_scene)")
    backend = chosen_backend("run", backend)
    tell = progress or (lambda stage, done, text: None)
    with claim(out) as folder:
        return run_claimed(scene, folder, RunOptions(backend, fresh, skip), tell)


def run_claimed(scene: Scene, out: Path, options: RunOptions, tell: Progress) -> Report:
    """As `run`, into a folder that the caller has claimed."""
    check_folders(scene, out)
    if scene.variants:

        def begin(state: Scene, folder: Path, note: Progress) -> Callable[[], Report]:
            return StageRunner(state, folder, options, note).begin()

        return run_variants(scene, out, begin, tell)
    report = StageRunner(scene, out, options, tell).begin()()
    write_page(report, out, tell)
    return report
