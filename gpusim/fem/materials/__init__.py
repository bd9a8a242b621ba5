"""Laws: stress of strain and history at the points of elements.

In the order in which data passes:

- `law`: What an element asks of a material.
"""
