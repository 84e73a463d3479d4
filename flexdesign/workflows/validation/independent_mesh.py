"""One mesh of another mesher on the same domain, as a check of the numbers that a validation reports.

A validation of an extrusion solves on layers of prisms cut into tetrahedra. Pytetwild knows nothing of the extrusion:
its tetrahedra come from the surface alone. One such mesh has no second from which to extrapolate, and its error is
estimated by recovery (Zienkiewicz and Zhu, Int. J. Numer. Methods Eng. 24 (1987), 337): with the stresses averaged at
the nodes for the true ones, the energy of the difference is, relative to the whole, the share by which the mesh makes
the body too stiff, as the error is orthogonal to what the mesh can do. Averaged stresses are not true ones at a sharp
root, where they fall short: the energy of the difference is then about half of the error. Hence the value is corrected
by twice the share, and once the share is its estimated error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import versions
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.core.result_cache import Cache, content_key
from flexdesign.design.materials import Material
from flexdesign.design.part import Part
from flexdesign.design.study import Study
from flexdesign.fem import analysis, mesh_refinement
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh
from flexdesign.fem.meshing.methods import Unstructured
from flexdesign.fem.post_processing.stress import NODES
from flexdesign.fem.solving.elasticity import Elasticity, shape_functions, stress_points

Progress = Callable[[str], None]
FloatArray = NDArray[np.float64]
#: What is compared.
KEYS = ("K_in_output_free", "lambda_output_free", "K_out_input_free")
#: How much coarser than the finest of its kind the mesh is: seconds, and some percent of the stiffness.
COARSENESS = 1.35**2
#: Most tetrahedra of the mesh, as estimated. Parts on leaves have up to 15 000, made in half a minute of processor
#: time. Those on notches have 60 000 to 190 000: the shipped lever on one notch, of 70 000, took three minutes and had
#: 650 000 unknowns; bridges took as long, three times, as the mesher rounded their necks off too much.
MOST = 50_000
#: By how many times the recovered energy a mesh is too stiff at sharp roots, and how well that is known.
SHORT, DOUBT = 2.0, 1.0
#: The remaining error of a ratio of two compliances, whose errors mostly cancel.
CANCELS = 0.2


@dataclass(frozen=True)
class IndependentCheck:
    """What one mesh of another mesher says.

    Parameters
    ----------
    found
        Stiffnesses and amplification by their keys, freed of the estimated error, with it as sigma; empty if it failed.
    chosen
        The same as the validation reports them.
    unknowns
        Of the mesh.
    seconds
        Wall time of mesh and solution; of the run that made them, if cached.
    failure
        Why it gave no answer; empty if it did.
    """

    found: Mapping[str, Quantity]
    chosen: Mapping[str, Quantity]
    unknowns: int = 0
    seconds: float = 0.0
    failure: str = ""

    def gap(self, key: str) -> float:
        """Return by how much its answer differs from the reported one, relative."""
        return self.found[key].value / self.chosen[key].value - 1

    def allowed(self, key: str) -> float:
        """Return the sum of both estimates, relative."""
        both = (self.found[key].half_width or 0.0) + (self.chosen[key].half_width or 0.0)
        return both / abs(self.chosen[key].value)

    @property
    def agrees(self) -> bool:
        """Whether every number agrees within both estimates."""
        return bool(self.found) and all(abs(self.gap(key)) <= self.allowed(key) for key in self.found)


def run(
    study: Study, part: Part, body: Domain, reported: Mapping[str, Quantity], cache: Cache, progress: Progress
) -> IndependentCheck:
    """Mesh a domain by pytetwild, solve, and compare the result with the reported one; a failure is an answer, too.

    Parameters
    ----------
    study, part, body
        What was validated, and its domain.
    reported
        Its quantities by key.
    cache
        Where the mesh is looked up and kept.
    progress
        Receives a text about the progress.
    """
    began = perf_counter()
    chosen = {key: reported[key] for key in KEYS if key in reported}
    changes = {"method": "wild", "at_root": None, "growth": None}
    asked = replace(study, mesh=study.mesh.model_copy(update=changes))
    method = mesh_refinement.method_of(asked, part, body)

    def say(text: str) -> None:
        progress(f"independent mesh: {text}")

    if isinstance(method, Unstructured) and (count := method.estimate(COARSENESS)) > MOST:
        failure = f"it would have about {1000 * round(count / 1000)} tetrahedra, and is made of up to {MOST}"
        return IndependentCheck({}, chosen, seconds=perf_counter() - began, failure=failure)
    try:
        mesh, _ = mesh_refinement.make_mesh(method, body, COARSENESS, part.linkage().of_kind("hinge"), cache, say)
    except MeshError as error:
        return IndependentCheck({}, chosen, seconds=perf_counter() - began, failure=str(error))
    key = content_key(
        mesh_refinement.engine(), content_key(*mesh.arrays().values()), study.design.material.mechanics,
        versions.installed(mesh_refinement.LIBRARIES), [vars(port) for port in part.ports()],
    )  # fmt: skip
    stored = cache.load("independent", key)
    if stored is None:
        try:
            answer = _solve(part, study.design.material, body, mesh, say)
        except (MemoryError, InputError) as error:
            return IndependentCheck({}, chosen, seconds=perf_counter() - began, failure=str(error))
        answer["seconds"] = perf_counter() - began
        cache.store("independent", key, {}, answer)
    else:
        answer = stored[1]
    found = {
        key: replace(
            chosen[key], value=value * corrected, half_width=abs(value) * error, source="FEM, one pytetwild mesh"
        )
        for key, value, (corrected, error) in zip(KEYS, answer["values"], _extrapolate(*answer["shares"]), strict=True)
        if key in chosen
    }
    return IndependentCheck(found, chosen, int(answer["unknowns"]), float(answer["seconds"]))


def _solve(part: Part, material: Material, body: Domain, mesh: TaggedMesh, say: Progress) -> dict[str, Any]:
    """Return stiffnesses and amplification of a mesh, and what recovery says of them."""
    found = analysis.solve(part, material, body, mesh, actuator=0.0, mode_count=0, all_classes=False, progress=say)
    c = found.compliance
    return {
        "values": [c.input_stiffness, c.amplification, c.output_stiffness(0.0)],
        "shares": list(recovery_error(Elasticity(mesh, material), found.input_field, found.output_field)),
        "unknowns": found.facts["unknowns"],
    }


def recovery_error(body: Elasticity, first: FloatArray, second: FloatArray) -> tuple[float, float, float]:
    """Return the energy between stresses averaged at the nodes and those of the elements, relative to the whole.

    Parameters
    ----------
    body
        The discretised domain.
    first, second
        Nodal displacements of two load cases, shape (n, 3).

    Returns
    -------
    Of the first case, mixed, and of the second.
    """
    points, weights = stress_points()
    shapes = shape_functions(points)
    corners = body.mesh.points[body.mesh.tets]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6

    def smooth(of: Callable[[FloatArray, FloatArray], FloatArray], field: FloatArray) -> FloatArray:
        total = np.zeros((body.n_dofs // 3, 3, 3))
        np.add.at(total, body.nodes, of(field, NODES))
        mean = total / np.bincount(body.nodes.ravel(), minlength=len(total))[:, None, None]
        return np.asarray(np.einsum("qn,enij->eqij", shapes, mean[body.nodes], optimize=True))

    def energy(stress: FloatArray, strain: FloatArray) -> float:
        return float(np.einsum("e,q,eqij,eqij->", volumes, weights, stress, strain, optimize=True))

    fields = (first, second)
    stress, strain = ([of(f, points) for f in fields] for of in (body.stress, body.strain))
    apart = [smooth(body.stress, f) - s for f, s in zip(fields, stress, strict=True)]
    strayed = [smooth(body.strain, f) - e for f, e in zip(fields, strain, strict=True)]
    one, mixed, two = (energy(apart[a], strayed[b]) / energy(stress[a], strain[b]) for a, b in ((0, 0), (0, 1), (1, 1)))
    return one, mixed, two


def _extrapolate(one: float, mixed: float, two: float) -> list[tuple[float, float]]:
    """Return for K_in, lambda and K_out the factor that frees the value of its error, and the relative error left.

    A compliance is too small by its share of energy; K_in and K_out are inverse compliances, lambda the mixed one over
    that of the input.
    """
    apart = mixed - one
    return [
        (1 / (1 + SHORT * one), DOUBT * one),
        (1 + SHORT * apart, DOUBT * abs(apart) + CANCELS * one),
        (1 / (1 + SHORT * two), DOUBT * two),
    ]
