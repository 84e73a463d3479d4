"""From coarse to fine: a part meshed and solved as often as a number of meshes, or an accuracy, asks for.

Meshes and solutions are cached by content, so that an interrupted run resumes where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from time import perf_counter

import numpy as np

from flexdesign.core import versions
from flexdesign.core.errors import InputError
from flexdesign.core.model import Member, Quantity, by_key
from flexdesign.core.result_cache import Cache, content_key
from flexdesign.design import part as parts
from flexdesign.design.study import Study
from flexdesign.fem import analysis, convergence, quantities
from flexdesign.fem.analysis import Solution
from flexdesign.fem.convergence import MeshNoise
from flexdesign.fem.meshing import element_count, local_thickness, methods, resolution_gate
from flexdesign.fem.meshing.conforming import NoMesh
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.local_extrusion import LocalExtrusion
from flexdesign.fem.meshing.local_thickness import LocalThickness
from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh
from flexdesign.fem.meshing.methods import Extruded, Grading, Method, Unstructured
from flexdesign.fem.meshing.resolution_gate import HingeCheck
from flexdesign.fem.solving.solver import NotEnoughMemory, NotPositiveDefinite

Progress = Callable[[str], None]

#: Distributions whose versions travel with every result.
LIBRARIES = ("cadquery", "pytetwild", "netgen-mesher", "scikit-fem", "numpy", "scipy", "pypardiso", "pyvista", "meshio")
#: Modules of `flexdesign.fem` that make neither meshes nor solutions.
AFTERWARDS = (
    "assembled_stage",
    "convergence",
    "corotated",
    "morphing",
    "polygon_domain",
    "plane_stress",
    "second_order",
)
#: Quantities of which an accuracy is asked.
ACCURACY_QUANTITIES = ("K_in", "lambda", "K_out")
#: Where an accuracy is asked for there are no more meshes than these.
MOST_LEVELS = 5


@dataclass(frozen=True)
class Level:
    """One mesh and its solution.

    Parameters
    ----------
    size
        Of its elements [m], by which results are extrapolated: the edge length at the hinge roots, or the
        representative cell size of a solid without hinges.
    mesh, solution
        The mesh of the fundamental domain, and what it gave.
    hinges
        What the mesh gate measured.
    seconds
        Wall time for mesh and solution; those of the run that made them, if cached.
    cached
        Whether the solution came from the cache.
    """

    size: float
    mesh: TaggedMesh
    solution: Solution
    hinges: Sequence[HingeCheck]
    seconds: float
    cached: bool


def refine(
    study: Study,
    part: parts.Part,
    body: Domain,
    method: Method,
    cache: Cache,
    progress: Progress,
    *,
    omit: int = 0,
    all_classes: bool = True,
) -> list[Level]:
    """Solve on one mesh after the other: as many as were asked for, or as an accuracy takes; `omit` the finest.

    Without `all_classes` lateral motions and modes are left out on all of them. A mesh that cannot be used, as it is
    too coarse for a hinge, is passed over if there are two others.

    Raises
    ------
    InputError
        If there are none, one would be too large, or memory does not suffice.
    """
    require_memory(study, method, omit, study.design.file)
    asked = study.mesh.accuracy
    first = study.mesh.levels - 1 + (method.head_start if asked else 0)
    most = (MOST_LEVELS if asked else study.mesh.levels) - omit
    driven = any(port.role == "input" for port in part.ports())
    levels: list[Level] = []
    refused: InputError | None = None
    for power in range(first, first - most, -1):
        try:
            coarseness = study.mesh.refinement**power
            # Lateral motions and modes converge sooner: with three meshes the finest goes without them, unless they are
            # all that is sought.
            whole = all_classes and (coarseness > 1.0 or len(levels) < 2 or not driven)
            levels.append(_level(study, part, body, method, coarseness, cache, progress, all_classes=whole))
        except InputError as error:
            if not isinstance(error.__cause__, MeshError):
                raise
            refused = refused or error
            progress(f"passing over this mesh: {error.remedy}")
            continue
        if (
            asked
            and len(levels) > 1
            and is_converged(asked, gather_quantities(study, levels, method.scatter), progress)
        ):
            break
    if refused and len(levels) < 2:
        raise refused
    return levels


def require_memory(study: Study, method: Method, omit: int, file: Path) -> None:
    """Refuse meshes that would be too large before the first is made.

    Of as many as an accuracy takes, the first two are always needed.

    Raises
    ------
    InputError
        If one would be, about the file.
    """
    power = study.mesh.levels - 2 + method.head_start if study.mesh.accuracy else omit
    try:
        method.require_room(study.mesh.refinement**power)
    except MeshError as error:
        raise InputError(file, "mesh", None, str(error)) from error


def estimated_error(found: Sequence[Quantity]) -> float:
    """Return the largest relative error of stiffnesses and amplification, as estimated."""
    worst = least_certain(found)
    return abs((worst.half_width or 0.0) / worst.value)


def least_certain(found: Sequence[Quantity]) -> Quantity:
    """Return the stiffness or amplification whose relative error is the largest, as estimated."""
    decisive = [quantity for quantity in found if quantity.name in ACCURACY_QUANTITIES and quantity.value]
    decisive = decisive or [quantity for quantity in found if quantity.name.startswith("k_")]
    return max(decisive, key=lambda quantity: abs((quantity.half_width or 0.0) / quantity.value))


def is_converged(asked: float, found: Sequence[Quantity], progress: Progress) -> bool:
    """Tell whether quantities have the relative accuracy that was asked for, as estimated."""
    error = estimated_error(found)
    progress(f"estimated error {100 * error:.2g} %, asked for {100 * asked:.2g} %")
    return error <= asked


def _level(
    study: Study,
    part: parts.Part,
    body: Domain,
    method: Method,
    coarseness: float,
    cache: Cache,
    progress: Progress,
    *,
    all_classes: bool,
) -> Level:
    design = study.design
    began = perf_counter()
    try:
        tagged, hinges = make_mesh(method, body, coarseness, part.linkage().of_kind("hinge"), cache, progress)
    except MeshError as error:
        raise InputError(design.file, "mesh", None, str(error)) from error
    actuator = design.actuator.installed_stiffness if design.actuator else 0.0
    count = study.modes.count if all_classes else 0
    if body.thin is not None:  # one class has what two planes would share among four
        count *= max(4 // body.copies, 1)
    material = design.material
    key = content_key(
        engine(), content_key(*tagged.arrays().values()), material.mechanics, actuator, count, all_classes,
        versions.installed(LIBRARIES),
        [vars(port) for port in part.ports()], [vars(member) for member in part.linkage().members],
        [vars(plane) for plane in body.planes],
    )  # fmt: skip
    size = method.size(tagged, coarseness)
    stored = cache.load("solution", key)
    if stored is not None:
        solution = Solution.from_store(*stored, part)
        hinges = _weighed(hinges, solution, design.file)
        return Level(size, tagged, solution, hinges, float(stored[1]["seconds"]), cached=True)

    def say(text: str) -> None:
        progress(f"solving: {text}")

    try:
        solution = analysis.solve(
            part, material, body, tagged, actuator=actuator, mode_count=count, all_classes=all_classes, progress=say
        )
    except NotEnoughMemory as error:
        remedy = f"{error}; ask for less: fewer mesh.levels, a larger mesh.at_root, or less mesh.accuracy"
        raise InputError(design.file, "mesh", None, remedy) from error
    except NotPositiveDefinite as error:
        remedy = (
            f"{error}: the ground does not hold all of the solid, as where a piece is joined by an edge or a point "
            "alone, or its faces are too small for the mesh; choose larger faces as ground, or reduce mesh.at_root"
        )
        raise InputError(design.file, "ports", None, remedy) from error
    seconds = perf_counter() - began
    arrays, table = solution.to_store()
    cache.store("solution", key, arrays, table | {"seconds": seconds})
    return Level(size, tagged, solution, _weighed(hinges, solution, design.file), seconds, cached=False)


def _weighed(checks: Sequence[HingeCheck], solution: Solution, file: Path) -> list[HingeCheck]:
    """Return what the gate measured, with the share of the strain energy that each hinge found on a solid holds.

    Raises
    ------
    InputError
        If the mesh cannot be used for that, about the file.
    """
    shares = solution.facts["hinge shares"]
    weighed = [replace(check, share=shares.get(check.hinge.name, 1.0)) for check in checks]
    try:
        local_thickness.require(weighed)
    except MeshError as error:
        raise InputError(file, "mesh", None, str(error)) from error
    return weighed


def make_mesh(
    method: Method, body: Domain, coarseness: float, hinges: Sequence[Member], cache: Cache, progress: Progress
) -> tuple[TaggedMesh, list[HingeCheck]]:
    """Return a mesh that passes the gate, and what that measured; one mesher is not deterministic and may try again.

    Where Netgen makes no mesh, pytetwild does, and the mesh says so. Only a mesh that passes is kept. How far hinges
    that were found on a solid are off is for the caller to judge (`local_thickness.require`): by what they carry.

    Raises
    ------
    MeshError
        If none passes.
    """
    asked = method.question(coarseness)
    question = content_key(engine(), body.fingerprint, body.joined, *asked, versions.installed(LIBRARIES))
    stored = cache.load("mesh", question)
    if stored is not None:
        tagged = TaggedMesh(**stored[0], mesher=str(stored[1].get("mesher", "")))
        return tagged, _check_mesh(method, tagged, body, hinges)
    method.require_room(coarseness)
    for left in reversed(range(method.tries)):
        progress(f"meshing with {method.finest_edge(coarseness) * 1e3:.3g} mm at the hinge roots ({method.mesher})")
        try:
            tagged = method.mesh(coarseness)
            checks = _check_mesh(method, tagged, body, hinges)
            if left:  # another mesh may do better
                local_thickness.require(checks)
            break
        except NoMesh as error:
            if not isinstance(method, LocalThickness):
                raise
            progress(f"{error}: pytetwild makes one instead")
            tagged, checks = make_mesh(method.instead, body, coarseness, hinges, cache, progress)
            break
        except MeshError as error:
            if not left:
                raise
            progress(f"meshing again: {error}")
    cache.store("mesh", question, tagged.arrays(), {"mesher": tagged.mesher})
    return tagged, checks


def _check_mesh(method: Method, mesh: TaggedMesh, body: Domain, hinges: Sequence[Member]) -> list[HingeCheck]:
    """Return what the gate measures: on the hinges that the part names, or on those found on its solid."""
    if isinstance(method, LocalThickness):
        return method.check(mesh)
    return resolution_gate.check(mesh, body, hinges)


def method_of(study: Study, part: parts.Piece, body: Domain) -> Method:
    """Return the way to mesh that the study asks for, or else the fastest that the part allows."""
    asked = study.mesh
    if asked.method == "extruded" and body.section is None and body.extrusion is None:
        remedy = (
            "the part does not declare itself prismatic; leave the method out, or let the part's prismatic() say so"
        )
        raise InputError(study.design.file, "mesh.method", asked.method, remedy)
    if body.thin is not None and body.extrusion is not None and asked.method != "wild":
        given = asked.at_root or methods.EXTRUDED_GRADING[0], asked.growth or methods.EXTRUDED_GRADING[1]
        layers = LocalExtrusion(body, *given, asked.largest, asked.envelope)
        if body.crossings is None or layers.follow_crossings(asked.refinement ** (asked.levels - 1)):
            return layers
    if body.thin is not None:
        at_root, growth = asked.at_root or local_thickness.AT_ROOT, asked.growth or local_thickness.GROWTH
        method = LocalThickness(body, at_root, growth, asked.largest, asked.envelope, asked.method != "wild")
        if asked.at_root or method.has_necks:
            return method

        def lengthened(factor: float) -> LocalThickness:
            return replace(method, at_root=factor * at_root)

        most = methods.MOST_BY_DEFAULT
        return lengthened(element_count.lengthened(body, lambda factor: lengthened(factor).sizing(1.0), most))
    extruded = asked.method != "wild" and body.section is not None
    at_root, growth = methods.EXTRUDED_GRADING if extruded else methods.UNSTRUCTURED_GRADING
    grading = Grading(body, part.linkage().members, asked.at_root or at_root, asked.growth or growth, asked.largest)
    return Extruded(grading) if extruded else Unstructured(grading, asked.envelope)


def gather_quantities(study: Study, levels: Sequence[Level], mesh_noise: MeshNoise) -> list[Quantity]:
    """Extrapolate every quantity over the meshes that know it; peaks of stress are judged by rules of their own."""
    found = [by_key(quantities.of_solution(study, level.solution)) for level in levels]
    gathered = []
    for quantity in extrapolate_quantities(found, [level.size for level in levels], mesh_noise):
        known = [level for level, there in zip(levels, found, strict=True) if quantity.key in there]
        finest = known[-1].solution.facts["unknowns"]
        gathered.append(replace(quantity, source=f"FEM, {len(known)} meshes to {finest} unknowns, extrapolated"))
    return gathered + quantities.peak_stresses(study, [lv.solution for lv in levels], [lv.size for lv in levels])


def extrapolate_quantities(
    found: Sequence[Mapping[str, Quantity]], sizes: Sequence[float], mesh_noise: MeshNoise
) -> list[Quantity]:
    """Extrapolate every quantity that the first mesh knows over all meshes that know it.

    Parameters
    ----------
    found
        The quantities of each mesh, coarse to fine, by their keys.
    sizes
        Edge length of each mesh at the hinge roots [m].
    mesh_noise
        Of the mesher.
    """
    errors = _remaining_errors(found, sizes)
    extrapolated = []
    for key, quantity in found[0].items():
        known = [i for i, there in enumerate(found) if key in there]
        values = [found[i][key].value - quantity.datum for i in known]
        limit = convergence.extrapolate(
            values, [sizes[i] for i in known], mesh_noise=mesh_noise, remaining_errors=[errors[i] for i in known]
        )
        extrapolated.append(replace(quantity, value=quantity.datum + limit.value, half_width=limit.error))
    return extrapolated


def _remaining_errors(found: Sequence[Mapping[str, Quantity]], sizes: Sequence[float]) -> list[float]:
    """Return the remaining error of each mesh, relative, in the input stiffness."""
    names = [key for key, quantity in found[0].items() if quantity.name == "K_in"]
    names = names or [key for key, quantity in found[0].items() if quantity.name.startswith("k_")]
    series = [[there[key].value for there in found] for key in names]
    limits = [convergence.extrapolate(values, sizes).value for values in series]
    gaps = [np.abs(np.array(values) / limit - 1) for values, limit in zip(series, limits, strict=True)]
    return [float(gap) for gap in np.max(gaps, axis=0)]


@cache
def engine() -> str:
    """Return a hash of the code that makes meshes and solutions, lest results of other code be taken for its.

    What is done with results afterwards does not enter: another estimate asks for no other meshes.
    """
    sources = sorted(Path(analysis.__file__).parent.rglob("*.py"))
    return content_key([source.read_text(encoding="utf-8") for source in sources if source.stem not in AFTERWARDS])
