"""What the tables of a scene file are made of.

In the order in which data passes:

- `table`: What every table shares: strictness, names, numbers, directions, units.
- `colors`: Colours: a grey number, a list of red, green and blue, "#rrggbb".
- `finishes`: Finishes by name: what surfaces of workshops look like.
"""
