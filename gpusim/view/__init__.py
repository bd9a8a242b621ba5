"""The preview window: a scene, a run's folder or a mesh, looked at while one works on it.

What draws needs no window; ``rendercanvas`` and ``glfw`` (the extra ``[view]``) are imported by
`window` and `server` alone. In the order in which modules need each other:

- `picture`: Pictures of what is shown: coarse while it moves, exact when it is still.
- `content`: What is shown, from files, and solved meanwhile.
- `camera_marks`: What is drawn while one looks through a camera of the scene: its frame, its
  middle, its lens.
- `keys`: What keys and the mouse do, in one table.
- `legend_range`: Which values the legend of a field reaches over: those of a frame, of all frames,
  or held.
- `view_state`: What is looked at: content, view and choices.
- `body_marks`: What stands at the bodies in space: measured points, symbols, the undeformed shape,
  the smallest and the largest value, the selection.
- `field_list`: The list of fields in a corner of the window: the one that is shown, and those round
  it.
- `panels`: What is written over the picture: title, fields, slider, progress, help, messages,
  faults.
- `drawing`: How what is looked at is drawn, into whatever window.
- `viewer`: How keys and the mouse change what is looked at.
- `screenshot`: The window's picture without a window.
- `window`: The window (rendercanvas and glfw).
- `server`: The same picture in a browser, from a server that pages of this machine alone reach.
"""
