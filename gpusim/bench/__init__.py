"""``gpusim bench``: run time against error of the solver and of images, on a user's adapter.

Measurements beside other programs, hard models and the rest lie in a checkout's ``benchmarks``.

Its modules:

- `solver_cases`: Cases of the solver benchmark, by name and size.
- `solver`: Run time of the solver against the error of its displacements.
- `image_cases`: Scenes of the render benchmark.
- `images`: Run time of a frame against the error of its image.
"""
