"""Each shader against its NumPy twin on the same small input: what ``gpusim doctor`` runs.

Nothing but `gpusim.gpu.twin_checks` imports these modules, so they may see all of the package.

Its modules:

- `scenes`: Small scenes: every kind of paint and of lamp, and what casts shadows.
- `solver`: Stages of the solver.
- `shadow`: Stages of the search for shadows, and of ambient occlusion.
- `overlays`: What is drawn over the preview.
- `images`: Other stages of an image, and the correlation of subsets.
"""
