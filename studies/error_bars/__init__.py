"""Are the error estimates true? Forty bridge amplifiers, each beside a reference that shares no code with the program.

The designs are drawn from the ranges in which such amplifiers are built, with sharp and with rounded hinge roots. The
program solves each to an accuracy of 1 % and states its estimate; the reference solves it on graded hexahedra::

    python -m studies.error_bars [--designs N] [--method extruded|wild] [--fresh] [--out DIR]

Each result is kept as soon as it is there: a run that was stopped goes on where it was.
"""
