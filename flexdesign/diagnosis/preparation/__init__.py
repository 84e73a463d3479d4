"""From recordings to a data set: noise, validation runs, initial conditions, windows, quantisation."""
