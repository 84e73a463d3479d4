"""Verification of the finite elements: problems whose answers are known, side by side with what is found here.

Patch tests, manufactured solutions, benchmarks of NAFEMS, beams, flexure hinges and large displacements, all on
structured meshes of quadratic tetrahedra, so that no mesher has a part in it::

    python -m studies.verification [--out DIR]

Each row names its source, and a range that the answer must lie in, with the reason for it. The tests solve the same
problems on coarser meshes.
"""
