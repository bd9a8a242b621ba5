"""A run as a graph: stages, what their results depend on, where those are kept, and the work.

Knows nothing of scenes. In the order in which data passes:

- `stage`: A stage: a function of what its key names, and the records that it makes.
- `log`: A file of lines that is only ever appended to.
- `store`: Results by content, shared by runs and processes.
- `folder`: An output folder: results under the names that people know.
- `graph`: Tasks by key, and what is to be done with each.
- `schedule`: Which task is next: those whose needs are there, in the graph's order.
- `session`: What the stages of a process share, and results don't depend on.
- `runner`: A decided graph, worked off.
"""
