"""Processors, processes and memory of this machine.

In the order in which data passes:

- `cpu_budget`: How many processors there are to share work out to.
- `main_memory`: Main memory: how much there is of it, and how much new work may take.
- `blas_threads`: One thread in BLAS around batches of small products.
- `child_process`: Calls of native libraries that may die, hang or take all memory on a damaged
  file.
- `helper_processes`: Calls in processes of their own, beside the one that keeps the device busy.
- `process_map`: The same work for several items in copies of this process, which share all it
  holds.
"""
