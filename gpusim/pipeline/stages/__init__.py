"""Stages of a run.

In the order in which data passes:

- `grey_levels`: Pictures that are too dark or too bright to measure in.
- `solving`: Solving the bodies of a scene; or a model, or one body, without making images.
- `stresses`: Stress of a scene's bodies, per frame: computed, kept in the output folder, summed
  up.
- `image_window`: The part of an image that anything is seen in: a small target needs no whole
  frame.
- `images`: Frames of a run: rendered and exposed, one camera and frame at a time.
- `capture_queue`: Pictures taken one after the other, each written and looked at while the next
  ones are taken.
- `truth`: truth.h5 of a run: what every pixel sees, band by band, so that no image is held whole.
- `mesh_export`: Meshes of a run for other programs: VTU and PVD, STL.
"""
