"""Bodies in the colours of a field, and what is drawn over pictures: for the window and reports.

In the order in which modules need each other:

- `turntable`: A camera that goes round a pivot with z up.
- `placement`: Where a picture lies in what is drawn on.
- `glyphs`: Letters as small grey pictures, drawn by Pillow from the DejaVu Sans that comes with
  matplotlib.
- `overlay`: What is drawn over a picture: rectangles, lines, triangles and text, in one pass.
- `color_scale`: Round limits and ticks for values, and the colours between them.
- `legend`: The bar of colours with its ticks and title.
- `field_colors`: A rendered picture coloured by a field: values of a body's nodes or elements at
  every pixel.
- `mesh_edges`: Lines of a mesh on its surface: borders of elements, and edges where it is creased
  or ends.
- `symbols`: Symbols in space, drawn over a picture through its camera: supports, loads, axes,
  cameras, a grid.
- `body_picture`: Deformed bodies in the colours of a field, with legend, scale and largest value.
"""
