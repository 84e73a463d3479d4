"""Does a diagnosis of static tables find what is hidden? Forty amplifiers on hexahedra, each with effects hidden in it.

What a bench would measure is made from the compliance between the ports that independent hexahedra found, with what is
hidden put in by circuit theory of springs, or by drawing the part otherwise than it is; 1 % noise on top::

    python -m studies.static_trial [--noise "1 %"] [KIND...]

The answer counts as right if it names the effect, alone or in a group that the table does not distinguish.
"""
