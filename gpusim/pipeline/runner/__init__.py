"""Runs: a graph decided, worked off, and told in reports.

In the order in which data passes:

- `stage_log`: What became of a run's stages: told while they are worked off, and in reports.
- `result_tables`: Tables of a report: load steps, modes.
- `scene_report`: What a run says of a scene: its report, from the results that are kept.
- `scene_file`: ``scene.toml`` of an output folder; what somebody has edited there isn't lost.
- `execution`: Scenes made into their folders, each reported as soon as it is whole.
- `part`: A part of a scene's run, into a folder of its own: what a preview, or an object, needs.
- `scene_contents`: What a scene describes, as objects, without a folder: its surfaces by frame, its
  solution.
- `variants`: Several states of one scene in one run, compared; and a run that failed, told.
- `run`: A scene run into a folder: what `gpusim.run` and ``gpusim run`` do.
- `effect_states`: A scene with and without each of its effects: the states that error budgets and
  explanations of fields run and compare.
- `error_budget`: The error budget: one scene imaged and measured with and without each effect.
- `explanation`: Why measured fields differ from the truth: the parts of the error, as maps.
"""
