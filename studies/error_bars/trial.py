"""Solving the designs, by the program and by the reference; each result is a file, so that it goes on where it stopped.

A file is taken for a result if it answers the same question: the same design, accuracy and method, or the same meshes
of the reference. It keeps what each mesh gave: a change of the estimate alone asks for no new solutions but where the
program would now stop elsewhere. Each names the version of the
program's elements that made it.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Cache, content_key
from flexdesign.design.study import Study
from flexdesign.fem import mesh_refinement, quantities
from flexdesign.fem.convergence import MeshNoise
from flexdesign.fem.meshing import domain, methods
from studies.error_bars import bridge
from studies.error_bars.bridge import Bridge, Fineness, Reference
from studies.error_bars.designs import SampledDesign

Say = Callable[[str], None]
Method = Literal["extruded", "wild"]

ACCURACY = 0.01
#: What is judged: keys that the program and the reference have in common, and the quantity's name.
QUANTITIES = {
    "K_in_output_free": "K_in",
    "lambda_output_free": "lambda",
    "K_out_input_free": "K_out",
    "K_out_input_held": "K_out",
}
#: Of designs with curved necks the nominal hinge stress as well.
STRESS = "hinge_stress_1_N_of_actuator_force"
ALL = {**QUANTITIES, STRESS: "hinge_stress"}
#: Levels of the reference's two meshes, and the powers of their growth that its error may fall with: 4 is that of
#: quadratic displacements' energy and of the roots, which are refined accordingly; 6 has been seen.
LEVELS, ORDERS = (1.0, 1.6), (4.0, 6.0)


@dataclass(frozen=True)
class ReferenceResult:
    """The reference's answers to one design.

    Parameters
    ----------
    values, uncertainties
        By quantity, SI.
    unknowns
        Of the finer mesh.
    seconds
        For both meshes.
    """

    values: Mapping[str, float]
    uncertainties: Mapping[str, float]
    unknowns: int
    seconds: float


@dataclass(frozen=True)
class ProgramResult:
    """The program's answers to one design.

    Parameters
    ----------
    values, estimates
        By quantity, SI; the estimates are those of the discretisation error.
    sizes, raw
        Edge length at the roots on each mesh [m], and each quantity on each mesh.
    unknowns
        Of each mesh.
    seconds
        From geometry to answer.
    elements
        Fingerprint of the program's finite elements.
    error
        Why there is none; empty otherwise.
    """

    values: Mapping[str, float]
    estimates: Mapping[str, float]
    sizes: Sequence[float]
    raw: Mapping[str, Sequence[float]]
    unknowns: Sequence[int]
    seconds: float
    elements: str = ""
    error: str = ""

    @property
    def reached(self) -> float:
        """The largest of the relative estimates."""
        return max((abs(self.estimates[key] / value) for key, value in self.values.items()), default=math.nan)


def solve_reference(sample: SampledDesign, folder: Path, say: Say) -> ReferenceResult:
    """Return the reference's answers, from its file if there is one.

    An error that falls with a power p of the growth leaves (K_1 - K_2) / ((g_1 / g_2)^p - 1); the value is the middle
    of what the lowest and the highest p give, and its uncertainty half of their distance.
    """
    question = content_key(sample.dimensions, sample.material, LEVELS, ORDERS, *_curved_key(sample), *_rods_key(sample))
    path = folder / f"{sample.number:02d}-reference.json"
    if (stored := _read_result(path, question)) is not None:
        return ReferenceResult(**stored)
    say("solving by hexahedra")
    design = sample.study(ACCURACY, "auto").design
    metal, part = design.material, cast(Bridge, design.part())
    answer = extrapolate(
        *(bridge.solve(part, metal.youngs_modulus, metal.poissons_ratio, fineness=Fineness.of(x)) for x in LEVELS),
        keys=compared_keys(sample),
    )
    _write_result(path, question, asdict(answer))
    return answer


def compared_keys(sample: SampledDesign) -> tuple[str, ...]:
    """Return the keys of what is judged of a design."""
    return tuple(ALL if sample.curved else QUANTITIES)


def extrapolate(coarse: Reference, fine: Reference, keys: Sequence[str] = tuple(QUANTITIES)) -> ReferenceResult:
    """Return the reference freed from its leading error."""
    ratio = Fineness.of(LEVELS[0]).growth / Fineness.of(LEVELS[1]).growth
    low, high = (1 / (ratio**order - 1) for order in ORDERS)
    names = {key: "hinge_stress" if key == STRESS else key for key in keys}
    pairs = {key: (getattr(coarse, name), getattr(fine, name)) for key, name in names.items()}
    return ReferenceResult(
        values={key: new + (new - old) * (low + high) / 2 for key, (old, new) in pairs.items()},
        uncertainties={key: abs(new - old) * abs(low - high) / 2 for key, (old, new) in pairs.items()},
        unknowns=fine.n_dof,
        seconds=coarse.seconds + fine.seconds,
    )


def update_estimates(answer: ProgramResult, scatter: MeshNoise, accuracy: float) -> ProgramResult | None:
    """Return an answer with the estimates of today, from what its meshes gave; None if there would be other meshes.

    The program stops refining as soon as its estimate is small enough.
    """
    if answer.error:
        return None
    for count in range(2, len(answer.sizes) + 1):
        meshes = [
            {key: Quantity(ALL[key], values[i], "1", "1") for key, values in answer.raw.items()} for i in range(count)
        ]
        limits = dict(
            zip(
                answer.raw,
                mesh_refinement.extrapolate_quantities(meshes, answer.sizes[:count], scatter),
                strict=True,
            )
        )
        if mesh_refinement.estimated_error(list(limits.values())) <= accuracy or count == mesh_refinement.MOST_LEVELS:
            values = {key: limit.value for key, limit in limits.items()}
            estimates = {key: limit.half_width or 0.0 for key, limit in limits.items()}
            return replace(answer, values=values, estimates=estimates) if count == len(answer.sizes) else None
    return None


def _scatter(sample: SampledDesign, method: Method) -> MeshNoise:
    if method == "wild":
        return methods.Unstructured.scatter
    return methods.SCATTER_OF_NECKS if sample.curved else methods.SCATTER


def solve_design(
    sample: SampledDesign, method: Method, folder: Path, cache: Cache, say: Say, accuracy: float = ACCURACY
) -> ProgramResult:
    """Return what the program says of a design, from its file if there is one; that there is no mesh, too."""
    question = content_key(sample.dimensions, sample.material, accuracy, method, *_curved_key(sample))
    path = folder / f"{sample.number:02d}-{method}.json"
    if (stored := _read_result(path, question)) is not None and (
        answer := update_estimates(ProgramResult(**stored), _scatter(sample, method), accuracy)
    ):
        return answer
    say(f"solving by the program ({method})")
    began = time.perf_counter()
    try:
        answer = _solve(sample.study(accuracy, method), cache, compared_keys(sample))
    except (InputError, ArithmeticError) as error:  # no mesh, or a solution that fails its checks
        answer = ProgramResult({}, {}, (), {}, (), time.perf_counter() - began, mesh_refinement.engine(), str(error))
    _write_result(path, question, asdict(answer))
    return answer


def _solve(study: Study, cache: Cache, keys: Sequence[str]) -> ProgramResult:
    """Solve as a validation does, but for lateral motions and modes, which are judged by nobody here."""
    began = time.perf_counter()
    part = study.design.part()
    body = domain.of_part(part, material=study.design.material, chord=domain.chord(part))
    method = mesh_refinement.method_of(study, part, body)
    levels = mesh_refinement.refine(study, part, body, method, cache, lambda _: None, all_classes=False)
    gathered = by_key(mesh_refinement.gather_quantities(study, levels, method.scatter))
    found = {key: gathered[key] for key in keys}
    by_level = [by_key(quantities.of_solution(study, level.solution)) for level in levels]
    return ProgramResult(
        values={key: quantity.value for key, quantity in found.items()},
        estimates={key: quantity.half_width or 0.0 for key, quantity in found.items()},
        sizes=[level.size for level in levels],
        raw={key: [on_level[key].value for on_level in by_level] for key in keys},
        unknowns=[level.solution.facts["unknowns"] for level in levels],
        seconds=time.perf_counter() - began + sum(level.seconds for level in levels if level.cached),
        elements=mesh_refinement.engine(),
    )


def _curved_key(sample: SampledDesign) -> tuple[str, ...]:
    """Return what a question says of a curved design besides."""
    return (Path(sample.design).stem,) if sample.curved else ()


def _rods_key(sample: SampledDesign) -> tuple[str, ...]:
    """Return what tells references whose meshes are as fine at a rod's inner corners as at its outer ones."""
    return ("inner corners",) if sample.curved and sample.dimensions["rod_length"] > 0 else ()


def forget(folder: Path) -> None:
    """Remove all results."""
    for path in folder.glob("*.json"):
        path.unlink()


def _read_result(path: Path, question: str) -> dict[str, Any] | None:
    """Return what a file says, if it is there and answers the question."""
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        return dict(stored["answer"]) if stored["question"] == question else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _write_result(path: Path, question: str, answer: Mapping[str, Any]) -> None:
    """Write a file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_suffix(f".{os.getpid()}.new")
    stored = {"question": question, "answer": answer}
    new.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    new.replace(path)
