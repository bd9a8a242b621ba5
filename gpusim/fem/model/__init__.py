"""The model: supports, loads, and the solution.

In the order in which data passes:

- `constraints`: Linear equations between displacements, as objects of a model: ties, and any
  others.
- `follower_loads`: Loads that go with the deformed body: their forces, and what displacements
  change of them.
- `model`: The model: mesh, materials, supports, loads and formulations.
- `elimination`: Linear equations resolved: displacements given up and those they follow, u = T v +
  g.
- `computation`: Computations: how an analysis went, which its result tells whatever it is.
- `solution`: The solution of a model: displacements, and how far they can be trusted.
- `supports`: Supports: planes of symmetry, and which rigid-body motions supports leave free.
- `loads`: Consistent nodal forces: each function returns (N,3) float64, to be added up freely.
- `thermal_loads`: Forces of a temperature change, from the stress that it causes in cells held
  still.
- `dead_loads`: Dead loads: what follows the body, and heat, as forces on the undeformed one.
- `mass`: Mass matrices: consistent, by CalculiX's rules, and lumped on the diagonal.
- `damping`: Damping: of the Rayleigh kind, mode by mode, or in the material's structure.
- `modes`: Modes of vibration: frequencies and shapes, and how far they can be trusted.
- `buckling`: Buckling loads and shapes by linear theory, and how far they can be trusted.
- `harmonic_response`: Harmonic responses: complex amplitudes of displacements, frequency by
  frequency.
- `record`: Records: values over time, linear in between, as loads and grounds follow them.
- `history`: A history: motion over time, in memory, in a file, or as amplitudes of modes.
"""
