"""Files: read once, written whole, deleted only where that is allowed.

In the order in which data passes:

- `input_file`: Input files, read once: the bytes that are hashed are the bytes that are used.
- `includes`: Files that mesh files and decks include: part of what a result was computed from.
- `file_series`: Files that name one mesh file per time: ParaView's .pvd and .series. Read without
  numerics.
- `picture_file`: Pictures in files, decoded by one function: whatever is wrong with one is an
  error that names it.
- `picture_tags`: What a picture's file says beside its pixels: pages of a TIFF, white as zero,
  orientation.
- `hdf5_file`: HDF5 files whole, as arrays and attributes.
- `output_folder`: The output folder: what may be written and deleted in it, and who is writing.
- `atomic_files`: Files that are either whole or absent.
"""
