"""Three amplifiers drawn with hinges of 0.35, 0.5 and 0.7 mm, and something about them that is not in the drawing.

``bench.csv`` is what a bench measured of them: solved by hexahedra that share no code with the program, with noise of
0.5 %. The answer stands in ``answer.toml``::

    flexdesign diagnose bridge_amplifier studies/hidden_over_cut/bench.csv
    python -m studies.hidden_over_cut          # makes bench.csv anew, some minutes
"""
