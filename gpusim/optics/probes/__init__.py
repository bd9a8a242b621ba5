"""Probes: small scenes for twin checks.

In the order in which data passes:

- `paints`: A small view with every kind of paint, for the twin checks.
- `shadows`: A small scene with shadows of every kind of lamp, for the twin checks and tests.
- `occluders`: A small scene for the twin checks: boxes, a bent open sheet, and a lamp of each
  kind.
"""
