"""From a scene to meshes, models, surfaces and cameras.

In the order in which data passes:

- `meshing`: A scene's mesh recipe turned into a mesh, and what is said of it.
- `places`: A scene's ``where`` as nodes, faces and cells of a mesh.
- `painting`: From a scene's paints to the paints and paint coordinates of a surface.
- `build`: A scene's dataclasses turned into meshes, surfaces, lights and cameras.
- `modelling`: A body's finite-element model: material, supports, and one load case per group of
  loads.
- `solution_store`: The solution of a scene's bodies as it is kept in the output folder.
- `props`: Props of a scene: plates, boxes and things from files, and where they are in a frame.
- `scene_objects`: What stands in front of the cameras: bodies and props, and where they are in
  each frame.
- `cameras`: A scene's cameras turned into cameras of `gpusim.optics`.
- `photo`: Lens, shutter and sensor of a scene as the optics take them, and motion around a frame.
"""
