"""How fast and how right the evaluators of a sweep are, compared with meshing and solving every design anew::

    python -m studies.benchmarks.sweep_evaluators           # about half an hour; 12 designs anew, scaled to 200
    python -m studies.benchmarks.sweep_evaluators 4 20      # 4 designs anew, 20 by the evaluators
    python -m studies.benchmarks.sweep_evaluators 200 200   # nothing scaled: hours

Designs are a Latin hypercube of hinge thickness, arm span, arm offset and width about the X/Y amplifier of Lin et al.
(2019), within 30 %. Anew means what `validate` does for 1 %: solid, domain, meshes and solutions of all symmetry
classes with two modes each until the estimate is that small, in one process, nothing cached. As the evaluators give
neither modes nor lateral motions, they are also compared with anew and lean: the same meshes, the symmetric class
alone. Errors are against limits of three meshes of their own to about 300 000 unknowns, finer than either side uses.

The smoothness is that of K_in over 21 values of a dimension, even in its logarithm: the root mean square of the third
differences of ln K_in, of which a power law has none; the same mesh of each design, once morphed and once made anew.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from flexdesign.core.model import Quantity
from flexdesign.core.result_cache import Cache
from flexdesign.design import design, study
from flexdesign.design.design import Design
from flexdesign.fem import mesh_refinement
from flexdesign.fem.meshing import domain, resolution_gate
from flexdesign.fem.multifidelity import Correction, FastSolid, Planar, extrusion, solid
from flexdesign.fem.quantities import of_compliance
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.plane_stress import Plate

Array = NDArray[np.float64]

NAME, ACCURACY, WITHIN = "lin2019_amplifier_xy", 0.01, 0.3
VARIED = ("hinge_thickness", "arm_span", "arm_offset", "width")
#: Coarseness of the meshes behind the converged values, coarse to fine; two that no evaluator uses, and the finest.
TRUTH = (1.5, 1.15, 0.85)
#: Those of `validate`.
STEPS = tuple(1.35**power for power in (2, 1, 0, -1, -2))
#: Designs that the planar model's correction is fitted on.
SAMPLES = 12
KEYS = ("K_in_output_free", "lambda_output_free", "K_out_input_free", "K_out_input_held", "K_out_actuator_installed",
        "stroke_output_free", "blocked_force_output_held")  # fmt: skip


def sample(count: int, seed: int) -> list[Design]:
    """Return designs of a Latin hypercube."""
    middle = design.read(design.find(NAME))
    rows = qmc.LatinHypercube(len(VARIED), rng=np.random.default_rng(seed)).random(count)
    scales = 1 + WITHIN * (2 * rows - 1)
    return [scale_dimensions(middle, dict(zip(VARIED, row, strict=True))) for row in scales]


def scale_dimensions(given: Design, scales: dict[str, float]) -> Design:
    """Return a design with dimensions multiplied."""
    scaled = {name: given.dimensions[name] * scale for name, scale in scales.items()}
    return replace(given, dimensions={**given.dimensions, **scaled})


def as_validate(given: Design) -> None:
    """Mesh and solve anew as `validate` does."""
    asked = study.read(NAME, [f"mesh.accuracy={ACCURACY}"])
    asked, part = replace(asked, design=given), given.part()
    with tempfile.TemporaryDirectory() as empty:
        body = domain.of_part(part, material=given.material, chord=domain.chord(part))
        method = mesh_refinement.method_of(asked, part, body)
        levels = mesh_refinement.refine(asked, part, body, method, Cache(Path(empty)), lambda _: None)
        mesh_refinement.gather_quantities(asked, levels, method.scatter)


def lean(given: Design, coarsenesses: Sequence[float], accuracy: float = 0.0) -> list[Quantity]:
    """Mesh and solve anew, the symmetric class alone, on all meshes or until the estimated error is small."""
    part = given.part()
    body = domain.of_part(part, material=given.material, chord=domain.chord(part))
    method = extrusion.method(part, body, study.MeshSettings())
    found, sizes, limits = [], [], []
    for coarseness in coarsenesses:
        mesh = method.mesh(coarseness)
        resolution_gate.check(mesh, body, part.linkage().of_kind("hinge"))
        compliance, factor = solid.solve(part, body, Elasticity(mesh, given.material))
        factor.free()
        found.append({q.key: q for q in of_compliance(compliance, given.actuator)})
        sizes.append(method.size(mesh, coarseness))
        if len(found) > 1:
            limits = mesh_refinement.extrapolate_quantities(found, sizes, method.scatter)
            if mesh_refinement.estimated_error(limits) <= accuracy:
                break
    return limits


def wall(action: Callable[[], object]) -> float:
    """Return how long something takes [s]."""
    began = time.perf_counter()
    action()
    return time.perf_counter() - began


def evaluators(anew: int, count: int) -> None:
    """Print times and errors of solid FEM, then of the planar model."""
    designs, fast = sample(count, 1), FastSolid(ACCURACY)
    began = time.perf_counter()
    found = [fast.evaluate(given) for given in designs]
    quick = time.perf_counter() - began
    anchors = sum(len(family.anchors) for family in fast.families)
    morphed = wall(lambda: fast.evaluate(designs[1]))
    chosen = np.linspace(0, count - 1, min(anew, count)).astype(int)
    whole, alone, truths, errors, estimates = [], [], [], [], []
    for index in chosen:
        whole.append(wall(lambda given=designs[index]: as_validate(given)))
        alone.append(wall(lambda given=designs[index]: lean(given, STEPS, ACCURACY)))
        truths.append(truth := {q.key: q.value for q in lean(designs[index], TRUTH)})
        answers = {q.key: q for q in found[index]}
        errors.append([answers[key].value / truth[key] - 1 for key in KEYS])
        estimates.append([answers[key].half_width / abs(answers[key].value) for key in KEYS])  # type: ignore[operator]
        print(
            f"  anew {whole[-1]:.1f} s, lean {alone[-1]:.1f} s; error of K_in {100 * errors[-1][0]:+.2f} %", flush=True
        )
    for what, walls in (("as validate does", whole), ("lean", alone)):
        scaled = float(np.mean(walls)) * count
        print(f"{count} designs anew, {what}: {scaled:.0f} s (measured on {len(walls)}, {np.mean(walls):.1f} s each)")
        print(f"  fast: {quick:.0f} s, {anchors} anchors among them: {scaled / quick:.1f} times faster")
    print(f"  a morphed design: {1e3 * morphed:.0f} ms")
    print_errors("fast solid", np.array(errors), np.array(estimates))
    flat(designs, [designs[index] for index in chosen], truths, np.array(whole), np.array(alone))


def flat(
    designs: Sequence[Design], chosen: Sequence[Design], truths: Sequence[dict[str, float]], whole: Array, alone: Array
) -> None:
    """Print times and errors of the planar model, corrected on a sample of its own."""
    planar, solid_model = Planar(), FastSolid(ACCURACY)
    correction = Correction.fit(sample(SAMPLES, 2), planar, solid_model)
    began = time.perf_counter()
    for given in designs:
        correction.apply(given, planar.evaluate(given))
    each = (time.perf_counter() - began) / len(designs)
    errors, estimates = [], []
    for given, truth in zip(chosen, truths, strict=True):
        answers = {q.key: q for q in correction.apply(given, planar.evaluate(given))}
        errors.append([answers[key].value / truth[key] - 1 for key in KEYS])
        estimates.append([answers[key].half_width / abs(answers[key].value) for key in KEYS])  # type: ignore[operator]
    print(
        f"planar: {1e3 * each:.0f} ms a design; solid anew takes {np.mean(whole) / each:.0f} times as long as validate "
        f"does it, {np.mean(alone) / each:.0f} times lean; correction of order {correction.order} from {SAMPLES} solids"
    )
    print_errors("planar, corrected", np.array(errors), np.array(estimates))


def print_errors(what: str, errors: Array, estimates: Array) -> None:
    """Print errors quantity by quantity."""
    print(f"{what}: largest error, root mean square, mean estimate, errors within their estimate")
    for i, key in enumerate(KEYS):
        off = np.abs(errors[:, i])
        print(
            f"  {key:28}{100 * off.max():6.2f} %{100 * np.sqrt(np.mean(off**2)):6.2f} %"
            f"{100 * estimates[:, i].mean():6.2f} %{(off <= estimates[:, i]).sum():4} of {len(off)}"
        )


def smoothness(name: str = "hinge_thickness", places: int = 21) -> None:
    """Print the noise of K_in over a dimension on morphed meshes and on meshes made anew."""
    middle = design.read(design.find(NAME))
    designs = [scale_dimensions(middle, {name: scale}) for scale in np.geomspace(1 - WITHIN, 1 + WITHIN, places)]
    fast, planar = FastSolid(ACCURACY, anchors=[middle]), Planar()
    planar.evaluate(middle)
    curves: dict[str, list[float]] = {}
    for given in designs:
        part, body = extrusion.of_design(given)
        method = extrusion.method(part, body, study.MeshSettings())
        coarse = fast.families[0].meshes[0]
        curves.setdefault("solid, morphed", []).append(1 / coarse.numbers(given, part, body, method)[0])
        compliance, factor = solid.solve(part, body, Elasticity(method.mesh(coarse.coarseness), given.material))
        factor.free()
        curves.setdefault("solid, meshed anew", []).append(compliance.input_stiffness)
        curves.setdefault("fast solid, corrected", []).append(fast.evaluate(given)[0].value)
        curves.setdefault("planar, morphed", []).append(planar.evaluate(given)[0].value)
        plate = Plate(body, method.plan(planar.coarseness), given.material)
        curves.setdefault("planar, meshed anew", []).append(plate.compliance(part.ports()).input_stiffness)
    print(f"K_in over {places} values of {name}: rms of third differences of its logarithm, mesh noise", flush=True)
    for what, values in curves.items():
        print(f"  {what:24}{np.sqrt(np.mean(np.diff(np.log(values), 3) ** 2)):9.1e}", flush=True)


def main(anew: int = 12, count: int = 200) -> None:
    """Print everything."""
    smoothness()
    evaluators(anew, count)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
