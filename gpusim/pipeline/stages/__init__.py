"""Stages of a run: functions of a part of the scene and of the stages that they need.

`gpusim.plan.scene_stages` says which there are, and what each gets. In the order in which data
passes:

- `bodies`: Bodies and props of a scene: meshed, painted, and what a report says of the meshes.
- `checks`: What is doubtful about a scene: of its geometry before any work, of linear theory
  afterwards.
- `mechanics`: Models, their solution, the motions that follow, stress by frame.
- `equilibria`: Large displacements: which bodies linear theory is too far off for, and their
  equilibria.
- `vibrations`: Bodies that vibrate or buckle: modes, steady vibrations.
- `transients`: Motions of bodies in time.
- `images`: Pictures of frames and of calibration targets: radiance, exposure, the picture.
- `fields`: Pictures of the bodies in the colours of their fields, and how far forces move them.
- `truth`: truth.h5: what every pixel that sees a body sees, in every frame, and the bodies' nodes.
- `labels`: labels.json: where bodies, props, markers and corners are, in space and in pictures.
- `films`: A camera's pictures as a film, in the order of frames, and a small one for the report.
- `measuring`: Measurements of a run, one after the other.
- `camera_files`: Calibration files of the cameras, for other programs.
- `mesh_files`: Meshes for other programs: VTU, PVD and STL, by body and frame.
"""
