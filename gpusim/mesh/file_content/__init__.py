"""What mesh files of other programs have in common.

In the order in which data passes:

- `text`: The lines of a text file from anywhere, and of those that it includes.
- `faults`: Faults of files that come up while a library, or a reader, looks at what isn't there.
- `byte_source`: Files of text and binary numbers, read from a place in their bytes on.
- `coordinate_systems`: Coordinate systems in which files give nodes: rectangular, cylindrical,
  spherical.
- `numbering`: How other programs number kinds of cells, their nodes and their sides.
- `cell_blocks`: What mesh files hold before it is a `Mesh`: blocks of any dimension, with named
  groups.
"""
