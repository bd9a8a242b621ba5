"""Arrays: what NumPy lacks, or does slowly.

In the order in which data passes:

- `array_types`: Names for arrays by the kind of their numbers; docstrings give shapes.
- `grey`: Grey from colour, in the one way in which everything that measures takes it.
- `srgb`: The curve of sRGB (IEC 61966-2-1), there and back.
- `round_numbers`: Round numbers, for scales that people read.
- `unique`: Equal things found: values, rows of integers, congruent elements.
- `z_order`: Places in space along a curve that keeps neighbours together.
- `ragged`: Lists of lists laid out one after another, and running sums over cells and paths.
- `error_free_sums`: Sums and halves of float64 numbers whose errors are known.
"""
