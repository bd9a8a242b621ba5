"""Arrays: what NumPy lacks, or does slowly.

In the order in which data passes:

- `array_types`: Names for arrays by the kind of their numbers; docstrings give shapes.
- `sorted_unique`: Each value once: NumPy 2.3's `unique` goes through a table of hashes, ten times
  slower.
- `congruence`: Finding equal things: congruent elements and equal rows, by 64-bit hashes of
  integers.
- `ragged`: Lists of lists, laid out one after another.
- `summed_area`: Boxes on grids of cells: which cells they cover, and how much lies in each of
  them.
- `interleave`: The order in which a kernel's invocations take their work, where some have much
  more of it.
- `path_sums`: Sums along the paths of a tree back to its root.
- `error_free_sums`: Sums and halves of float64 numbers whose errors are known.
"""
