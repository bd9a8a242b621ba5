"""Studies: many states of one scene, in one graph of work, and the table of what was measured.

In the order in which data passes:

- `expressions`: Short arithmetic expressions of parameters, over all points at once.
- `budget_tables`: ``[budget]``: what a measurement's uncertainty comes from.
- `study_tables`: ``study.toml``, read, checked and resolved.
- `dataset_table`: ``[dataset]`` of a study: items, labels, crops, splits.
- `design`: The points of a study: what each parameter is in each of them.
- `samples`: What each sample changes in the base scene, and the key of its row.
- `rows`: What became of each sample, appended to logs.
- `batch`: Samples made together, in one graph of work.
- `passing`: Results of samples that don't stay: ``keep = "numbers"``.
- `plan`: What a study would make, before any work.
- `cluster`: Workers of a Dask scheduler.
- `executors`: Where samples are made: here, in other processes, or on a cluster.
- `table`: The table of samples: parameters, and every measurement beside the truth.
- `effects`: What a study's parameters do to what was measured: one of them, two together, Sobol
  indices.
- `figures`: Figures of a study: main effects, two parameters together, all against all, Sobol
  indices.
- `report`: report.html and report.json of a study.
- `budget`: The uncertainty budget of a rig.
- `dataset`: Pictures of samples with exact labels, for who trains or tests.
- `study`: A study worked off into a folder.
"""

import typing as _typing

from gpusim.public_names import public_names as _public_names
from gpusim.studies.samples import Sample as Sample
from gpusim.studies.samples import samples_of as samples_of
from gpusim.studies.study_tables import Study as Study
from gpusim.studies.study_tables import load_study as load_study
from gpusim.studies.table import SampleTable as SampleTable

if _typing.TYPE_CHECKING:
    from gpusim.studies.plan import StudyPlan as StudyPlan
    from gpusim.studies.plan import study_plan as study_plan

# all stages, which a look at a study's folder does without
__all__, __getattr__, __dir__ = _public_names(
    __name__, {"gpusim.studies.plan": "StudyPlan study_plan"}
)
