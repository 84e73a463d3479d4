"""Diagnosis of a static table: which physics the compliance model of a design lacks, or that nothing is missing.

Every static effect that the model has not is fitted alone, and in pairs where one does not do. What is known of the
measurements, of the tolerances of the part and of the model's own accuracy stands in the weights (`Uncertainty`), so
that nothing is named for what a part may be off by anyhow. What fits as well as the best is said beside it, with the
measurement that would tell.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexdesign.diagnosis.findings import Rung, Verdict
from flexdesign.diagnosis.table_fit import Trial, as_it_is, fitted
from flexdesign.effects import statics
from flexdesign.errors import InputError
from flexdesign.static_tables import Row, StaticModel, StaticTable, Uncertainty, measurable, uncertainty

Array = NDArray[np.float64]
#: Answers whose sums of squares differ by less are one.
ALIKE = 6.0
#: Not more effects than these make a group.
LARGEST_GROUP = 3
#: Effects that are tried alone, and only if no other does: beside another one, turned arms pass for any offset that was
#: not drawn, and tables are mostly taken at rest.
LAST = ("geometric_stiffening",)
#: By how much a dimension is changed to tell answers apart; a difference of this many percent tells.
CHANGED, TELLS = (0.7, 1.4), 0.02
#: A value so near a power of 1000 from what is expected has the wrong unit.
WRONG_UNIT = 0.35


class Telling(NamedTuple):
    """A measurement that would tell answers apart, and what each expects of it, in the row's unit."""

    row: Row
    expected: tuple[float, ...]

    @property
    def apart(self) -> float:
        """How far the answers are apart, relative."""
        return (max(self.expected) - min(self.expected)) / abs(float(np.mean(self.expected)))


@dataclass(frozen=True, eq=False)
class TableDiagnosis:
    """What a static table says about the model of a design.

    Parameters
    ----------
    verdict
        Whether something is missing, and whether it is known.
    table, uncertainty
        What was measured, and how far the model may be from it although nothing is missing.
    before, found
        The model as it was, and with what was found (the best answer, even where it does not suffice).
    alike
        Other answers that the table cannot tell from `found`.
    tried
        Everything that was fitted, best first.
    tellings
        Measurements that would tell `found` from `alike`, the best first.
    ladder
        Relative errors, rms: of the design, with what was found, and so of each row left out of the fit in turn.
    remarks
        What was done to the table, or weakens the verdict.
    asked
        Whether `found` was asked for, and not found.
    """

    verdict: Verdict
    table: StaticTable
    uncertainty: Uncertainty
    before: Trial
    found: Trial
    alike: tuple[Trial, ...]
    tried: tuple[Trial, ...]
    tellings: tuple[Telling, ...]
    ladder: tuple[Rung, ...]
    remarks: tuple[str, ...]
    asked: bool = False

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Effects that the table cannot tell apart, the one that was found first."""
        groups = []
        for name in self.found.names:
            beside = {*self.found.names} - {name}
            others = [o for trial in self.alike if beside <= {*trial.names} for o in trial.names if o not in beside]
            if others:
                groups.append((name, *others[: LARGEST_GROUP - 1]))
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
    table, remarks = believable(model, table)
    noise = uncertainty(model, table)
    before = as_it_is(model, table, noise)
    elsewhere = statics.OF_PARTS if model.design.is_stage else statics.OF_STAGES
    names = [name for name in (*statics.names(), *more) if name not in (*model.effects, *elsewhere)]
    together = [name for name in names if name not in LAST]
    progress("trying every effect")
    singles = _sorted(fitted(model, [name], table, noise) for name in together)
    best, counted = _chosen(before, singles, len(names))
    if not best.is_adequate:
        singles = _sorted([*singles, *(fitted(model, [name], table, noise) for name in names if name in LAST)])
        best, counted = _chosen(before, singles, len(names))
    pairs: list[Trial] = []
    if not best.is_adequate:
        for pair in itertools.combinations(together, 2):
            progress(f"trying {' and '.join(pair)}")
            if (trial := fitted(model, pair, table, noise)) is not None:
                pairs.append(trial)
        pairs = _sorted(pairs)
        best, counted = _chosen(best if best.names else before, pairs, len(pairs), or_else=(best, counted))
    verdict: Verdict = "unknown"
    if best.is_adequate:
        verdict = "effects-found" if best.names else "nothing-missing"
    alike = tuple(o for o in counted if o is not best and o.cost < best.cost + ALIKE) if best.names else ()
    if verdict == "unknown":
        alike = ()
    progress("leaving out each row in turn")
    remarks += ("some rows state no sigma: 2 % was taken for it",) if noise.unsaid else ()
    tellings = _tellings(best, alike[: LARGEST_GROUP - 1], table) if alike else ()
    ladder = _ladder(model, best, table, noise)
    return TableDiagnosis(
        verdict, table, noise, before, best, alike, (*singles, *pairs), tellings, ladder, tuple(remarks)
    )


def add(
    model: StaticModel, effect: str, table: StaticTable, progress: Callable[[str], None] = lambda _: None
) -> TableDiagnosis:
    """Fit one effect, whether it is called for or not: the verdict is that of this effect alone.

    Raises
    ------
    InputError
        If it cannot be fitted to the table.
    """
    table, remarks = believable(model, table)
    noise = uncertainty(model, table)
    before = as_it_is(model, table, noise)
    progress(f"fitting {effect}")
    trial = fitted(model, [effect], table, noise)
    if trial is None:
        raise InputError("command line", "EFFECT", effect, "has as many numbers as the table has rows; measure more")
    if not trial.counts_beside(before, 1):
        remarks += ("the effect lowers the error by no more than chance does: it is not needed",)
    ladder = _ladder(model, trial, table, noise)
    return TableDiagnosis("effects-found", table, noise, before, trial, (), (trial,), (), ladder, remarks, asked=True)


def known_effect(name: str, field: str) -> str:
    """Return the name under which a static effect is found from everywhere, a path as an absolute one.

    Parameters
    ----------
    name
        Of the catalogue, or a path.
    field
        Where it was given, for the message.

    Raises
    ------
    InputError
        If there is none, or it has nothing that a fit could move.
    """
    try:
        whole = statics.beside(name, Path())
        effect = statics.find(whole)
    except ValueError as error:
        raise InputError("command line", field, name, str(error)) from None
    if not any(p.null is not None for p in effect.parameters):
        raise InputError("command line", field, name, "none of its parameters states a null, at which it is not there")
    return whole


def own_effects(names: Sequence[str]) -> list[str]:
    """Return static effects beside those of the catalogue, as `diagnose` takes them; raise as `known_effect` does."""
    whole = [known_effect(name, "--effect") for name in names]
    return [name for name in dict.fromkeys(whole) if name not in statics.names()]


def believable(model: StaticModel, table: StaticTable) -> tuple[StaticTable, tuple[str, ...]]:
    """Return a table whose values can be meant: amplifications with the model's sign.

    Raises
    ------
    InputError
        If a value is off by about a power of 1000: a unit is wrong.
    """
    rows, unsigned = [], False
    for row, expected in zip(table.rows, model.predict(table), strict=True):
        if math.isfinite(expected):
            power = math.log10(abs(row.value / expected)) / 3
            if round(power) != 0 and abs(power - round(power)) < WRONG_UNIT / 3:
                remedy = f"is {1000.0 ** round(power):g} times what the model expects: correct the unit ({row.unit})"
                raise InputError(table.name, row.key, f"{row.value:.4g} (SI)", remedy)
        opposite = row.quantity == "lambda" and row.value * expected < 0
        unsigned |= opposite
        rows.append(replace(row, value=-row.value) if opposite else row)
    said = "amplifications were taken with the sign of the model, along the output's normal"
    return replace(table, rows=tuple(rows)), (said,) if unsigned else ()


def _sorted(trials: Iterable[Trial | None]) -> list[Trial]:
    made = [trial for trial in trials if trial is not None and math.isfinite(trial.cost)]
    return sorted(made, key=lambda trial: trial.cost)


def _chosen(
    before: Trial, trials: Sequence[Trial], count: int, or_else: tuple[Trial, Sequence[Trial]] | None = None
) -> tuple[Trial, Sequence[Trial]]:
    """Return the best trial that counts, an adequate one if there is one, and all that do as it does."""
    counted = [trial for trial in trials if trial.counts_beside(before, count)]
    adequate = [trial for trial in counted if trial.is_adequate]
    if adequate or (counted and or_else is None):
        good = adequate or counted
        return good[0], good
    return or_else or (before, ())


def _ladder(model: StaticModel, best: Trial, table: StaticTable, noise: Uncertainty) -> tuple[Rung, ...]:
    """Return relative errors, rms: as designed, with what was found, and of rows that the fit then did not see."""
    measured = table.measured()
    rungs = [Rung("as designed", _relative(model.predict(table), measured))]
    if best.names:
        label = f"+ {' + '.join(statics.find(name).name for name in best.names)}"
        rungs.append(Rung(label, _relative(best.model.predict(table), measured)))
        unseen = measured.copy()
        for i in range(len(measured)):
            if (again := fitted(model, best.names, table.without(i), noise.without(i), near=best)) is None:
                return tuple(rungs)  # with one row less there are none to fit
            unseen[i] = again.model.predict(table)[i]
        rungs.append(Rung(f"{label}, rows that the fit did not see", _relative(unseen, measured)))
    return tuple(rungs)


def _relative(predicted: Array, measured: Array) -> float:
    return float(np.sqrt(np.mean((predicted / measured - 1) ** 2)))


def _tellings(best: Trial, others: Sequence[Trial], table: StaticTable) -> tuple[Telling, ...]:
    """Return measurements on which the answers differ: of the part itself, and of parts with one dimension changed."""
    design = best.model.design
    done = {(row.key, row.part) for row in table.rows}
    variants: list[dict[str, float]] = [{}]
    lengths = {p.name for p in design.part_class.dimensions if p.si == "m"}
    for name, drawn in design.dimensions.items():
        variants += [{name: float(f"{by * drawn:.3g}")} for by in CHANGED if drawn > 0 and name in lengths]
    found = []
    for dimensions in variants:
        asked = [Row(quantity, boundary, 1.0, None, "", dimensions) for quantity, boundary in measurable(design)]
        rows = tuple(row for row in asked if (row.key, row.part) not in done)
        try:
            expected = np.array([answer.model.predict(StaticTable("", rows)) for answer in (best, *others)])
        except InputError:  # cannot be built
            continue
        found += [
            Telling(row, tuple(float(each) for each in column))
            for row, column in zip(rows, expected.T, strict=True)
            if np.isfinite(column).all()
        ]
    found.sort(key=lambda telling: (-round(telling.apart, 2), len(telling.row.dimensions)))
    return tuple(telling for telling in found[:3] if telling.apart > TELLS)
