"""From a design through solid, meshes and solves to FEM and formulas side by side.

Meshes and solutions are cached by content, so that an interrupted run resumes where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from time import perf_counter

from flexdesign.analytic import part_models, rigid_bodies, static_model
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Cache, content_key
from flexdesign.design import part as parts
from flexdesign.design.design import Design
from flexdesign.design.study import Study
from flexdesign.fem import convergence, large_stroke, mesh_refinement, quantities
from flexdesign.fem.analysis import Solution
from flexdesign.fem.large_stroke import LargeStroke
from flexdesign.fem.mesh_refinement import Level
from flexdesign.fem.meshing import domain
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.solving.load_path import StrokePath
from flexdesign.workflows.validation import cross_check, independent_mesh, model_hierarchy, stage_model_from_part
from flexdesign.workflows.validation.result import Comparison, Validation

Progress = Callable[[str], None]
#: Quantities of each analytic model, by the model's name and by their keys.
Formulas = Mapping[str, Mapping[str, Quantity]]


def validate(study: Study, cache: Cache, progress: Progress = lambda _: None) -> Validation:
    """Run a validation.

    Parameters
    ----------
    study
        What to validate.
    cache
        Where meshes and solutions are looked up and kept.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If the solid, a port or a mesh cannot be used.
    """
    began = perf_counter()
    design = study.design
    part = design.part()
    progress("building the solid")
    try:
        body = domain.of_part(part, material=design.material, chord=domain.chord(part))
    except InputError as error:
        file = parts.file_of(type(part)) if error.file == "part" else error.file
        raise InputError(file, error.field, error.value, error.remedy) from error
    formulas = _formulas(design, part, study.output.load)
    shares_of_formulas = _formula_shares(design, part)
    _examine_intermediates(design, part)
    method = mesh_refinement.method_of(study, part, body)
    levels = mesh_refinement.refine(study, part, body, method, cache, progress)
    gathered = mesh_refinement.gather_quantities(study, levels, method.scatter)
    vibrating = next(level.solution for level in reversed(levels) if level.solution.modes)
    comparisons, further = _compare(planar(formulas, vibrating), gathered)
    large = _large(study, part, body, levels[0], cache, progress)
    if large is not None:
        further += [large.stroke(by_key([*further, *(c.fem for c in comparisons)])["stroke_output_free"])]
        further += large.quantities()
    others = cross_check.run(study, part, body, method, levels, cache, progress) if study.mesh.cross_check else None
    reported = by_key(gathered)
    apart = method.name != "wild" and study.mesh.independent and body.thin is None
    alone = independent_mesh.run(study, part, body, reported, cache, progress) if apart else None
    return Validation(
        study=study,
        domain=body,
        method=method,
        levels=levels,
        comparisons=comparisons,
        further=further,
        shares=_shares(design, body, levels) if part.linkage().members else {},
        formula_shares=shares_of_formulas,
        large=large,
        hierarchy=model_hierarchy.model_hierarchy(design, {c.fem.key: c.fem for c in comparisons}),
        cross_check=others,
        independent=alone,
        stage_model=stage_model_from_part.stage_model(
            design,
            by_key(further) | {c.fem.key: c.fem for c in comparisons},
            vibrating,
            large.effects() if large else {},
        ),
        seconds=perf_counter() - began,
    )


# --- from meshes to quantities ----------------------------------------------------------------------------------


def _large(
    study: Study, part: parts.Part, body: Domain, level: Level, cache: Cache, progress: Progress
) -> LargeStroke | None:
    """Follow large displacements to full drive; None without an actuator, for a crystal, or if nobody wants it."""
    material, actuator, steps = study.design.material, study.design.actuator, study.output.large_steps
    if actuator is None or material.crystal is not None or steps == 0 or any(port.rigid for port in part.ports()):
        return None
    stiffness, free = actuator.installed_stiffness, actuator.free_stroke
    ports = [vars(port) for port in part.ports()]
    mesh_key = content_key(*level.mesh.arrays().values())
    key = content_key(mesh_refinement.engine(), mesh_key, material.mechanics, stiffness, free, steps, ports)
    if (stored := cache.load("large", key)) is not None:
        return LargeStroke(StrokePath(**stored[0]), stiffness, free)

    def say(text: str) -> None:
        progress(f"large displacements: {text}")

    linear = level.solution.compliance
    found = large_stroke.follow(part, material, body, level.mesh, linear, stiffness, free, steps, say)
    cache.store("large", key, dict(vars(found.path)), {})
    return found


def _shares(design: Design, body: Domain, levels: Sequence[Level]) -> dict[str, dict[str, float]]:
    """Extrapolate every piece of the compliances; as that is linear, the pieces still add up."""
    sizes = [level.size for level in levels]
    found = [quantities.compliance_shares(design.material, body, level.solution) for level in levels]
    return {
        key: {p: convergence.extrapolate([f[key][p] for f in found], sizes).value for p in found[-1][key]}
        for key in found[-1]
    }


def _formulas(design: Design, part: parts.Part, load: float | None) -> dict[str, dict[str, Quantity]]:
    """Return what the part's formulas say, by model and key: asked for before anything is solved.

    Raises
    ------
    InputError
        If they are no quantities, or none of what FEM finds.
    """
    stiffness = design.actuator.installed_stiffness if design.actuator else None
    given: object = part_models.formulas(part, design.material, stiffness, load)

    def refused(remedy: str) -> InputError:
        return _error(part, "formulas", remedy)

    try:
        is_valid = isinstance(given, Mapping) and all(_are_quantities(found) for found in given.values())
    except InputError:
        raise
    except Exception as error:  # models that are computed when they are asked for, by code of the part
        remedy = f"fails with {parts.reason(error, parts.file_of(type(part)))}; correct the part"
        raise refused(remedy) from error
    if not isinstance(given, Mapping) or not is_valid:
        raise refused("must return quantities by the model's name: {'PRB': [Quantity(...)]}")
    formulas = {str(model): by_key(found) for model, found in given.items()}
    known = {Quantity(name, 1.0, "", "", boundary).key for name, boundary in static_model.measurable(design)}
    if parts.states(part, "formulas") and not any(known & found.keys() for found in formulas.values()):
        raise refused(f"returns nothing to compare; give at least one of {', '.join(sorted(known))}")
    return formulas


def _formula_shares(design: Design, part: parts.Part) -> Mapping[str, Mapping[str, float]]:
    """Return what the compliances of the first model consist of; raise InputError if that is no table of numbers."""
    if not parts.states(part, "formula_shares"):
        return {}
    given: object = part.formula_shares(design.material)
    splits: list[object] = list(given.values()) if isinstance(given, Mapping) else [None]
    pieces = [piece for split in splits if isinstance(split, Mapping) for piece in split.values()]
    are_tables = all(isinstance(split, Mapping) for split in splits)
    if isinstance(given, Mapping) and are_tables and all(isinstance(piece, (int, float)) for piece in pieces):
        return given
    example = "{'K_in_output_free': {'hinge bending': 5e-7}}"
    raise _error(part, "formula_shares", f"must return compliances [m/N] by quantity and piece: {example}, or {{}}")


def _examine_intermediates(design: Design, part: parts.Part) -> None:
    """Raise InputError if the report could not show what a part returns on the way to its formulas."""
    if not parts.states(part, "intermediates"):
        return
    given: object = part.intermediates(design.material, 1.0)
    if not isinstance(given, Mapping) or not _are_quantities(list(given.values())):
        raise _error(part, "intermediates", "must return quantities by name: {'M': Quantity(...)}, or {}")


def _error(part: parts.Part, method: str, remedy: str) -> InputError:
    return InputError(parts.file_of(type(part)), f"{type(part).__name__}.{method}()", None, remedy)


def _are_quantities(found: object) -> bool:
    return isinstance(found, Sequence) and all(isinstance(each, Quantity) for each in found)


def planar(formulas: Formulas, solution: Solution) -> Formulas:
    """Return the formulas without first frequencies of the rigid-body model where FEM's first mode leaves its plane."""
    free = "input free" if solution.compliance.has_input else "output free"
    lowest = {mode.installed: mode for mode in reversed(solution.modes)}
    found = {model: dict(each) for model, each in formulas.items()}
    for installed, boundary in ((False, free), (True, "actuator installed")):
        if installed in lowest and "odd in z" in lowest[installed].symmetry:
            key = Quantity("first_frequency", 1.0, "Hz", "Hz", boundary).key
            for each in found.values():
                if key in each and each[key].source == rigid_bodies.SOURCE:
                    del each[key]
    return found


def _compare(formulas: Formulas, gathered: Sequence[Quantity]) -> tuple[list[Comparison], list[Quantity]]:
    comparisons, further = [], []
    for quantity in gathered:
        analytic = {model: found[quantity.key] for model, found in formulas.items() if quantity.key in found}
        if analytic:
            comparisons.append(Comparison(quantity, analytic))
        else:
            further.append(quantity)
    return comparisons, further
