"""gmsh and scikit-fem: quadratic tetrahedra, isotropic or in layers, with a size field that grows from the roots.

scikit-fem leaves the choice of a solver to its user; here it is PARDISO, as for flexdesign, or SuperLU without it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from studies.benchmarks.fem_peer_case import Case, PeerResult, Stopwatch, serve

PIP = "gmsh"
#: Edge at the roots [mm], its growth with the distance, largest edge [mm], number of layers (0: isotropic) and ratio of
#: each to the one before, on the way to the free face; from cheap to expensive.
SETTINGS: tuple[dict[str, Any], ...] = (
    {"at_root": 0.1, "growth": 0.6, "largest": 3.0, "layers": 0, "ratio": 1.0},
    {"at_root": 0.05, "growth": 0.8, "largest": 2.5, "layers": 4, "ratio": 0.7},
    {"at_root": 0.025, "growth": 0.8, "largest": 2.5, "layers": 4, "ratio": 0.7},
    {"at_root": 0.02, "growth": 0.6, "largest": 2.5, "layers": 5, "ratio": 0.6},
    {"at_root": 0.02, "growth": 0.6, "largest": 2.0, "layers": 6, "ratio": 0.7},
)


def make_mesh(
    case: Case, at_root: float, growth: float, largest: float, layers: int, ratio: float, order: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n, 3) [mm] and the nodes of the tetrahedra (m, 4), or (m, 10) of order 2 as gmsh lists them."""
    import gmsh

    gmsh.initialize()
    options = {"General.Terminal": 0, "General.NumThreads": 2, "Mesh.Algorithm3D": 10 if layers == 0 else 1}
    options |= dict.fromkeys(
        ("Mesh.MeshSizeExtendFromBoundary", "Mesh.MeshSizeFromPoints", "Mesh.MeshSizeFromCurvature"), 0
    )
    for name, value in options.items():
        gmsh.option.setNumber(name, value)
    kernel, field = gmsh.model.occ, gmsh.model.mesh.field
    corners = [kernel.addPoint(x, y, 0.0) for x, y in case.outline]
    sides = [kernel.addLine(*ends) for ends in zip(corners, corners[1:] + corners[:1], strict=True)]
    plan = kernel.addPlaneSurface([kernel.addCurveLoop(sides)])
    heights = np.cumsum(ratio ** np.arange(layers))
    stacked = {"numElements": [1] * layers, "heights": list(heights / heights[-1])} if layers else {}
    kernel.extrude([(2, plan)], 0.0, 0.0, case.depth, **stacked)
    kernel.synchronize()
    upright = []
    for _, curve in gmsh.model.getEntities(1):
        x, y, low, _, _, high = gmsh.model.getBoundingBox(1, curve)
        if high - low > case.depth / 2 and any(abs(x - a) + abs(y - b) < 1e-5 for a, b in case.roots):
            upright.append(curve)
    field.add("Distance", 1)
    field.setNumbers(1, "CurvesList", upright)
    field.setNumber(1, "Sampling", 2 * case.depth / at_root)
    field.add("MathEval", 2)
    field.setString(2, "F", f"Min({largest}, {at_root} + {growth} * F1)")
    field.setAsBackgroundMesh(2)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(order)
    tags, places, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType(gmsh.model.mesh.getElementType("tetrahedron", order))
    gmsh.finalize()
    number = np.empty(int(tags.max()) + 1, dtype=np.int64)
    number[tags] = np.arange(len(tags))
    used, tets = np.unique(number[nodes], return_inverse=True)
    return places.reshape(-1, 3)[used], tets.reshape(-1, 4 if order == 1 else 10)


def solve(case: Case, **settings: Any) -> PeerResult:
    """Solve with scikit-fem's own forms."""
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    watch = Stopwatch()
    points, tets = make_mesh(case, **settings)
    took = watch.lap()
    mesh = skfem.MeshTet(np.ascontiguousarray(points.T), np.ascontiguousarray(tets.T))
    element = skfem.ElementVector(skfem.ElementTetP2())
    basis = skfem.Basis(mesh, element, intorder=2)
    near = 1e-7
    pushed = mesh.facets_satisfying(lambda x: abs(x[0] - case.input_x) < near, boundaries_only=True)
    form = linear_elasticity(*lame_parameters(case.youngs_modulus, case.poissons_ratio))
    stiffness = skfem.asm(form, basis).tocsr()
    load = skfem.asm(
        skfem.LinearForm(lambda v, _: case.traction * v[0]), skfem.FacetBasis(mesh, element, facets=pushed, intorder=2)
    )
    held = [
        basis.get_dofs(mesh.facets_satisfying(lambda x: abs(x[0]) < near)).all("u^1"),
        basis.get_dofs(mesh.facets_satisfying(lambda x: abs(x[2]) < near)).all("u^3"),
        basis.get_dofs(mesh.facets_satisfying(lambda x: abs(x[1] - case.ground_y) < near)).all(),
    ]
    free = np.setdiff1d(np.arange(basis.N), np.concatenate(held))
    work = load[free] @ _solution(stiffness[free][:, free], load[free])
    return PeerResult(case.stiffness(float(work)), int(basis.N), took, watch.lap())


def _solution(matrix: Any, right: np.ndarray) -> np.ndarray:
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu

    try:
        from pypardiso import PyPardisoSolver
    except ImportError:
        return np.asarray(splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A").solve(right))
    upper = sp.triu(matrix, format="csr")
    upper.sort_indices()
    return np.asarray(PyPardisoSolver(mtype=2).solve(upper, right))


if __name__ == "__main__":
    serve(solve)
