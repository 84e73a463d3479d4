"""Diagnosis of a static table: which physics the compliance model of a design lacks, or that nothing is missing.

Every static effect that the model lacks is fitted alone, and in pairs if no single one suffices. The weights hold the
uncertainty of the measurements, the tolerances of the part and the accuracy of the model (`Uncertainty`), so that no
effect is named for a deviation within them. Effects that fit as well as the best are stated with the measurement that
would distinguish them.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexdesign.analytic.static_model import StaticModel, StaticTable
from flexdesign.analytic.static_model.separability import Proposal, proposals
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.diagnosis.comparison.static_table import compare
from flexdesign.diagnosis.result import ErrorStep, Verdict
from flexdesign.diagnosis.static_tables.fit import Cases, Trial, cases, fit_with
from flexdesign.effects import statics
from flexdesign.estimation.criterion import INDISTINGUISHABLE

#: Effects that are not tried in pairs, and are named only if no other explains the table: turned arms imitate any
#: offset that was not drawn, and most tables are measured at rest; the same member seldom deviates alike in parts that
#: were made one by one. Of a single part, one member is as likely as any other effect.
SELDOM = ("geometric_stiffening", "one_member")


@dataclass(frozen=True, eq=False)
class TableDiagnosis:
    """The diagnosis of a static table.

    Parameters
    ----------
    verdict
        Whether an effect is missing, and whether it is known.
    before, found
        The original model and the best one found, even if that does not explain the table.
    alike
        Other models that the table does not distinguish from `found`.
    tried
        Everything that was fitted, best first.
    proposals
        Measurements that would distinguish `found` from `alike`, the best first.
    error_ladder
        Relative errors, rms: of the design, with the effects, and of rows predicted by fits without them.
    remarks
        Changes of the table, and reasons that weaken the verdict.
    asked
        Whether the user chose the effect, as in ``flexdesign add``.
    """

    verdict: Verdict
    before: Trial
    found: Trial
    alike: tuple[Trial, ...]
    tried: tuple[Trial, ...]
    proposals: tuple[Proposal, ...]
    error_ladder: tuple[ErrorStep, ...]
    remarks: tuple[str, ...]
    asked: bool = False

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Effects that the table does not distinguish, beginning with the one found."""
        groups = []
        for name in self.found.names:
            comparison = {*self.found.names} - {name}
            others = [
                o for trial in self.alike if comparison <= {*trial.names} for o in trial.names if o not in comparison
            ]
            if {*others} - {name}:
                groups.append(tuple(dict.fromkeys((name, *others))))
        return tuple(groups)


def diagnose(
    model: StaticModel,
    table: StaticTable,
    progress: Callable[[str], None] = lambda _: None,
    more: Sequence[str] = (),
) -> TableDiagnosis:
    """Find which static effects a model lacks; `more` are tried with those of the catalogue.

    Raises
    ------
    InputError
        If the model has no number for a row, or a row seems to have another unit.
    """
    before, remarks = _before(model, table)
    elsewhere = statics.OF_PARTS if model.design.is_stage else statics.OF_STAGES
    names = [name for name in (*statics.names(), *more) if name not in (*model.effects, *elsewhere)]
    candidates = [case for name in names for case in cases(model, name, before.table)]
    progress("trying every effect")
    tried = singles = _sort(fit_with(before, case) for case in candidates)
    nearest, explanations = before, list[Trial]()
    if not before.is_adequate:
        nearest = next((trial for trial in singles if trial.is_significant_against(before, len(singles))), before)
        last = SELDOM if len({row.part for row in table.rows}) > 1 else SELDOM[:1]
        every = _accepted_trials(before, singles, len(singles))
        first = _accepted_trials(before, [trial for trial in singles if trial.names[0] not in last], len(singles))
        explanations = first or every
        seldom = {statics.find(t.names[0]).name.replace("_", " ") for t in every if t not in explanations}
        remarks += tuple(f"{name} explains the table as well, but is seldom the cause" for name in sorted(seldom))
        if not explanations:
            usual = [case for case in candidates if not {*case} & {*SELDOM}]
            pairs = _sort(fit_with(before, pair) for pair in _pairs(usual, progress))
            # Two causes, of which one contradicts the design, are believed of nothing.
            sound = [trial for trial in pairs if not trial.excess_modulus(before)]
            explanations, tried = _accepted_trials(nearest, sound, len(pairs)), [*singles, *pairs]
    best, *alike = explanations or [nearest]
    verdict: Verdict = "effects-found" if explanations else "nothing-missing" if before.is_adequate else "unknown"
    progress("leaving out each row in turn")
    error_ladder, remarks = _error_ladder(before, best), (*remarks, *_contradictions(before, explanations))
    apart = proposals([trial.model for trial in explanations], before.table) if alike else ()
    return TableDiagnosis(verdict, before, best, tuple(alike), tuple(tried), apart, error_ladder, remarks)


def add(
    model: StaticModel, effect: str, table: StaticTable, progress: Callable[[str], None] = lambda _: None
) -> TableDiagnosis:
    """Fit one effect, whether it is called for or not: the verdict is that of this effect alone.

    Raises
    ------
    InputError
        If it cannot be fitted to the table.
    """
    before, remarks = _before(model, table)
    progress(f"fitting {effect}")
    trials = _sort(fit_with(before, case) for case in cases(model, effect, before.table))
    if not trials:
        remedy = (
            "cannot be fitted: the table does not show it, or it has as many numbers as there are rows; measure more"
        )
        raise InputError("command line", "EFFECT", effect, remedy)
    trial = trials[0]
    if not trial.is_significant_against(before, 1):
        remarks += ("the effect lowers the error by no more than chance does: it is not needed",)
    remarks += _contradictions(before, [trial])
    error_ladder = _error_ladder(before, trial)
    return TableDiagnosis("effects-found", before, trial, (), (trial,), (), error_ladder, remarks, asked=True)


def _pairs(candidates: Sequence[Cases], progress: Callable[[str], None]) -> Iterable[Cases]:
    """Return all pairs of different effects."""
    for one, other in itertools.combinations(candidates, 2):
        if not {*one} & {*other}:
            progress(f"trying {' and '.join((*one, *other))}")
            yield {**one, **other}


def _sort(trials: Iterable[Trial | None]) -> list[Trial]:
    made = [trial for trial in trials if trial is not None and math.isfinite(trial.cost)]
    return sorted(made, key=lambda trial: trial.bic)


def _accepted_trials(before: Trial, trials: Sequence[Trial], count: int) -> list[Trial]:
    """Return the trials that count, agree with the table and are indistinguishable by BIC, best first.

    Trials that the design excludes come last. The probability of an effect that was tried with several constants is
    shared among them.
    """
    good = [trial for trial in trials if trial.is_significant_against(before, count) and trial.is_adequate]
    times = Counter(trial.names for trial in trials)

    def order(trial: Trial) -> tuple[bool, float]:
        return trial.excess_modulus(before) != 0, trial.bic + 2 * math.log(times[trial.names])

    return sorted((trial for trial in good if trial.bic <= good[0].bic + INDISTINGUISHABLE), key=order)


def _before(model: StaticModel, table: StaticTable) -> tuple[Trial, tuple[str, ...]]:
    """Return the model without anything fitted, and what a comparison remarks."""
    comparison = compare(model, table)
    return Trial({}, model, comparison.table, comparison.uncertainty), comparison.remarks


def _contradictions(before: Trial, explanations: Sequence[Trial]) -> tuple[str, ...]:
    """Return a remark if an explanation is a modulus outside the range that the design states."""
    stated, excess = before.model.design.tolerances.modulus, [trial.excess_modulus(before) for trial in explanations]
    remarks = f"which states it within {100 * stated:.3g} %: look for another cause"
    return tuple(f"a modulus off by {100 * e:+.1f} % contradicts the design, {remarks}" for e in excess if e)[:1]


def _error_ladder(before: Trial, best: Trial) -> tuple[ErrorStep, ...]:
    """Return relative errors, rms: as designed, with the effects, and of rows predicted by fits without them."""
    table, measured = before.table, before.table.measured()

    def step_of_ladder(label: str, difference: Array) -> ErrorStep:
        return ErrorStep(label, float(np.sqrt(np.mean((difference / measured) ** 2))))

    rungs = [step_of_ladder("as designed", before.difference)]
    if best.names:
        label = f"+ {' + '.join(statics.find(name).name for name in best.names)}"
        rungs.append(step_of_ladder(label, best.difference))
        unseen = np.zeros(len(measured))
        for i in range(len(measured)):
            seen = replace(before, table=table.without(i), noise=before.noise.without(i))
            if (again := fit_with(seen, best.cases, near=best)) is None:
                return tuple(rungs)  # with one row less there are none to fit
            unseen[i] = again.model.predict(table)[i] - measured[i]
        rungs.append(step_of_ladder(f"{label}, rows left out of the fit", unseen))
    return tuple(rungs)
