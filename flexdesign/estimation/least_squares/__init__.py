"""Nonlinear least squares: data set, residual function, Levenberg-Marquardt, starts, local minima."""
