"""A scene run into a folder: what `gpusim.run` and ``gpusim run`` do."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from gpusim.files.output_folder import claim
from gpusim.gpu import chosen_backend
from gpusim.pipeline.checks.resources import check_folders
from gpusim.pipeline.runner.execution import Execution
from gpusim.pipeline.runner.scene_report import learn
from gpusim.pipeline.runner.stage_log import Progress, silent
from gpusim.pipeline.runner.variants import compare_variants, work_off
from gpusim.plan.decision import states_of
from gpusim.plan.stages import RunOptions
from gpusim.report import Report
from gpusim.scene import Scene
from gpusim.validation import require


def run(
    scene: Scene,
    out: str | PathLike[str],
    *,
    backend: str = "auto",
    fresh: bool = False,
    skip: bool = True,
    store: str | PathLike[str] | None = None,
    verify: bool = False,
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
    store : a folder of results that runs into several folders share, also at the same time; without
        it ``out`` has its own.
    verify : look at earlier results byte by byte, not by their size and time of change.
    progress : called with (stage, done 0..1, text), by one thread at a time.

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
    given = isinstance(scene, Scene)
    require(given, "run: scene", type(scene).__name__, "a Scene (load_scene)")
    options = RunOptions(chosen_backend("run", backend), fresh, skip)
    shared = None if store is None else Path(store).absolute()
    with claim(out) as folder:
        return run_claimed(scene, folder, options, progress or silent, shared, verify)


def run_claimed(
    scene: Scene,
    out: Path,
    options: RunOptions,
    progress: Progress,
    store: Path | None = None,
    verify: bool = False,
) -> Report:
    """As `run`, into a folder that the caller has claimed."""
    check_folders(scene, out)
    execution = Execution(scene, states_of(scene), out, options, progress, store, verify)
    work_off(execution)
    if scene.variants:
        return compare_variants(execution)
    (report,) = execution.reports.values()
    learn(execution.speed, execution.plan, report.stages, execution.session)
    return report
