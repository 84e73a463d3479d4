"""How near is the compliance model to finite elements? Two hundred bridge amplifiers, by both.

The designs are those of `studies.error_bars`, and as many more as are asked for, from the same ranges: hinges 0.2 to
1 mm thick, spans of 10 to 40 mm, offsets of 0.5 to 6 mm, 5 to 25 mm wide, with and without input rods, with sharp and
with rounded roots, of four metals. Finite elements are refined until their own estimate says 1 %::

    python -m studies.theory_against_fem [--designs N] [--out DIR]

Each solution is kept as soon as it is there: a run that was stopped goes on where it was.
"""
