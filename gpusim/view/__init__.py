"""The preview window: what is drawn over its picture, and what is asked of it.

- `glyphs`: Letters as small grey pictures, drawn by Pillow from the DejaVu Sans that comes with
  matplotlib.
- `overlay`: What is drawn over a picture: rectangles, lines, triangles and text, all in one pass.
"""
