"""Advice on the settings of a correlation, from the picture that is to be correlated.

In the order in which data passes:

- `image_noise`: Noise of a picture by its grey values, from itself or from two of a scene at rest.
- `synthetic_motion`: A picture's own pattern, moved by waves that are known exactly.
- `pattern_trial`: What correlation errs by on a picture's own pattern, moved by waves that are
  known exactly.
- `pattern_quality`: What a picture's pattern is like, and which part of it stands for the whole.
- `settings_advice`: Subset, step, shape, blur and strain window that err least on a picture.
"""
