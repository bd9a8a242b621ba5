"""The plan of a run: its stages, their costs, and what an output folder holds of them.

In the order in which data passes:

- `machine_speed`: How fast this machine is, as its last runs have shown.
- `stages`: A plan as data: how a scene is run, its stages, and what they cost by kinds of work.
- `programs`: What the pictures in an output folder have asked the device for.
- `stage_builder`: What the stages of a scene are made with: its parts, its frames, and how it is
  run.
- `motion_stages`: The stages that find a scene's motion, for each kind of analysis.
- `vibration_stages`: The same of modes, steady vibrations and motions in time.
- `scene_stages`: The stages of a scene, and what each depends on: the graph of its run.
- `decision`: What is done with each result of a run, before any work: its graph, against what lies
  there.
- `plan`: A decision in words, seconds and bytes: what ``gpusim plan`` prints, and a run goes by.
"""
