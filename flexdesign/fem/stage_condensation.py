"""A stage's parts meshed and condensed, each kind once however often it is built in, and put together; mesh by mesh.

Condensed parts are kept at unit modulus and density, and serve every isotropic material with the same Poisson's ratio:
stiffness goes with Young's modulus, mass with density.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

from flexdesign.core import versions
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Cache, content_key
from flexdesign.design import part as parts
from flexdesign.design.assembly import Assembly
from flexdesign.design.materials import Material
from flexdesign.design.part import Piece
from flexdesign.design.study import Study
from flexdesign.fem import mesh_refinement
from flexdesign.fem.convergence import MeshNoise
from flexdesign.fem.mesh_refinement import LIBRARIES, MOST_LEVELS, Progress
from flexdesign.fem.meshing import domain, local_thickness
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import MeshError
from flexdesign.fem.meshing.resolution_gate import HingeCheck
from flexdesign.fem.quantities.stage import of_stage
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.solver import NotEnoughMemory
from flexdesign.fem.superelements import superelement
from flexdesign.fem.superelements.assembled_stage import AssembledStage
from flexdesign.fem.superelements.superelement import Superelement

#: Port faces sit on rigid bodies, whose motions are polynomials of this degree.
DEGREE = 1
#: The modulus [Pa] and density [kg/m^3] at which condensed parts are kept.
UNIT_MODULUS, UNIT_DENSITY = 1e9, 1e3
#: Internal modes of each symmetry class: of a part with inputs, and of a hinge, whose own are far above any stage's.
MODES, HINGE_MODES = 3, 0


@dataclass(frozen=True)
class Kind:
    """One kind of part on one mesh.

    Parameters
    ----------
    name
        Of its class.
    method, scatter
        How it was meshed, and how far results lie apart on meshes made alike.
    elements
        How many there are in the stage.
    part
        Condensed.
    copies
        Mirror images that make the whole part of what was meshed.
    hinges
        What the mesh gate measured.
    seconds
        Wall time for mesh and condensation; of the run that made them, if cached.
    cached
        Whether it came from the cache.
    key
        Hash of everything it was condensed from.
    """

    name: str
    method: str
    scatter: MeshNoise
    elements: int
    part: Superelement
    copies: int
    hinges: Sequence[HingeCheck]
    seconds: float
    cached: bool
    key: str


@dataclass(frozen=True)
class PartSolid:
    """One kind of part as it is drawn, which no mesh changes.

    Parameters
    ----------
    piece
        Its shape.
    body
        The domain that is meshed.
    elements
        Names of those in the stage that are one.
    """

    piece: Piece
    body: Domain
    elements: tuple[str, ...]


@dataclass(frozen=True)
class StageLevel:
    """All parts of a stage on meshes of one coarseness.

    Parameters
    ----------
    size
        Edge length at the roots of the first kind's hinges [m], by which results are extrapolated.
    kinds
        Each once.
    stage
        Put together of them.
    found
        The quantities of that, by key.
    """

    size: float
    kinds: tuple[Kind, ...]
    stage: AssembledStage
    found: Mapping[str, Quantity]

    @property
    def unknowns(self) -> int:
        """Unknowns that the whole stage would have on such meshes, its bodies left out."""
        return sum(kind.elements * kind.copies * kind.part.unknowns for kind in self.kinds)

    @property
    def seconds(self) -> float:
        """Wall time for all kinds."""
        return sum(kind.seconds for kind in self.kinds)


def build_solids(study: Study, assembly: Assembly, progress: Progress = lambda _: None) -> list[PartSolid]:
    """Build the solid of every kind of part of a stage.

    Raises
    ------
    InputError
        If the material or a solid cannot be used.
    """
    material = study.design.material
    if material.crystal is not None:
        remedy = "is a crystal, and parts lie in a stage in several directions; choose an isotropic material"
        raise InputError(study.design.file, "material", material.name, remedy)
    found = []
    for piece, elements in assembly.kinds():
        progress(f"{type(piece).__name__}: building the solid")
        body = domain.of_part(piece, chord=domain.chord(piece))
        found.append(PartSolid(piece, body, tuple(element.name for element in elements)))
    return found


def condense(
    study: Study,
    assembly: Assembly,
    kinds: Sequence[PartSolid],
    coarseness: float,
    cache: Cache,
    *,
    interior: bool = False,
    progress: Progress = lambda _: None,
) -> StageLevel:
    """Condense every kind of part of a stage.

    Parameters
    ----------
    study
        How to mesh, and of what the design is made.
    assembly
        The stage.
    kinds
        Its parts, each kind once; see `build_solids`.
    coarseness
        1 for the finest mesh.
    cache
        Where meshes and condensed parts are looked up and kept.
    interior
        Whether to keep what goes on inside, for pictures and large displacements.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If a part, or its mesh, cannot be used, or memory does not suffice.
    """
    made, sizes = [], []
    by_element: dict[str, Superelement] = {}
    for kind in kinds:
        one, size = _kind(study, kind, coarseness, cache, interior, progress)
        made.append(one)
        sizes.append(size)
        by_element |= dict.fromkeys(kind.elements, one.part)
    progress("putting the stage together")
    stage = AssembledStage(assembly, by_element, study.design.material.density)
    return StageLevel(sizes[0], tuple(made), stage, by_key(of_stage(study, stage)))


def refine(
    study: Study, assembly: Assembly, cache: Cache, progress: Progress = lambda _: None, *, interior: int = 0
) -> list[StageLevel]:
    """Condense on meshes from coarse to fine: as many as were asked for, or as an accuracy takes.

    The `interior` coarsest levels keep their interior displacements. Raises as `condense`.
    """
    asked, count = study.mesh.accuracy, study.mesh.levels
    kinds, levels = build_solids(study, assembly, progress), list[StageLevel]()
    for kind in kinds:
        method = mesh_refinement.method_of(study, kind.piece, kind.body)
        mesh_refinement.require_memory(study, method, 0, parts.file_of(type(kind.piece)))
    for number in range(1, (MOST_LEVELS if asked else count) + 1):
        coarseness, words = study.mesh.refinement ** (count - number), f"mesh {number}" + f" of {count}" * (not asked)
        say = with_label(progress, words)
        levels.append(condense(study, assembly, kinds, coarseness, cache, interior=number <= interior, progress=say))
        if asked and number > 1 and mesh_refinement.is_converged(asked, gather_quantities(levels), progress):
            break
    return levels


def gather_quantities(levels: Sequence[StageLevel]) -> list[Quantity]:
    """Extrapolate every quantity over the meshes."""
    source = f"FEM, {len(levels)} meshes, the finest of {levels[-1].unknowns} unknowns condensed, extrapolated"
    limits = mesh_refinement.extrapolate_quantities(
        [level.found for level in levels], [level.size for level in levels], mesh_noise_of(levels)
    )
    return [replace(quantity, source=source) for quantity in limits]


def mesh_noise_of(levels: Sequence[StageLevel]) -> MeshNoise:
    """Return the largest of the parts' meshes."""
    return max((kind.scatter for kind in levels[0].kinds), key=lambda noise: (noise.relative, noise.share))


def with_label(progress: Progress, label: str) -> Progress:
    """Return a progress whose words a label stands before."""
    return lambda text: progress(f"{label}: {text}")


def _kind(
    study: Study, kind: PartSolid, coarseness: float, cache: Cache, interior: bool, progress: Progress
) -> tuple[Kind, float]:
    """Return a kind of part, and the edge length at its hinge roots [m]."""
    piece, body = kind.piece, kind.body
    began, name, file = perf_counter(), type(piece).__name__, parts.file_of(type(piece))
    material = study.design.material
    unit = Material("unit", UNIT_MODULUS, material.poissons_ratio, UNIT_DENSITY, None)

    def say(text: str) -> None:
        progress(f"{name}: {text}")

    method = mesh_refinement.method_of(study, piece, body)
    modes = MODES if any(port.role == "input" for port in piece.ports()) else HINGE_MODES
    try:
        mesh, hinges = mesh_refinement.make_mesh(method, body, coarseness, piece.linkage().of_kind("hinge"), cache, say)
        local_thickness.require(hinges)
        key = content_key(
            mesh_refinement.engine(), content_key(*mesh.arrays().values()), unit.mechanics, DEGREE, modes, interior,
            versions.installed(LIBRARIES), [vars(port) for port in piece.ports()], [vars(p) for p in body.planes],
        )  # fmt: skip
        stored = cache.load("superelement", key)
        if stored is not None:
            found = Superelement.from_store(*stored, piece, Elasticity(mesh, unit), body)
            seconds = float(stored[1]["seconds"])
        else:
            found = superelement.condense(
                piece, unit, body, mesh, degree=DEGREE, mode_count=modes, interior=interior, progress=say
            )
            seconds = perf_counter() - began
            arrays, table = found.to_store()
            cache.store("superelement", key, arrays, table | {"seconds": seconds})
    except MeshError as error:
        raise InputError(file, "mesh", None, str(error)) from error
    except NotEnoughMemory as error:
        raise InputError(file, "mesh", None, f"{error}; ask for a coarser mesh: mesh.levels, mesh.at_root") from error
    part = found.with_material(material)
    count, cached = len(kind.elements), stored is not None
    made = Kind(name, method.name, method.scatter, count, part, body.copies, hinges, seconds, cached, key)
    return made, method.size(mesh, coarseness)
