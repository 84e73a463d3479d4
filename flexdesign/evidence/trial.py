"""Trials: an effect put into a model beside others, what it explains, and what counts against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from flexdesign.evidence.case import Case
from flexdesign.evidence.screening import Moves
from flexdesign.evidence.stand import Stand, at_null, moved

#: Two answers are one if their costs differ by less than this, in multiples of the noise's variance.
ALIKE = 12.0
#: Why an effect is refused that is there, for all one knows, and does not matter.
SMALL = "moves the prediction by less than the tolerance"
#: Why one is that nothing speaks against, but for a better one.
LESS = "explains less"


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate that was refitted beside others at one step.

    Parameters
    ----------
    names
        Effects added at this step, one or two.
    stand
        The fit.
    gain, held_gain
        Fall of the cost of what the fit saw and of the runs kept apart.
    moved
        By how much it moves the prediction of the latter, rms [response].
    error
        Root mean square of what is left of these [response].
    needed
        The fall that counts as more than chance.
    reason
        Why it is not accepted; empty if it is.
    """

    names: tuple[str, ...]
    stand: Stand
    gain: float
    held_gain: float
    moved: float
    error: float
    needed: float
    reason: str


@dataclass(frozen=True, eq=False)
class Step:
    """One addition: the best trial, and those that do as well.

    Parameters
    ----------
    chosen
        The trial whose effects were added; None at the last step, where none earned its place.
    trials
        All that were refitted, best first.
    alike
        Trials that these runs cannot tell from the chosen one.
    moves
        What effects do, where nothing was chosen and that may be asked again.
    """

    chosen: Trial | None
    trials: tuple[Trial, ...]
    alike: tuple[Trial, ...] = ()
    moves: Moves | None = field(default=None, repr=False)


def weighed(case: Case, before: Stand, after: Stand, names: tuple[str, ...], needed: float) -> Trial:
    """Return a trial of effects that a stand has and the one before has not; a fall of `needed` is more than chance."""
    # Judged by the data alone: an effect is not needed because it lets a number stay where it was thought to be.
    gain, held = before.seen_cost - after.seen_cost, before.held_cost - after.held_cost
    judges = [record.observation.name for record in (case.validate.records or case.identify.records)]
    kept_apart = case.judging or judges
    new = case.validate if case.validate.records else case.identify
    far = moved(new, before.model, after.model, case.weights)
    added = [at_null(after.model, effect) for effect in after.effects if effect.name in names]
    alone = min(moved(new, without, after.model, case.weights) for without in added)
    scale = max(after.scale, 1.0)
    reason = ""
    if gain < needed * scale * len(names):
        reason = "no more than chance gives"
    elif gain < case.least:
        reason = "explains too little to be told from what else is unknown"
    elif case.validate.records and held <= 0:
        reason = "does not help on the runs kept apart"
    elif far < case.tolerance:
        reason = SMALL
    elif alone < case.tolerance:
        reason = f"itself {SMALL}: it helps a fit that is caught"
    elif after.at_bound():
        reason = f"{' and '.join(after.at_bound())} at the end of what is plausible"
    return Trial(names, after, gain, held, far, after.rms(kept_apart, case.scales), needed * scale, reason)


def overruled(trials: Sequence[Trial]) -> list[Trial]:
    """Return trials, best first, without those that explain no more than one that hardly moves the prediction."""
    first = next((trial for trial in trials if trial.reason == SMALL), None)
    if first is None:
        return list(trials)
    reason = f"explains no more than {' and '.join(first.names)}, which {SMALL}"
    place = trials.index(first)
    weaker = [trial if trial.reason else replace(trial, reason=reason) for trial in trials[place:]]
    return [*trials[:place], *weaker]


def best_of(trials: Sequence[Trial]) -> Trial | None:
    """Return the trial that pays best; a pair must beat its better half by as much as an effect of its own must."""
    accepted = sorted((trial for trial in trials if not trial.reason), key=lambda trial: trial.stand.total)
    singles = [trial for trial in accepted if len(trial.names) == 1]
    if not accepted:
        return None
    is_half = len(accepted[0].names) == 2 and bool(singles) and behind(singles[0], accepted[0]) < accepted[0].needed
    return singles[0] if is_half else accepted[0]


def behind(trial: Trial, best: Trial) -> float:
    """Return by how much a trial is worse than the best."""
    return trial.stand.total - best.stand.total


def is_alike(a: Stand, b: Stand) -> bool:
    """Tell whether the runs cannot tell two answers apart."""
    if len(a.effects) != len(b.effects):
        return False
    allowed = ALIKE * max(a.scale, 1.0)
    return (b.cost + b.held_cost) - (a.cost + a.held_cost) < allowed
