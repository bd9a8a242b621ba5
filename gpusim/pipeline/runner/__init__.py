"""The runner: stages in turn, timed, recorded, reported.

In the order in which data passes:

- `run_record`: What a run knows of its stages, those whose results it reused too, and what it
  says of itself.
- `stage_runner`: Running a plan: each stage in turn, timed, recorded as soon as its files are
  whole.
- `variants`: Several states of one scene in one run: each made like a scene of its own, then
  compared.
- `run`: A scene run into a folder: what `gpusim.run` and ``gpusim run`` do.
- `error_budget`: The error budget: one scene imaged and measured with and without each effect.
"""
