"""A study worked off into a folder: what `gpusim.study` and ``gpusim study`` do."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from os import PathLike
from pathlib import Path

from gpusim.errors import require
from gpusim.files.atomic_files import write_text
from gpusim.files.input_file import read_input
from gpusim.files.output_folder import check_below, claim, inside
from gpusim.graph.folder import INNER
from gpusim.graph.store import Store
from gpusim.pipeline.runner.stage_log import Progress, silent
from gpusim.scene.toml_text import parse_toml
from gpusim.studies.batch import Worker, bare, result_keys
from gpusim.studies.executors import Client, Here, LocalPool, Pool, local_workers
from gpusim.studies.plan import StudyPlan, check_samples, study_plan
from gpusim.studies.report import Pictures, write_study_report
from gpusim.studies.rows import FINAL, RowLog, read_rows
from gpusim.studies.samples import Sample, samples_of
from gpusim.studies.study_tables import COPY, Study, load_study, study_text
from gpusim.studies.table import SampleTable

_BUDGET = "gpusim.studies.budget.budget_study"  # a folder of its own, which knows this one


def study(
    study: Study | str | PathLike[str],
    out: str | PathLike[str],
    *,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> SampleTable:
    """Make the samples of a study into the folder ``out``, and return their table.

    What the folder has of them is kept, so that a study that was ended goes on. Samples that fail,
    or are refused, are recorded in the table. ``out`` gets samples.csv and, with
    ``gpusim[study]``, samples.parquet, a report, and of a study with ``[dataset]`` the folder
    dataset.

    Parameters
    ----------
    study : a study, or the path of its file (`gpusim.studies.load_study`).
    workers : processes of this machine; 1: this one.
    scheduler : address of a Dask scheduler (``gpusim[cluster]``) whose workers see ``out``, too.
    progress : called with ("samples", done 0..1, text), and then with "dataset".

    Raises
    ------
    InputError, SceneError
        Before any work: a key that there isn't, values that it doesn't take, an expression that is
        none; a folder that another study is at work in.
    DeviceError, GpusimError
        What has nothing to do with samples; those that are done are kept.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("study.toml").write_text('''scene = "bar.toml"
    ... backend = "numpy"
    ... [[parameter]]
    ... key = "camera.side.focal_mm"
    ... list = [49.0, 50.0]
    ... ''')
    >>> table = gs.study("study.toml", "out/study")
    >>> table["status"].tolist()
    ['done', 'done']
    """
    loaded = study if isinstance(study, Study) else load_study(study)
    require(workers >= 1, "study: workers", workers, "1 or more")
    samples, is_budget = checked_samples(loaded), loaded.tables.budget is not None
    with claim(out) as folder:
        check_below(folder, INNER, "dataset")
        if is_budget:
            loaded = import_module(_BUDGET).with_rig(loaded, folder)
        work_off(loaded, samples, folder, workers, scheduler, progress or silent)
        store = Store(inside(folder, INNER))
        store.clean()
        rows = read_rows(folder, samples)
        table = SampleTable.from_rows(loaded, samples, rows)
        table.write(folder)
        (progress or silent)("report", 0.0, "figures and page")
        if is_budget:
            import_module(_BUDGET).report_budget(loaded, table, folder)
        else:
            write_study_report(loaded, table, folder, _pictures(loaded, samples, store))
        (progress or silent)("report", 1.0, "report.html, report.json")
        if loaded.tables.dataset is not None:
            import_module("gpusim.studies.dataset").write_dataset(
                loaded, samples, rows, folder, progress or silent
            )
    return table


def _pictures(study: Study, samples: Sequence[Sample], store: Store) -> Pictures:
    """What finds the last picture of a sample's first camera."""

    def last(number: int) -> Path | None:
        scene, keys = result_keys(study, samples[number])
        for camera in scene.cameras:
            record = store.find(keys[f"picture/{camera.name}"][-1])
            for facts in record.files.values() if record else ():
                path = store.blob(facts.sha256)
                return path if path.is_file() else None
        return None

    return last


def checked_samples(study: Study) -> Sequence[Sample]:
    """The samples of a study. Raises InputError or SceneError for what is wrong in all of them."""
    samples = samples_of(study)
    check_samples(study, samples)
    return samples


def work_off(
    study: Study, samples: Sequence[Sample], out: Path, workers: int, scheduler: str | None,
    progress: Progress,
) -> None:  # fmt: skip
    """Make what ``out`` doesn't have of the samples."""
    copy = inside(out, COPY)
    is_own = copy.exists() and Path(study.source).exists() and copy.samefile(study.source)
    if copy.exists() and not is_own:
        _check_copy(study, copy)
    rows = read_rows(out, samples)
    final = {number: row["status"] for number, row in rows.items() if row["status"] in FINAL}
    new = [sample for sample in samples if sample.number not in final]
    refused = [sample for sample in new if sample.refused]
    left = [sample for sample in new if not sample.refused]
    plan = study_plan(study, left)
    pool = _pool(study, out, workers, scheduler, plan) if left else None
    if not is_own:  # it may be the user's
        write_text(copy, study_text(study))
    log = RowLog(out)
    for sample in refused:
        log.add(sample, "refused", sample.refused)
        final[sample.number] = "refused"
    log.close()
    bar = _Bar(len(samples), Counter(final.values()), progress)
    bar(Counter())
    if pool is None:
        return
    client = Client(bare(study), left, plan.structures.tolist(), out, pool, bar)
    if isinstance(pool, Here):
        pool.worker.log.told = client.look
    client.work_off()


def _check_copy(study: Study, copy: Path) -> None:
    """Raise InputError for a copy in the folder that isn't one of the same scene's, which it would
    overwrite."""
    found = parse_toml(read_input(copy, "a study file").text("TOML in UTF-8"))
    known = found if isinstance(found, dict) and inside(copy.parent, INNER).exists() else {}
    scene, is_budget = known.get("scene"), study.tables.budget is not None
    got = f"a {'budget' if 'budget' in known else 'study'} of {scene}" if scene else "another file"
    fits = scene == str(Path(study.scene.source).absolute()) and ("budget" in known) == is_budget
    require(fits, f"study: {copy} would be overwritten", got, "another output folder")


def _pool(study: Study, out: Path, workers: int, scheduler: str | None, plan: StudyPlan) -> Pool:
    if scheduler is not None:  # Dask is an extra
        pool: Pool = import_module("gpusim.studies.cluster").ClusterPool(scheduler)
        return pool
    count = local_workers(workers, plan)
    return LocalPool(count) if count > 1 else Here(Worker(out, study.backend))


@dataclass
class _Bar:
    """How far a study of ``total`` samples is, ``before`` of them when this began, in words."""

    total: int
    before: Counter[str]
    progress: Progress

    def __post_init__(self) -> None:
        self.start = time.monotonic()

    def __call__(self, counts: Counter[str]) -> None:
        """Tell of the samples that are made."""
        whole = self.before + counts
        words = [f"{whole.total()} of {self.total}"]
        if rate := counts.total() / max(time.monotonic() - self.start, 1e-3):
            left = (self.total - whole.total()) / rate
            words += [f"{rate:.3g} a second", f"{left:.0f} s left" if left else ""]
        words += [f"{whole[one]} {one}" for one in ("refused", "failed", "killed") if whole[one]]
        done = whole.total() / self.total if self.total else 1.0
        self.progress("samples", done, ", ".join(filter(None, words)))
