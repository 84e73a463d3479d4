"""flexdesign itself, as a sweep asks it: one mesh, or two and the limit extrapolated from them.

The section follows from the part's corners where its sides are straight, and read off its CAD solid where they are not.

It answers more than the others: all port loads that fit the symmetry, checks of every solve, stress, and energies.
"""

from __future__ import annotations

from typing import Any

from studies.benchmarks.fem_peer_case import Case, PeerResult, Stopwatch, serve

#: Coarseness of each mesh, 1 being the finest of a validation with default settings; from cheap to expensive.
SETTINGS: tuple[dict[str, Any], ...] = (
    {"coarseness": [1.5]},
    {"coarseness": [1.35]},
    {"coarseness": [1.2]},
    {"coarseness": [1.0]},
    {"coarseness": [0.9]},
    {"coarseness": [1.5, 1.2]},
    {"coarseness": [1.35, 1.0]},
)
#: Ways that cost more: the part without its symmetry, and tetrahedra that know of no section, raw and extrapolated.
OTHER_WAYS: dict[str, tuple[dict[str, Any], ...]] = {
    "the whole part, without symmetry": ({"coarseness": [1.35], "symmetric": False},),
    "wild tetrahedra of the same quarter": (
        {"coarseness": [1.1], "wild": True},
        {"coarseness": [1.5, 1.1], "wild": True},
    ),
}
#: How far the unstructured mesher may move the surface, in hinge thicknesses, unless a study says otherwise.
ENVELOPE = 0.05


def solve(case: Case, coarseness: list[float], symmetric: bool = True, wild: bool = False) -> PeerResult:
    """Solve as a sweep does, without its files."""
    from flexdesign.design import design
    from flexdesign.fem import analysis, convergence
    from flexdesign.fem.meshing import domain, methods, polygon_domain

    read = design.read(design.find(case.name))
    watch = Stopwatch()
    part = read.part()
    members = part.linkage().members
    told = polygon_domain.of_part(part) if symmetric and not wild else None
    body = told or domain.of_part(part, symmetric=symmetric, chord=domain.chord(part))
    grading = methods.Grading(
        body, members, *(methods.UNSTRUCTURED_GRADING if wild else methods.EXTRUDED_GRADING), None
    )
    method: methods.Method = methods.Unstructured(grading, ENVELOPE) if wild else methods.Extruded(grading)
    meshing, solving, values, sizes, unknowns = watch.lap(), 0.0, [], [], 0
    for level in coarseness:
        mesh = method.mesh(level)
        meshing += watch.lap()
        solution = analysis.solve(part, read.material, body, mesh, all_classes=False)
        values.append(solution.compliance.input_stiffness)
        sizes.append(method.size(mesh, level))
        unknowns = max(unknowns, solution.facts["unknowns"])
        solving += watch.lap()
    found = values[0]
    if len(values) > 1:
        found = convergence.extrapolate(values, sizes, mesh_noise=method.scatter).value
    return PeerResult(1e-3 * found, unknowns, meshing, solving)


if __name__ == "__main__":
    serve(solve)
