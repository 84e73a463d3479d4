"""What the tuned gains of Lin, Yu, Wu and Shen (2019) say about their stage, and what no gains can say.

The paper prints transfer functions, eq (31), and the Ziegler-Nichols gains that were found with them, eq (34). They do
not belong together. This study shows it, finds the plants that the printed gains can belong to, what the gains do on
them, and the measurement that would identify the stage among them::

    python -m studies.lin2019_gains [--out DIR]

writes a report, every number of it computed from the table in `printed.py`.
"""
