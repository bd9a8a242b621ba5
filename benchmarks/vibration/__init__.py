"""Vibration: errors against published values and references, and time beside other programs.

- `accuracy`: NAFEMS' natural frequencies, forced vibration, prestress and buckling.
- `dense`: Small models of every element, and the reference models, against dense algebra.
- `rayleigh`: Frequencies of given shapes in extended precision.
- `speed`: Modes of 10,000 to 350,000 unknowns, and steps of time, beside other programs.
- `peers`: SciPy, SLEPc and CalculiX on the same models.
"""
