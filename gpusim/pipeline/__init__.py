"""From a scene to an output folder: the one place that knows every stage.

In the order in which data passes:

- `notes`: What a report says of a stage, kept with the stage's result: a run that reuses it says
  the same.
- `scene_objects`: From a scene to meshes, models, surfaces and cameras.
- `scene_solution`: One body of a scene solved: what `gpusim.solve` does with a scene.
- `pictures`: Pictures of a run: what they are called, what is in them, how they are exposed.
- `measurements`: Measurements in a run's images, with the truth beside them.
- `checks`: Checks before any work, and warnings that a scene's geometry gives.
- `stages`: Stages of a run: functions of a part of the scene and of the stages that they need.
- `runner`: Runs: a graph decided, worked off, and told in reports.
"""

import typing as _typing

from gpusim.public_names import public_names as _public_names

if _typing.TYPE_CHECKING:
    from gpusim.pipeline.runner.run import run as run

# all stages, of which a preview needs but few
__all__, __getattr__, __dir__ = _public_names(__name__, {"gpusim.pipeline.runner.run": "run"})
