"""The preview window: a scene, a run's folder or a mesh, looked at while one works on it.

What draws needs no window; ``rendercanvas`` and ``glfw`` (the extra ``[view]``) are imported by
`window` and `server` alone. In the order in which modules need each other:

- `picture`: Pictures of what is shown: coarse while it moves, exact when it is still.
- `content`: What is shown, from files, and solved meanwhile.
- `picking`: What is under a pixel: the body or prop, its element, node and field, and the material
  point.
- `camera_marks`: What is drawn while one looks through a camera of the scene: its frame, its
  middle, its lens.
- `keys`: What keys and the mouse do, in one table.
- `panels`: What is written over the picture: title, selection, slider, progress, help, messages,
  faults.
- `view_state`: What is looked at: content, view and choices; and how it is drawn.
- `viewer`: How keys and the mouse change what is looked at.
- `screenshot`: The window's picture without a window.
- `window`: The window (rendercanvas and glfw).
- `server`: The same picture in a browser, from a server that pages of this machine alone reach.
"""
