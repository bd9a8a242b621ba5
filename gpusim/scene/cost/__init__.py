"""Cost of a run, from the scene's numbers alone.

In the order in which data passes:

- `counts`: How many nodes and elements a mesh recipe makes, without making it: for ``gpusim
  plan``.
- `extent`: How large a mesh recipe makes a body, without making it.
- `cost`: Rough cost of a run, from the scene's numbers alone: what ``gpusim plan`` prints.
"""
