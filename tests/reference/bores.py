"""The record of solids with rigid bores by NGSolve, which shares no shape function or assembly with the program.

Tetrahedra of order 4 with curved sides, refined towards the edges of the ports and the re-entrant edges by geometric
steps; displacements of the ports' faces are prescribed, and stiffnesses are the energies of the six motions. The record
states by how much it differs from that of order 3.

NGSolve is not among the requirements. Regenerate ``bores.toml`` (ten minutes)::

    pip install ngsolve
    python -m tests.reference.bores
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from flexdesign.design import study as studies
from flexdesign.fem.solving.port_compliance import MOTIONS
from tests.fem import bores

COMMAND = "python -m tests.reference.bores"
RECORD = Path(__file__).with_name("bores.toml")
#: Largest edge and edge at singular edges [mm], steps towards these, and the share each leaves.
MESHES = {
    "bush": (4.0, 2.0, 3), "thin_bush": (4.0, 1.5, 2), "link": (4.0, 2.0, 2), "lug": (4.0, 1.5, 2),
    "flanged": (4.0, 1.5, 2), "crossed": (5.0, 1.2, 2), "clevis": (5.0, 1.8, 3),
}  # fmt: skip
SHARE = 0.2


def solve(name: str, order: int) -> tuple[np.ndarray, int]:
    """Return the stiffness between the output's six motions, ground held, SI, and the number of unknowns."""
    import ngsolve as ng
    from netgen.occ import OCCGeometry

    with tempfile.TemporaryDirectory() as folder:
        design = studies.read(bores.write(name, Path(folder))).design
        part: Any = design.part()
        geometry = OCCGeometry(str(Path(folder) / f"{name}.step"))
    ports = {port.role: port for port in part.ports()}
    largest, fine, steps = MESHES[name]
    faces = list(geometry.shape.faces)
    for face in faces:
        face.name = "free"
    for role, port in ports.items():
        for index in port.faces:
            faces[index].name = role
    middles = np.array(bores.REENTRANT.get(name, [])).reshape(-1, 3)
    for face in faces:
        for edge in face.edges:
            seam = sum(any(edge == other for other in each.edges) for each in faces) < 2
            c = edge.center
            corner = len(middles) and np.abs(middles - [c.x, c.y, c.z]).sum(axis=1).min() < 1e-6
            if corner or (face.name != "free" and not seam):
                edge.maxh, edge.hpref = fine, 1.0
    mesh = ng.Mesh(OCCGeometry(geometry.shape).GenerateMesh(maxh=largest, curvaturesafety=1.5, grading=0.5))
    mesh.RefineHP(steps, SHARE)
    mesh.Curve(order)
    material = design.material
    lam, mu = (1e-6 * constant for constant in material.lame)  # N/mm^2
    space = ng.VectorH1(mesh, order=order, dirichlet="ground|output")
    u, v = space.TnT()
    strain = lambda w: ng.Sym(ng.Grad(w))  # noqa: E731
    work = (2 * mu * ng.InnerProduct(strain(u), strain(v)) + lam * ng.div(u) * ng.div(v)) * ng.dx(bonus_intorder=2)
    form = ng.BilinearForm(space, symmetric=True, condense=True)
    whole = ng.BilinearForm(space, symmetric=True, nonassemble=True)
    form += work
    whole += work
    form.Assemble()
    inverse = form.mat.Inverse(space.FreeDofs(coupling=True), inverse="sparsecholesky")
    at = 1e3 * (np.array(ports["output"].point) - np.array(part.moved()))
    x, y, z = (place - origin for place, origin in zip((ng.x, ng.y, ng.z), at.tolist(), strict=True))
    fields = []
    for motion in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -z, y), (z, 0, -x), (-y, x, 0)):
        field = ng.GridFunction(space)
        field.Set(ng.CoefficientFunction(motion), definedon=mesh.Boundaries("output"))
        rest = field.vec.CreateVector()
        rest.data = -(form.mat * field.vec)
        rest.data += form.harmonic_extension_trans * rest
        inner = field.vec.CreateVector()
        inner.data = inverse * rest
        field.vec.data += inner
        field.vec.data += form.harmonic_extension * field.vec
        fields.append(field)
    stiffness = np.zeros((6, 6))
    for i, field in enumerate(fields):
        force = field.vec.CreateVector()
        whole.Apply(field.vec, force)
        stiffness[i] = [ng.InnerProduct(force, other.vec) for other in fields]
    units = np.repeat([1e3**0.5, 1e-3**0.5], 3)  # from N and mm
    return (stiffness + stiffness.T) / 2 * np.outer(units, units), space.ndof


def both_boundaries(stiffness: np.ndarray) -> np.ndarray:
    """Return the six stiffnesses with the other motions held and with them free, shape (2, 6)."""
    scale = np.sqrt(np.diag(stiffness))
    compliance = np.linalg.inv(stiffness / np.outer(scale, scale)) / np.outer(scale, scale)
    return np.array([np.diag(stiffness), 1 / np.diag(compliance)])


def main() -> None:
    """Write the record."""
    lines = [
        "# Solids with rigid bores (tests/fem/bores.py): stiffness of the output in six directions, ground held, with",
        "# its other motions held and free [N/m, N m/rad]. Written by the command below; do not edit. last_change is",
        "# the largest relative change from order 3.", f'command = "{COMMAND}"', f'motions = "{" ".join(MOTIONS)}"',
    ]  # fmt: skip
    for name in bores.PORTS:
        before, _ = solve(name, 3)
        found, unknowns = solve(name, 4)
        old, new = both_boundaries(before), both_boundaries(found)
        lines += ["", f"[{name}]", f"n_dof = {unknowns}", f"last_change = {np.abs(old / new - 1).max():.1e}"]
        for boundary, values in zip(("held", "free"), new.tolist(), strict=True):
            lines.append(f"{boundary} = [{', '.join(f'{value:.6e}' for value in values)}]")
        print(*lines[-5:], sep="\n", flush=True)
    RECORD.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
