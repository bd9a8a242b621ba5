"""From a scene to meshes, models, surfaces, cameras and lights.

In the order in which data passes:

- `arguments`: Arguments of a function, or of a class, that a scene's table has under their names.
- `meshing`: A scene's mesh recipe turned into a mesh; its ``where`` as nodes, faces and cells of
  that.
- `surfaces`: Bodies and props of a scene as painted surfaces.
- `modelling`: A body's finite-element model: material, supports, and one load case per group of
  loads.
- `solution`: The solution of a scene's bodies, as it is kept and told.
- `load_steps`: Load steps of a scene's bodies at large displacements, as they are kept.
- `vibrations`: Modes, steady vibrations and motions in time of a scene's bodies, as they are kept.
- `moving_bodies`: What stands in front of the cameras, and where it is in each frame.
- `cameras`: Cameras, lenses, shutters and sensors of a scene as the optics take them.
- `lights`: Lights of a scene as the optics take them.
"""
