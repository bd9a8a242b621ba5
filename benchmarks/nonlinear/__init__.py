"""Large displacements: errors against references, and time beside CalculiX and torch-fem.

- `accuracy`: Cases with a reference, on meshes that reach it.
- `speed`: A cantilever bent to w/L = 0.3, beside CalculiX.
- `stretch`: A rubber block stretched to ten times its length, beside torch-fem.
- `calculix`: A model as a deck with NLGEOM, run by ``ccx``.
"""
