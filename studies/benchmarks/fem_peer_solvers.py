"""flexdesign's other times: ten modes, one iteration under large displacements, and a factor by every solver at hand.

In addition to the solvers that flexdesign uses, PARDISO and SciPy's SuperLU, CHOLMOD is tried as kvxopt brings it
(GPL), and QDLDL. Each runs in a process of its own; `fem_peers` prints the table.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from studies.benchmarks.fem_peer_case import Stopwatch

#: Coarseness of the extruded mesh for about these numbers of unknowns.
COARSENESS = {"40 k": 1.4, "100 k": 1.01, "167 k": 0.84}
MODES = 10


def body_of(design_name: str, unknowns: str) -> tuple[Any, Any, Any]:
    """Return part, domain and body of a design."""
    from flexdesign.design import design
    from flexdesign.fem.meshing import domain, methods
    from flexdesign.fem.solving.elasticity import Elasticity

    read = design.read(design.find(design_name))
    part = read.part()
    members = part.linkage().members
    body = domain.of_part(part, chord=domain.chord(part))
    method = methods.Extruded(methods.Grading(body, members, *methods.EXTRUDED_GRADING, None))
    return part, body, Elasticity(method.mesh(COARSENESS[unknowns]), read.material)


def ten_modes(design_name: str) -> dict[str, float]:
    """Time assembly, factor and the lowest modes of the symmetric class, once the mesh is there."""
    from flexdesign.fem.solving import modes, port_compliance, statics

    part, domain, body = body_of(design_name, "167 k")
    import pypardiso  # noqa: F401

    watch = Stopwatch()
    stiffness, mass = body.stiffness(), body.mass()
    space = port_compliance.port_space(body, domain, part.ports())
    assembly = watch.lap()
    system = statics.class_system(body, domain, port_compliance.classes(domain)[0], stiffness, [domain.ports["ground"]])
    factor = watch.lap()
    modes.class_modes(system, mass, space, MODES, 0.0)
    return {"unknowns": body.n_dofs, "assembly": assembly, "factor": factor, "modes": watch.lap()}


def large_iteration(design_name: str) -> dict[str, float]:
    """Time one Newton iteration, kernels compiled and pattern known: forces and tangent, factor, solve."""
    from flexdesign.fem.solving import port_compliance, statics
    from flexdesign.fem.solving.large_displacement import LargeDisplacement
    from flexdesign.fem.solving.solver import factorize

    _, domain, body = body_of(design_name, "100 k")
    free = statics.free_dofs(body, domain, port_compliance.classes(domain)[0], [domain.ports["ground"]])
    model, displacement = LargeDisplacement(body, free), np.zeros(body.n_dofs)
    watch = Stopwatch()
    model.forces_and_tangent(displacement)
    beginning = watch.lap()
    forces, tangent = model.forces_and_tangent(displacement)
    evaluated = watch.lap()
    factorize(tangent).solve(forces[free])
    return {"unknowns": body.n_dofs, "once": beginning, "forces and tangent": evaluated, "factor": watch.lap()}


def factor(design_name: str, unknowns: str, solver: str) -> dict[str, float]:
    """Time a solver's factor of the stiffness, and one solution with it; its residual shows that it is one."""
    from flexdesign.fem.solving import port_compliance, statics

    _, domain, body = body_of(design_name, unknowns)
    free = statics.free_dofs(body, domain, port_compliance.classes(domain)[0], [domain.ports["ground"]])
    upper = body.stiffness()[free][:, free].tocsr()
    upper.sort_indices()
    right = np.random.default_rng(0).standard_normal(len(free))
    make = SOLVERS[solver](upper)
    watch = Stopwatch()
    solution = make()
    made = watch.lap()
    found = solution(right)
    solving = watch.lap()
    residual = np.linalg.norm(upper @ found + sp.triu(upper, k=1).T @ found - right) / np.linalg.norm(right)
    return {"unknowns": len(free), "factor": made, "solve": solving, "residual": float(residual)}


Solution = Callable[[np.ndarray], np.ndarray]


def _pardiso(upper: sp.csr_matrix) -> Callable[[], Solution]:
    import pypardiso  # noqa: F401

    from flexdesign.fem.solving.solver import Pardiso

    return lambda: Pardiso(upper).solve


def _superlu(upper: sp.csr_matrix) -> Callable[[], Solution]:
    from flexdesign.fem.solving.solver import SuperLU

    return lambda: SuperLU(upper).solve


def _cholmod(upper: sp.csr_matrix) -> Callable[[], Solution]:
    from kvxopt import cholmod, matrix, spmatrix

    cholmod.options["supernodal"] = 2
    lower = upper.T.tocoo()

    def make() -> Solution:
        rows, columns = (matrix(places.astype(np.int64)) for places in (lower.row, lower.col))
        system = spmatrix(matrix(lower.data), rows, columns, lower.shape)
        factor = cholmod.symbolic(system)
        cholmod.numeric(system, factor)

        def solve(right: np.ndarray) -> np.ndarray:
            answer = matrix(right)
            cholmod.solve(factor, answer)
            return np.array(answer).ravel()

        return solve

    return make


def _qdldl(upper: sp.csr_matrix) -> Callable[[], Solution]:
    import qdldl

    return lambda: qdldl.Solver(upper.tocsc(), upper=True).solve


#: Solvers by name, and the package that brings each.
SOLVERS: dict[str, Callable[[sp.csr_matrix], Callable[[], Solution]]] = {
    "PARDISO": _pardiso,
    "SuperLU": _superlu,
    "CHOLMOD": _cholmod,
    "QDLDL": _qdldl,
}
PIP = {"PARDISO": "pypardiso", "SuperLU": "scipy", "CHOLMOD": "kvxopt", "QDLDL": "qdldl"}


if __name__ == "__main__":
    tasks: dict[str, Callable[..., dict[str, float]]] = {"modes": ten_modes, "large": large_iteration, "factor": factor}
    print(json.dumps(tasks[sys.argv[1]](*sys.argv[2:])))
