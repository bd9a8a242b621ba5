"""From a scene to an output folder: the one place that knows every stage.

In the order in which data passes:

- `notes`: What a report says of a stage, kept with the stage's result: a run that reuses it says
  the same.
- `build`: From a scene to meshes, models, surfaces and cameras.
- `scene_solution`: One model, or the one body of a scene, solved: ``gs.solve``.
- `stages`: Stages of a run.
- `measurements`: Measurements in a run's images, with the truth beside them.
- `checks`: Checks before any work, and warnings that a scene's geometry gives.
- `runner`: Stages in turn, timed, recorded, reported.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gpusim.pipeline.runner.run import run as run

__all__ = ["run"]


def __getattr__(name: str) -> Any:
    if name != "run":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gpusim.pipeline.runner.run import run  # all stages, of which a preview needs but few

    return run


def __dir__() -> list[str]:
    return sorted(__all__)
