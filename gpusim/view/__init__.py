"""The preview window: a scene, a run's folder or a mesh, looked at while one works on it.

What draws needs no window; ``rendercanvas`` and ``glfw`` (the extra ``[view]``) are imported by
`window` alone.

- `turntable`: A camera that goes round a pivot with z up.
- `neutral`: The paint and the light of what has none, and of who switches those of a scene off.
- `content`: What is shown: surfaces by frame, cameras, lights, fields.
- `loading`: Content from a file: a scene, a run's folder, a mesh, a CAD file.
- `background_solver`: A scene solved in another process.
- `file_watch`: Whether files have changed.
- `moving_picture`: A picture without shadows and soft edges, while the view moves.
- `still_picture`: A picture at full quality, some rows at a time.
- `display`: Radiance as colours of a screen.
- `keys`: What keys do, in one table.
- `viewer`: The state of what is looked at, and how it answers keys and the mouse.
- `panels`: What is written over the picture: title, slider, help, faults.
- `screenshot`: The window's picture without a window.
- `window`: The window itself, and the same in a browser.
"""
