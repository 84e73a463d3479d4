"""Where the coefficients of `flexdesign.analytic.roots` and `flexdesign.analytic.width` come from.

What a leaf's root gives way is found by planar finite elements of a leaf on what it runs into, less what beams give;
how its width stiffens it, by a Ritz solution of the plate that it is::

    python -m studies.hinge_coefficients

prints both with the interpolated values that the program computes with.
"""
