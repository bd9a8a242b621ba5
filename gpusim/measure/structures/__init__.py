"""Structures: markers tracked, deflection lines, damage.

In the order in which data passes:

- `dot_centres`: Round dots: their centres by grey-value moments, and what perspective does to
  them.
- `marker_crosses`: Crosses of markers near known places: located, then fitted to a thousandth of
  a pixel.
- `marker_series`: Markers of a first picture followed through those after it.
- `marker_matching`: Markers of one image matched in another: searched to a pixel, correlated, and
  traced back.
- `marker_tracking`: Follow markers that all look alike, from those that hardly move to those that
  move most.
- `deflection`: From tracked pixels to a deflection line in millimetres.
- `damage`: Where a beam is damaged: slope changes in the difference of two deflection lines.
"""
