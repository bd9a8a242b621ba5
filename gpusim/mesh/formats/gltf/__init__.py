"""glTF 2.0 (Khronos; ISO/IEC 12113): faces, and how they look; what isn't read is refused.

In the order in which data passes:

- `document`: A file's JSON, and the numbers and bytes that its buffers hold.
- `primitives`: Triangles, wherever nodes place them.
- `base_colors`: Base colours of materials, their pictures, and how these lie on the triangles.
"""
