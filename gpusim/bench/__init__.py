"""``gpusim bench``: run time against error of the solver and of images, on a user's adapter.

Measurements beside other programs, hard models and the rest lie in a checkout's ``benchmarks``.
"""
