"""Shell and stacks as one mesh of two materials, its statics and its modes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np
import skfem as fem
from pypardiso import PyPardisoSolver
from scipy.sparse.linalg import LinearOperator, eigsh
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

import flexdesign as fd

DESIGN = Path(__file__).resolve().parents[1] / "published" / "apa300ml" / "apa300ml.toml"
#: Of the published matrices [mm]: where each stack begins and ends, and the steel block.
STACKS, BLOCK = ((-32.5, -12.5), (-7.5, 12.5), (12.5, 32.5)), (-12.5, -7.5)
#: Sides of square sections [mm]: the block's follows from the centre of mass, 0.339 mm off the middle.
STACK_SIDE, BLOCK_SIDE = 10.0, 14.2
#: Young's modulus [Pa], for the 230 N/um of each stack in the matrices; Poisson's ratio; density of ceramic [kg/m^3].
STACK = (46e9, 0.31, 7800.0)
#: Radius of the screw holes in the mounting pads [mm], from the STEP file.
HOLE = 2.1
SHELL_EDGE, STACK_EDGE = 1.2, 4.0  # largest edge lengths [mm]


@dataclass(frozen=True)
class Found:
    """Mass [kg], output over extension of the stacks, output stiffness [N/m], frequencies [Hz]."""

    mass: float
    amplification: float
    output_stiffness: float
    frequencies: tuple[float, ...]


def solve(folder: Path, *, in_hole: bool, stack_mass: bool = True, modes: int = 4) -> Found:
    """Solve the actuator, clamped in a screw hole or at the whole face of its pad.

    Parameters
    ----------
    folder
        Where the solid is exchanged.
    in_hole
        Clamp the wall of the hole instead of the face.
    stack_mass
        False to leave out the mass of stacks and block.
    modes
        How many.
    """
    design = fd.read_design(DESIGN)
    steel = design.material
    metal = (steel.youngs_modulus, steel.poissons_ratio, steel.density)
    points, tets, index, names = _mesh(design.part().solid(), folder)
    mesh = fem.MeshTet(points.T.copy(), tets.T.copy())
    element = fem.ElementVector(fem.ElementTetP2())
    whole = fem.CellBasis(mesh, element, intorder=4)
    stiffness = mass = 0
    for number, name in enumerate(names, 1):
        basis = fem.CellBasis(mesh, element, elements=np.flatnonzero(index == number), intorder=4)
        young, poisson, density = STACK if name == "stack" else metal
        if name != "shell" and not stack_mass:
            density *= 1e-3  # not zero, so that the mass matrix stays definite
        stiffness = stiffness + linear_elasticity(*lame_parameters(young, poisson)).assemble(basis)
        mass = mass + density * fem.BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
    x, y, z = whole.doflocs
    along = [np.zeros(whole.N) for _ in range(3)]
    for axis in range(3):
        along[axis][whole.nodal_dofs[axis]] = along[axis][whole.edge_dofs[axis]] = 1.0

    pad = y.max()
    in_wall = (y < -pad + 3.7e-3) & (np.abs(np.hypot(x, z) - 1e-3 * HOLE) < 2e-5)  # edges are chords of the wall
    free = np.flatnonzero(~in_wall if in_hole else np.abs(y + pad) > 1e-7)

    def load(facets: Any, axis: int) -> Any:  # a uniform unit load
        basis = fem.FacetBasis(mesh, element, facets=facets)
        form = fem.LinearForm(lambda v, _: v[axis]).assemble(basis)
        return form / (form @ along[axis])

    corners = mesh.p[:, mesh.facets]
    side = STACK_SIDE / 2 * 1e-3 + 1e-7
    ends = [
        np.flatnonzero((np.abs(corners[0] - end) < 1e-7).all(0) & (np.abs(corners[1:]) < side).all((0, 1)))
        for end in (-1e-3 * STACKS[-1][1], 1e-3 * STACKS[-1][1])
    ]
    loads = np.c_[load(ends[1], 0) - load(ends[0], 0), load(np.flatnonzero((corners[1] > pad - 1e-7).all(0)), 1)]
    compliance, frequencies = _solved(stiffness[free][:, free].tocsr(), mass[free][:, free].tocsr(), loads[free], modes)
    return Found(
        float(along[0] @ mass @ along[0]), compliance[0, 1] / compliance[0, 0], 1 / compliance[1, 1], tuple(frequencies)
    )


def _solved(stiffness: Any, mass: Any, loads: Any, modes: int) -> tuple[Any, Any]:
    """Return the compliance between loads [m/N] and the lowest frequencies [Hz], by shift-invert at zero."""
    solver = PyPardisoSolver()
    solver.factorize(stiffness)
    compliance = loads.T @ solver.solve(stiffness, loads)
    inverse = LinearOperator(stiffness.shape, matvec=lambda v: solver.solve(stiffness, v), dtype=float)
    squares = eigsh(stiffness, modes, mass, sigma=0.0, OPinv=inverse, return_eigenvectors=False)
    solver.free_memory(everything=True)
    return compliance, np.sqrt(np.sort(squares)) / (2 * np.pi)


def _mesh(shell: Any, folder: Path) -> tuple[Any, Any, Any, list[str]]:
    """Return points [m], tetrahedra, the material of each, from 1, and the names of the materials."""
    import netgen.occ as occ

    hole = cq.Workplane("XZ").circle(HOLE).extrude(50, both=True).val()
    cq.exporters.export(cq.Workplane(shell.cut(hole)), str(folder / "shell.step"))
    parts = [occ.OCCGeometry(str(folder / "shell.step")).shape]
    parts[0].mat("shell")
    parts[0].maxh = SHELL_EDGE
    for (start, end), half, name in (
        *((ends, STACK_SIDE / 2, "stack") for ends in STACKS),
        (BLOCK, BLOCK_SIDE / 2, "block"),
    ):
        parts.append(occ.Box((start, -half, -half), (end, half, half)))
        parts[-1].mat(name)
    mesh = occ.OCCGeometry(occ.Glue(parts)).GenerateMesh(maxh=STACK_EDGE, grading=0.5)
    points = 1e-3 * np.array([point.p for point in mesh.Points()])
    tets = np.array([[v.nr - 1 for v in each.vertices] for each in mesh.Elements3D()])
    index = np.array([each.index for each in mesh.Elements3D()])
    used, numbered = np.unique(tets, return_inverse=True)
    return points[used], numbered.reshape(tets.shape), index, [mesh.GetMaterial(i) for i in range(1, index.max() + 1)]
