"""What the preview window shows.

- `depth_of_field`: Depths between which a camera is sharp.
- `content`: What is shown: surfaces by frame, cameras, lights, states of the bodies.
- `loading`: Content from a file: a scene, a run's output folder, a mesh or a CAD file.
- `background_solver`: A scene solved in another process, which tells how far it is.
- `file_watch`: Whether files have changed, by their number, time and size.
"""
