"""Fits of straight borders, and how certain they are.

In the order in which data passes:

- `levenberg_marquardt`: Many small least-squares problems at once (Levenberg-Marquardt, damped by
  the diagonal).
- `noise_level`: How noisy a picture is, as its flattest parts show, and what that allows a fit to
  leave.
- `noise_correlation`: How uncertain fits are where the noise of neighbouring pixels is alike.
- `edge_profile`: The grey profile of a straight black-white border, integrated over square
  pixels.
- `border_junction`: Where two straight black-white borders cross: the model that markers and
  chessboards share.
- `plumb_lines`: How a lens bends straight lines, from the lines of a flat grid in one picture
  (plumb lines).
- `square_sides`: The straight sides of dark squares: borders with the lens's blur and the pixels'
  area, fitted.
"""
