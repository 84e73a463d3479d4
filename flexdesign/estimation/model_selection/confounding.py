"""Effects that the runs do not distinguish: alternatives to what was added, fitted in its place."""

from __future__ import annotations

from collections.abc import Sequence

from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    escape,
    fit_model,
    with_effects,
    with_values,
)
from flexdesign.estimation.model_selection.model_comparison import Step, is_indistinguishable

#: Largest number of effects in a group of confounded effects.
LARGEST_GROUP = 3


def confusable(task: EstimationTask, fit: FittedModel, steps: Sequence[Step]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of confounded effects, the one in the model first.

    Effects that did as well when one was added are fitted in its place with all that were added later. So are those
    that it is known to be taken for, if they explained as much but for `SHARE`: of approximations, a fit may be in a
    local minimum, which is left first.
    """
    groups = list[tuple[str, ...]]()
    for step in steps:
        for name in step.chosen.names if step.chosen else ():
            if name not in fit.names or any(name == group[0] for group in groups):
                continue
            others = {*step.chosen.names} - {name} if step.chosen else set[str]()
            rivals = [trial for trial in step.rivals if others <= {*trial.names} and name not in trial.names]
            instead = [
                other
                for trial in rivals
                for other in trial.names
                if other not in {*others, *fit.names} and _does_as_well(task, fit, name, trial.fit, other)
            ]
            if instead:
                groups.append((name, *instead[: LARGEST_GROUP - 1]))
    return tuple(groups)


def _does_as_well(task: EstimationTask, fit: FittedModel, name: str, seen: FittedModel, other: str) -> bool:
    """Tell whether an effect in the place of another explains as much."""
    instead = next(effect for effect in seen.effects if effect.name == other)
    effects = tuple(instead if effect.name == name else effect for effect in fit.effects)
    task.progress(f"fitting with {other} in the place of {name}")
    model = with_effects(task.bare(fit.model), effects)
    made = fit_model(task, with_values(with_values(model, seen.model), fit.model), effects)
    if made is not None and fit.exceeds_noise and not is_indistinguishable(fit, made):
        made = escape(task, made)
    return made is not None and is_indistinguishable(fit, made)
