"""What the preview window shows.

- `depth_of_field`: Depths between which a camera is sharp.
- `cut`: A plane through the bodies: elements beyond it aren't shown, so that one sees what is
  inside.
- `picking`: What is under a pixel: the body or prop, its element, node and sets, and the material
  point.
- `measured_points`: What was measured at points of a camera's first picture, from OUT/measure, and
  where these points are on the bodies.
- `content`: What is shown: surfaces by frame, cameras, lights, states of the bodies.
- `field_values`: Fields of a content by name: of its bodies as they were solved, of the truth as a
  camera has it, of what was measured on them.
- `loading`: Content from a file: a scene, a run's output folder, a mesh or a CAD file.
- `background_solver`: A scene solved in another process, which tells how far it is.
- `file_watch`: Whether files have changed, by their number, time and size.
"""
