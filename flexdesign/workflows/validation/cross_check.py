"""One part solved in every way that it allows, the answers side by side.

Two ways may differ in how the domain is meshed, and in whether it is the fundamental domain, whose mirror images make
the whole, or the whole itself. All of them share the elements and the ports: a cross-check tests meshes and
symmetry, not elasticity.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Cache
from flexdesign.design.part import Part
from flexdesign.design.study import Study
from flexdesign.fem import mesh_refinement
from flexdesign.fem.mesh_refinement import Level
from flexdesign.fem.meshing import domain
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.methods import Method

Progress = Callable[[str], None]

#: What is compared.
KEYS = ("K_in_output_free", "lambda_output_free", "K_out_input_free")


@dataclass(frozen=True)
class Way:
    """One way to solve a part, and what it found.

    Parameters
    ----------
    method
        How it was meshed.
    planes
        The axes of the symmetry planes that bound the domain, such as ``"xz"``; empty for the whole part.
    found
        Stiffnesses and amplification by their keys, extrapolated; empty if it failed.
    unknowns
        Of the finest mesh.
    seconds
        Wall time of all its meshes and solves; those of the run that made them, if cached.
    failure
        Why it gave no answer; empty if it did.
    """

    method: str
    planes: str
    found: Mapping[str, Quantity]
    unknowns: int = 0
    seconds: float = 0.0
    failure: str = ""

    def difference(self, other: Way, key: str) -> tuple[float, float]:
        """Return by how much this way's answer differs from another's: relative, and in their combined estimate.

        The estimates combine in quadrature, as errors do that have nothing to do with one another.
        """
        mine, theirs = self.found[key], other.found[key]
        gap = mine.value - theirs.value
        combined = math.hypot(mine.half_width or 0.0, theirs.half_width or 0.0)
        return gap / theirs.value, abs(gap) / combined if combined else (math.inf if gap else 0.0)


@dataclass(frozen=True)
class CrossCheck:
    """The way that a validation chose, and the others."""

    chosen: Way
    others: tuple[Way, ...]

    @property
    def answered(self) -> list[Way]:
        """The other ways that gave an answer."""
        return [way for way in self.others if way.found]

    def worst(self) -> tuple[Way, str, float]:
        """Return the way and the quantity that differ most, in units of the combined estimate, and by how many.

        Raises
        ------
        ValueError
            If no other way gave an answer.
        """
        gaps = [(way, key, way.difference(self.chosen, key)[1]) for way in self.answered for key in KEYS]
        return max(gaps, key=lambda gap: gap[2])

    @property
    def agrees(self) -> bool:
        """Whether every way agrees with the chosen one within the combined estimates."""
        return bool(self.answered) and self.worst()[2] <= 1.0


def run(
    study: Study,
    part: Part,
    body: Domain,
    method: Method,
    levels: Sequence[Level],
    cache: Cache,
    progress: Progress = lambda _: None,
) -> CrossCheck:
    """Solve a part in the ways that a validation did not choose.

    Parameters
    ----------
    study, part
        What was asked, and of what.
    body, method, levels
        The domain, the method and the meshes of the way that was chosen.
    cache
        Where meshes and solutions are looked up and kept.
    progress
        Receives a text about the progress.
    """
    chosen = _solve(study, method, body, levels)
    bodies = [body]
    if body.planes:
        bodies.append(domain.of_part(part, symmetric=False, chord=domain.chord(part)))
    others = []
    for piece in bodies:
        for name in ("extruded", "wild") if piece.section is not None else ("wild",):
            if name != method.name or piece is not body:
                others.append(_try(_by(study, name, method.name), part, piece, cache, progress))
    return CrossCheck(chosen, tuple(others))


def _by(study: Study, method: str, chosen: str) -> Study:
    """Return the study with a method, without modes, and with its own grading if that was chosen for another method."""
    changes: dict[str, object] = {"method": method, "accuracy": None}
    if method != chosen:
        changes |= {"at_root": None, "growth": None}
    modes = study.modes.model_copy(update={"count": 0})
    return replace(study, mesh=study.mesh.model_copy(update=changes), modes=modes)


def _try(study: Study, part: Part, body: Domain, cache: Cache, progress: Progress) -> Way:
    """Solve in one way; a mesher or a memory that fails is an answer, too."""
    method = mesh_refinement.method_of(study, part, body)
    where = "symmetry domain" if body.planes else "whole part"
    # The whole part has a multiple of the unknowns, and time grows faster than they: two meshes give an estimate.
    omit = 0 if body.planes else max(study.mesh.levels - 2, 0)

    def say(text: str) -> None:
        progress(f"cross-check, {method.name}, {where}: {text}")

    try:
        return _solve(study, method, body, mesh_refinement.refine(study, part, body, method, cache, say, omit=omit))
    except InputError as error:
        return Way(method.name, _axes(body), {}, failure=error.remedy)


def _solve(study: Study, method: Method, body: Domain, levels: Sequence[Level]) -> Way:
    gathered = by_key(mesh_refinement.gather_quantities(study, levels, method.scatter))
    return Way(
        method.name,
        _axes(body),
        {key: gathered[key] for key in KEYS},
        levels[-1].solution.facts["unknowns"],
        sum(level.seconds for level in levels),
    )


def _axes(body: Domain) -> str:
    return "".join(plane.axis for plane in body.planes)
