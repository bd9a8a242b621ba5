"""The preview window: what is drawn over its picture, and what is asked of it.

- `placement`: Where a picture lies in the window.
- `glyphs`: Letters as small grey pictures, drawn by Pillow from the DejaVu Sans that comes with
  matplotlib.
- `overlay`: What is drawn over a picture: rectangles, lines, triangles and text, all in one pass.
- `field_colors`: A rendered picture coloured by a field: values of a body's nodes or elements at
  every pixel.
- `fields`: Fields of a solution by name: their values, unit and range, and the legend of their
  colours.
- `picking`: What is under a pixel: the body or prop, its element, node and field, and the material
  point.
- `symbols`: Symbols in space, drawn over a picture through its camera: supports, loads, axes,
  cameras, grid.
- `mesh_edges`: Lines of a mesh on its surface: borders of elements, and edges where it is creased
  or ends.
- `camera_marks`: What is drawn while one looks through a camera of the scene: its frame, its
  middle, its lens.
"""
