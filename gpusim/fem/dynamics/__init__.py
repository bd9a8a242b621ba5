"""Dynamics: what a body does in time, and in steady vibration.

In the order in which data passes:

- `initial_value_problem`: Initial value problems of a body: what moves, from where, and what acts
  on it when.
- `modal_superposition`: Modal superposition: each mode by itself, exactly where loads are linear in
  between instants.
- `time_integration`: Time integration: Newmark's method, HHT-alpha and generalized-alpha, step by
  step.
- `phase_error`: Phase error: by how much vibration that is stepped lags behind, which adds up over
  its cycles.
- `nonlinear_motion`: Motion at large displacements: equilibrium with the forces of inertia, by
  Newton's method.
- `transient`: Transients: a body's response in time, by modes or step by step.
- `modal_basis`: Modal bases: modes, and what static responses have beyond them.
- `forced_vibration`: Forced vibration: a model as it is discretised, and the one load that drives
  it.
- `harmonic`: Harmonic response: steady vibration under loads, or on a base, that vary as
  exp(i omega t).
- `frequency_response`: Frequency-response functions: what one point does per unit of force at
  another.
- `random_response`: Random response: stationary vibration under a load, or on a base, known by its
  spectral density.
"""
