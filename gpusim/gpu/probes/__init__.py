"""Probes: what a driver does with numbers.

In the order in which data passes:

- `finiteness`: NaN and infinity on the device: the probe that shows whether a driver lets them be
  seen.
- `real_arithmetic`: Arithmetic in ``real``: the probe that shows whether a driver keeps 64-bit or
  double-single.
"""
