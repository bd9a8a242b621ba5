"""The plan of a run: its stages, their costs, and what an output folder holds of them.

In the order in which data passes:

- `machine_speed`: How fast this machine is: measured once in a moment, then learned from each run.
- `stages`: A plan as data: how a scene is run, its stages, and what they cost by kinds of work.
- `state`: ``state.json`` of an output folder: which stage results lie there, and what they depend
  on.
- `plan`: The one decision, before any work: which stages are run, skipped or reused, why, at what
  cost.
"""
