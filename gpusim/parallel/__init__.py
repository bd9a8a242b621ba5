"""Processors, threads, processes and memory of this machine.

In the order in which data passes:

- `machine`: Processors to share work out to, and main memory that new work may take.
- `blas_threads`: One thread in BLAS around batches of small products.
- `threads`: Work for all processors on threads.
- `processes`: Work in other processes: guarded calls, copies of this process.
"""
