"""``[analysis]``: what is computed, and the loads and supports that it is computed for.

In the order in which data passes:

- `loads`: What holds and moves a body, and ``where``.
- `analysis_table`: What is computed, and the frames that it is computed for.
"""
