"""A published guide: two long leaves between the ground and a rigid table, which moves by a third of their length.

Its motion by CalculiX (quadratic tetrahedra of 10 mm, large displacements) is in fea_3d.csv of
haijunsu-osu/parallelogram_model_comparison at ca92a0e (MIT). Lengths are over L, forces over E I / L^2.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp

from flexdesign.design.materials import Material
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.large_displacement import LargeDisplacement
from flexdesign.fem.solving.load_path import load_path
from studies.verification.finding import Finding, range_around
from studies.verification.solids import Array, lattice, tag_facets

STEEL = Material("steel", 210e9, 0.3, 7850.0, 1e9, "as published")
#: Length, thickness and width of the leaves, and the distance of their centre lines [m].
LENGTH, THICKNESS, WIDTH, SPACING = 0.25, 5e-3, 50e-3, 0.15
#: Published u_x and u_y of the table under F_x and F_y.
PUBLISHED: Mapping[tuple[float, float], tuple[float, float]] = {
    (0.0, 1.0): (-0.00097028, 0.0400768),
    (0.0, 10.0): (-0.0784276, 0.352388),
    (5.0, 10.0): (-0.0544328, 0.296777),
}


class Guide:
    """The upper half of the leaves, one side held and the other moving as one body.

    Its unknowns are the displacements of the free nodes, and u_x, u_y and the rotation of the table. The rotation is
    small, so that its end faces move linearly with it.

    Parameters
    ----------
    cells
        Along a leaf, across it, and over half its width.
    """

    def __init__(self, cells: tuple[int, int, int]) -> None:
        along, across, over = cells
        share = np.linspace(0.0, 1.0, along + 1)
        x = LENGTH * (share - 0.8 * np.sin(2 * np.pi * share) / (2 * np.pi))  # finer at both ends
        leaf = np.linspace(-THICKNESS / 2, THICKNESS / 2, across + 1)
        y = np.concatenate([leaf - SPACING / 2, leaf + SPACING / 2])
        points = lattice(x, y, np.linspace(0.0, WIDTH / 2, over + 1), lambda c: np.abs(c[:, 1]) > SPACING / 4)
        body = Elasticity(tag_facets(*points, {})[0], STEEL)
        self.leaves = LargeDisplacement(body, np.arange(body.n_dofs))
        self._of_unknowns = self._tie(body.positions)
        self.free = np.arange(self._of_unknowns.shape[1])

    def _tie(self, positions: Array) -> sp.csr_matrix:
        """Return the displacements of all nodes, three rows each, by the unknowns."""
        x, y, z = positions.T
        end = np.flatnonzero(x > LENGTH - 1e-9)
        is_free = np.repeat(((x > 1e-9) & (x < LENGTH - 1e-9))[:, None], 3, axis=1)
        is_free[z < 1e-9, 2] = False  # the plane of symmetry
        rows = np.flatnonzero(is_free)
        u_x, u_y, turn = len(rows) + np.arange(3)
        ones = np.ones(len(end))
        entries = [
            (np.ones(len(rows)), rows, np.arange(len(rows))),
            (ones, 3 * end, u_x * ones),
            (ones, 3 * end + 1, u_y * ones),
            (-y[end], 3 * end, turn * ones),
            (x[end] - LENGTH, 3 * end + 1, turn * ones),
        ]
        values, places, unknowns = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        return sp.csr_matrix((values, (places, unknowns.astype(int))), shape=(positions.size, len(rows) + 3))

    def forces_and_tangent(self, unknowns: Array) -> tuple[Array, sp.csr_matrix]:
        """Return the internal forces of the unknowns, and the upper triangle of the tangent."""
        by = self._of_unknowns
        forces, upper = self.leaves.forces_and_tangent(by @ unknowns)
        return by.T @ forces, sp.triu(by.T @ (upper + sp.triu(upper, 1).T) @ by, format="csr")

    def motion(self, f_x: float, f_y: float, steps: int = 4) -> Array:
        """Return u_x and u_y of the table, both over L, under forces over E I / L^2."""
        unit = STEEL.youngs_modulus * WIDTH * THICKNESS**3 / 12 / LENGTH**2
        load = np.zeros((len(self.free), 1))
        load[-3:-1, 0] = unit / 2 * np.array([f_x, f_y])
        *_, last = load_path(self, load, [k / steps for k in range(1, steps + 1)])
        return np.asarray(last.displacement[-3:-1] / LENGTH)


def published_guide(cells: tuple[int, int, int] = (20, 1, 4)) -> list[Finding]:
    """Push the guide as published, on elements as large as theirs."""
    guide = Guide(cells)
    return [
        Finding(
            "published parallelogram guide", f"{name} / L under F_x = {f_x:g}, F_y = {f_y:g} E I / L^2",
            "independent code", "haijunsu-osu, parallelogram_model_comparison, 3D", right, float(found), "1",
            *range_around(right, within), len(guide.free), "both meshes; u_x goes with the square of u_y",
        )
        for (f_x, f_y), published in PUBLISHED.items()
        for name, right, found, within in zip(
            ("u_x", "u_y"), published, guide.motion(f_x, f_y), (1e-2, 5e-3), strict=True
        )
    ]  # fmt: skip
