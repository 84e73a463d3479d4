"""NGSolve: tetrahedra of high order by Netgen, refined towards the re-entrant edges by prisms in geometric steps."""

from __future__ import annotations

from typing import Any

from studies.benchmarks.fem_peer_case import Case, PeerResult, Stopwatch, serve

PIP = "ngsolve"
#: Order, largest edge and edge at the roots [mm], and how often the mesh is refined towards these, each time to this
#: share (0 for not at all); from cheap to expensive.
SETTINGS: tuple[dict[str, Any], ...] = (
    {"order": 2, "largest": 4.0, "at_root": 1.0, "steps": 3, "share": 0.2},
    {"order": 3, "largest": 8.0, "at_root": 3.0, "steps": 2, "share": 0.15},
    {"order": 3, "largest": 4.0, "at_root": 1.0, "steps": 2, "share": 0.15},
    {"order": 3, "largest": 4.0, "at_root": 0.4, "steps": 0, "share": 0.15},
    {"order": 4, "largest": 8.0, "at_root": 3.0, "steps": 2, "share": 0.15},
)


def make_mesh(case: Case, largest: float, at_root: float, steps: int, share: float) -> Any:
    """Return the mesh [mm] with named faces."""
    import ngsolve
    from netgen.occ import OCCGeometry, WorkPlane

    plane = WorkPlane().MoveTo(*case.outline[0])
    for corner in case.outline[1:]:
        plane.LineTo(*corner)
    solid = plane.Close().Face().Extrude(case.depth)
    names = (
        ("middle", lambda c: abs(c.x)),
        ("back", lambda c: abs(c.z)),
        ("ground", lambda c: abs(c.y - case.ground_y)),
        ("input", lambda c: abs(c.x - case.input_x)),
    )
    for face in solid.faces:
        face.name = next((name for name, away in names if away(face.center) < 1e-9), "free")
    for edge in solid.edges:
        c = edge.center
        upright = abs(c.z - case.depth / 2) < 1e-9
        if upright and any(abs(c.x - x) + abs(c.y - y) < 1e-9 for x, y in case.roots):
            edge.maxh, edge.hpref = at_root, 1.0
    mesh = ngsolve.Mesh(OCCGeometry(solid).GenerateMesh(maxh=largest))
    if steps:
        mesh.RefineHP(steps, share)
    return mesh


def solve(case: Case, order: int, largest: float, at_root: float, steps: int, share: float) -> PeerResult:
    """Solve with inner unknowns condensed; of the direct solvers that the package brings, its own is the fastest."""
    import ngsolve as ng

    ng.SetNumThreads(2)
    watch = Stopwatch()
    mesh = make_mesh(case, largest, at_root, steps, share)  # outside: idle threads would wait busily during meshing
    took = watch.lap()
    with ng.TaskManager():
        held = {"dirichletx": "middle|ground", "dirichlety": "ground", "dirichletz": "back|ground"}
        space = ng.VectorH1(mesh, order=order, **held)
        u, v = space.TnT()
        mu = case.youngs_modulus / 2 / (1 + case.poissons_ratio)
        lam = 2 * mu * case.poissons_ratio / (1 - 2 * case.poissons_ratio)
        strain, virtual = ng.Sym(ng.Grad(u)), ng.Sym(ng.Grad(v))
        form = ng.BilinearForm(space, symmetric=True, condense=True)
        form += (2 * mu * ng.InnerProduct(strain, virtual) + lam * ng.div(u) * ng.div(v)) * ng.dx
        load = ng.LinearForm(space)
        load += case.traction * v[0] * ng.ds("input")
        form.Assemble()
        load.Assemble()
        inverse = form.mat.Inverse(space.FreeDofs(coupling=True), inverse="sparsecholesky")
        right = load.vec.CreateVector()
        right.data = load.vec + form.harmonic_extension_trans * load.vec
        moved = right.CreateVector()
        moved.data = inverse * right
        moved.data += form.harmonic_extension * moved
        moved.data += form.inner_solve * right
        work = ng.InnerProduct(load.vec, moved)
    return PeerResult(case.stiffness(work), space.ndof, took, watch.lap())


if __name__ == "__main__":
    serve(solve)
