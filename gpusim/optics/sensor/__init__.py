"""Sensors: grey values from radiance.

In the order in which data passes:

- `emva1288`: The noise of a camera sensor by the linear model of EMVA 1288, release 4.0.
- `sensor`: The sensor: digital numbers from linear radiance.
"""
