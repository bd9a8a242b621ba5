"""Vibration in pictures: motions of points over time, modes from them, motions made visible.

In the order in which data passes:

- `sampling`: Times at which pictures were taken, and the rate that they keep.
- `shifted_subsets`: Subsets of a reference found in pictures, by a few sums over their pixels.
- `displacement_methods`: What of a subset is compared to find its motion: slopes, or phases.
- `point_series`: Displacements of points over time, from a sequence of pictures.
"""
