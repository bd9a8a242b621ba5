"""Sensors: grey values from radiance.

In the order in which data passes:

- `channels`: What the channels of a sensor see: a frame's planes, weighted by sensitivities.
- `digital_numbers`: Digital numbers without noise: radiance scaled, rounded and clipped.
- `emva1288`: The noise of a camera sensor by the linear model of EMVA 1288, release 4.0.
- `demosaicing`: Red, green and blue at every pixel of a Bayer mosaic, by linear filters.
- `development`: From a sensor's raw numbers to the picture: white balance, demosaicing, gamma.
- `sensor`: The sensor: digital numbers from linear radiance.
"""
