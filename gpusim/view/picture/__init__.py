"""The preview window's picture: coarse while the view moves, exact when it is still.

- `neutral`: The paint and the light of what has none, and of who switches those of a scene off.
- `moving_picture`: The renderer's picture without shadows and soft edges: what is shown while the
  view moves.
- `display`: Radiance as colours of a screen, on the device: scaled, exposed, with sRGB's curve.
- `progressive_picture`: The newest picture of a view: coarse at once, then finer in steps short
  enough that keys and the mouse are heard between them.
"""
