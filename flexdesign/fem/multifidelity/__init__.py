"""One design among many: FEM on coarse meshes whose error is known, and a planar model corrected by it.

The way is that of multifidelity modelling (Peherstorfer, Willcox and Gunzburger 2018): many cheap solutions, and few
expensive ones that give the error of the cheap ones.
"""

from flexdesign.fem.multifidelity.correction import Correction
from flexdesign.fem.multifidelity.planar import Planar
from flexdesign.fem.multifidelity.solid import FastSolid

__all__ = ["Correction", "FastSolid", "Planar"]
