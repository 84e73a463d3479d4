"""Are the error estimates true? Eighty bridge amplifiers, each with a reference that shares no code with the program.

The designs are drawn from the ranges in which such amplifiers are built: forty with leaves, their roots sharp or
rounded, and forty with curved necks, circular notches and long fillets. The program solves each to an accuracy of 1 %
and states its estimate; the reference solves it on graded hexahedra::

    python -m studies.error_bars [--designs N] [--method extruded|wild | --curved] [--fresh] [--out DIR]

Each result is kept as soon as it is there: a run that was stopped goes on where it was.
"""
