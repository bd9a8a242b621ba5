"""Processors, processes and memory of this machine.

In the order in which data passes:

- `cpu_budget`: How many processors there are to share work out to.
- `main_memory`: Main memory: how much there is of it, and how much new work may take.
- `blas_threads`: One thread in BLAS around batches of small products.
- `processes`: Work in other processes: guarded calls, copies of this process, a pool for figures.
"""
