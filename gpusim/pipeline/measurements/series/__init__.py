"""A few places over frames: what the kinds "extensometer", "gauge", "line" and "point" share.

In the order in which data passes:

- `placing`: Where subsets lie in the reference picture, for places that a scene names.
- `measuring`: Subsets of a few places followed over frames, and what a kind makes of them.
- `result`: Quantities of a few places over frames, measured and true: table, series, what the
  report says.
"""
