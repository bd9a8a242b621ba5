"""Large displacements: errors against references, and time beside CalculiX.

- `accuracy`: Cases with a reference, on meshes that reach it.
- `speed`: A cantilever bent to w/L = 0.3, beside CalculiX.
- `calculix`: A model as a deck with NLGEOM, run by ``ccx``.
"""
