"""Files of faces without solids.

In the order in which data passes:

- `ply`: Points and faces of PLY files: text, or binary of either order.
- `formats`: Points and faces of STL, OBJ, OFF and glTF files, as they are written there.
- `reader`: Files of faces without solids: STL, PLY, OBJ, OFF, glTF.
"""
