"""Which effects earn a place in a model: forward in ones and twos, and back again.

An effect is judged by what it leaves after all free numbers are fitted anew with it: of the runs that the fit saw, by
the fall of the cost against what chance gives; of those it did not see, by the fall of the cost and by how far it moves
the prediction. Of these runs, too, where each began is fitted, and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from flexdesign.evidence.calibration import FOLLOWED
from flexdesign.evidence.case import Case
from flexdesign.evidence.local_minima import grid_initial_states
from flexdesign.evidence.marquardt import Solution
from flexdesign.evidence.model_comparison import (
    INDISTINGUISHABLE,
    LESS,
    LEVEL,
    SHARE,
    Step,
    Trial,
    behind,
    best_of,
    critical_value,
    evaluate,
    is_alike,
    overruled,
)
from flexdesign.evidence.screening import Candidate, Direction, Moves, Screening
from flexdesign.evidence.stand import GROSS, Stand, escape, fitted, judged, like, refitted, solved
from flexdesign.model import Model

#: A first fit with some effects, not judged on the runs kept apart: names of those that are new, all, and the fit.
Attempt = tuple[tuple[str, ...], tuple[Candidate, ...], Solution]
#: Effects that are refitted after a screening, pairs among them; trials of each from which a fit begins.
SHORTLIST, PAIRS, BEGINNINGS = 7, 2, 2
#: A candidate that promises less than this share of what the best one does cannot win at this step.
FAINT = 0.2
#: A second beginning is tried where it promises this share of the first.
SECOND_BEST = 0.7
#: A first fit finds Jacobians so often, and ends where a step lowers chi^2 by less than this share; one that is carried
#: further finds so many more.
FIRST, FIRST_SHARE, SECOND = 3, 1e-3, 6
#: A fit that leaves no more than this share of the excess has found what was missing.
FOUND = 0.1
#: What is near the best is fitted further; only what is chosen is carried to its end.
SECOND_SHARE = 1e-5
#: A first fit is fitted further where it lowers the cost by this share of what the best one does.
WITHIN_REACH = 0.7
#: A fit is worth its time where the score promises this share of what would be accepted.
WORTH_A_FIT = 0.5
#: Beside an effect whose strength, squared, is worth so many times that, no fit without it is tried.
FIRM = 20.0
#: Rivals whose cost is higher by no more than this share of what the best one gains are carried to the end with it, and
#: no more than so many.
NEAR, RIVALS = 0.02, 3
#: Its own numbers make up for what it lacks where one of which nothing was known differs by this share from what it was
#: designed to be. So many effects are refitted there.
CHANGED, LONG_LIST = 0.3, 12
#: Standard deviations from its prior at which a number makes up for something else.
STRAINED = 5.0
#: Where nothing earns its place but the cost is so many standard deviations of chance above what noise leaves, what was
#: found may stand in for something else beside it.
TOO_MUCH = 3.0
#: No more effects than these make a group that the runs cannot tell apart.
LARGEST_GROUP = 3
#: No more effects than these are added to explain runs in time, and to explain frequency responses: there a driver, a
#: delay and two modes are lacking together, each acts in its own band, and one more is not to be missed beside them.
MOST, MOST_OF_LINES = 3, 5


def forward(case: Case, stand: Stand, candidates: Sequence[Candidate], moves: Moves | None = None) -> Step:
    """Return the addition that pays best, or none; what effects do at a fit nearby may be known from its step."""
    left = [c for c in candidates if c.name not in stand.names and c.after in ("", *stand.names)]
    case.progress("screening the catalogue" if not stand.effects else f"screening beside {', '.join(stand.names)}")
    screening = Screening(stand.solution, left, case.coarse, moves)
    score, strained = screening.critical_value(LEVEL, case.drawn(stand)), _is_strained(case, stand)

    def attempt(beginning: tuple[Direction, ...]) -> Attempt | None:
        case.progress(f"trying {' and '.join((*stand.names, *_names(beginning)))}")
        return _extended(case, stand, beginning, is_strained=strained)

    def tried(beginnings: Sequence[tuple[Direction, ...]], reached: float = 0.0) -> list[Trial]:
        made = [each for each in case.each(attempt, beginnings) if each is not None]
        return [evaluate(case, stand, each, names, score) for names, each in _refined(case, stand, made, reached)]

    enough = score if strained else max(score, WORTH_A_FIT * SHARE * excess(stand))
    trials = tried(_shortlist(screening, enough, is_gross=stand.scale > GROSS, is_strained=strained))
    best, free = best_of(case, trials), None
    if best is not None and leaves_more_than_noise(best.stand) and excess(best.stand) < FOUND * excess(stand):
        # A second effect may be taken for what helps a fit out of a local minimum.
        free = _ended(case, stand, best, score, is_stuck=True)
        trials, best = [free if trial is best else trial for trial in trials], free
    # Where one explains all but noise, or there was no more from the start, two have nothing to tell apart.
    if leaves_more_than_noise(stand if best is None else best.stand):
        trials += tried(_pairs(screening, enough), 0.0 if best is None else best.gain)
    done = {trial.names for trial in trials}
    if (best := best_of(case, trials)) is not None:
        trials += tried(_look_alikes(screening, best, done))
    trials = overruled(sorted(trials, key=lambda trial: trial.stand.total))
    best = best_of(case, trials)
    if best is None:
        return Step(None, tuple(trials), moves=screening.moves if case.fitting.sparing else None)
    return _chosen(case, stand, trials, best, score, carry_on=best is not free)


def excess(stand: Stand) -> float:
    """Return by how much chi^2 of the fitted runs exceeds what noise leaves."""
    return max(stand.seen_cost - stand.solution.problem.suite.samples, 0.0)


def confirmed(case: Case, stand: Stand, seen: Step) -> Step | None:
    """Return an addition that a part of the runs chose, with its rivals, fitted to all of them; None if they refuse it.

    Others that the part refused are kept as it saw them.
    """
    if seen.chosen is None:
        return None
    score = seen.chosen.score
    trials = list[Trial]()
    for trial in (seen.chosen, *seen.alike):
        case.progress(f"fitting with {' and '.join((*stand.names, *trial.names))}, the whole runs")
        if (made := _as_seen(case, stand, trial)) is not None:
            trials.append(evaluate(case, stand, made, trial.names, score))
    trials.sort(key=lambda trial: trial.stand.total)
    best, done = best_of(case, trials), {trial.names for trial in trials}
    if best is None:
        return None
    others = [trial for trial in seen.trials if trial.names not in done]
    step = _chosen(case, stand, trials, best, score)
    return replace(step, trials=(*step.trials, *(replace(each, reason=each.reason or LESS) for each in others)))


def _as_seen(case: Case, stand: Stand, trial: Trial) -> Stand | None:
    """Return a fit with the effects of a trial that saw a part of the runs, from where that ended."""
    model, added = stand.model, tuple(effect for effect in trial.stand.effects if effect.name in trial.names)
    for effect in added:
        model = effect.add(model)
    # Where a run began may be one thing to its opening, and another to the whole of it.
    start = case.fine(like(model, trial.stand))
    begun = grid_initial_states(case.prepared(case, start).identify, start, case.identify.names, case.each)
    made = fitted(case, begun, (*stand.effects, *added), {})
    return made


def _chosen(
    case: Case,
    stand: Stand,
    trials: Sequence[Trial],
    best: Trial,
    score: float,
    *,
    carry_on: bool = False,
) -> Step:
    """Return the step with the best trial, carried to its end if it is to be, and those near it, carried to theirs."""
    accepted = [trial for trial in trials if not trial.reason]
    reach = max(NEAR * best.gain, INDISTINGUISHABLE * best.stand.discrepancy)
    near = [t for t in accepted if t is not best and len(t.names) == len(best.names) and behind(t, best) < reach]
    if carry_on:
        best = _ended(case, stand, best, score)
    rivals = [_ended(case, stand, trial, score) for trial in near[:RIVALS]]
    return Step(best, tuple(trials), tuple(trial for trial in rivals if is_alike(best.stand, trial.stand)))


def _names(beginning: Sequence[Direction]) -> tuple[str, ...]:
    return tuple(direction.candidate.name for direction in beginning)


def _look_alikes(screening: Screening, best: Trial, done: Collection[tuple[str, ...]]) -> list[tuple[Direction, ...]]:
    """Return beginnings with an effect in the place of one that it is known to be taken for, whatever it promises."""
    first = {directions[0].candidate.name: directions[0] for directions in screening.best()}
    found: list[tuple[Direction, ...]] = []
    tried = {frozenset(names) for names in done}
    for name in best.names if all(each in first for each in best.names) else ():
        for other in first[name].candidate.like:
            beginning = tuple(first[other if each == name else each] for each in best.names if other in first)
            if beginning and other not in best.names and frozenset(_names(beginning)) not in tried:
                found.append(beginning)
    return found


def leaves_more_than_noise(stand: Stand) -> bool:
    """Tell whether the runs that were fitted leave more than chance makes of white noise."""
    samples = stand.solution.problem.suite.samples
    return stand.seen_cost > samples + TOO_MUCH * math.sqrt(2.0 * samples)


def _ended(case: Case, before: Stand, trial: Trial, score: float, *, is_stuck: bool = False) -> Trial:
    """Return a trial with its fit carried to the end, unless it misses the runs by far."""
    stand = trial.stand
    if stand.scale > GROSS:
        return trial
    ended = fitted(case, stand.model, stand.effects, {}, old=stand.solution.columns())
    if ended is not None and is_stuck:
        ended = escape(case, ended)
    return trial if ended is None else evaluate(case, before, ended, trial.names, score)


def _refined(
    case: Case, before: Stand, attempts: Sequence[Attempt], reached: float
) -> list[tuple[tuple[str, ...], Stand]]:
    """Return the best attempt of each candidate, fitted further if within reach of the best, or of what was reached."""
    best: dict[tuple[str, ...], Attempt] = {}
    for names, effects, solution in attempts:
        if names not in best or solution.cost < best[names][-1].cost:
            best[names] = names, effects, solution
    most = max([reached, *(before.cost - solution.cost for *_, solution in best.values())])

    def refined(attempt: Attempt) -> Stand | None:
        names, effects, solution = attempt
        further = None
        if before.cost - solution.cost >= WITHIN_REACH * most:
            case.progress(f"fitting with {' and '.join((*before.names, *names))}")
            further = _further(case, effects, solution)
        return further or judged(case, solution, effects, FIRST_SHARE)

    made = case.each(refined, best.values())
    return [(names, stand) for names, stand in zip(best, made, strict=True) if stand is not None]


def _further(case: Case, effects: tuple[Candidate, ...], first: Solution) -> Stand | None:
    """Return a first fit carried further, its runs in the initial states that suit it best."""
    model = case.fine(first.problem.at(first.x))
    moved = grid_initial_states(first.problem.suite, model, case.identify.names, case.each)
    return fitted(case, moved, effects, {}, old=first.columns(), most=SECOND, share=SECOND_SHARE)


def confusable(case: Case, stand: Stand, base: Model, steps: Sequence[Step]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of effects that these runs cannot tell apart, the one in the model first.

    Effects that did as well when one was added are fitted in its place beside all that were added later.
    """
    groups = list[tuple[str, ...]]()
    for step in steps:
        for name in step.chosen.names if step.chosen else ():
            if name not in stand.names or any(name == group[0] for group in groups):
                continue
            beside = {*step.chosen.names} - {name} if step.chosen else set[str]()
            rivals = [trial for trial in step.alike if beside <= {*trial.names} and name not in trial.names]
            others = [
                other
                for trial in rivals
                for other in trial.names
                if other not in {*beside, *stand.names} and _does_as_well(case, stand, base, name, trial.stand, other)
            ]
            if others:
                groups.append((name, *others[: LARGEST_GROUP - 1]))
    return tuple(groups)


def _does_as_well(case: Case, stand: Stand, base: Model, name: str, seen: Stand, other: str) -> bool:
    """Tell whether an effect in the place of another, as it was fitted before, explains as much."""
    instead = next(effect for effect in seen.effects if effect.name == other)
    effects = tuple(instead if effect.name == name else effect for effect in stand.effects)
    if {*seen.names} == {effect.name for effect in effects}:
        return is_alike(stand, seen)
    case.progress(f"fitting with {other} in the place of {name}")
    model = base
    for effect in effects:
        model = effect.add(model)
    model = like(like(model, seen), stand)
    made = fitted(case, model, effects, {})
    return made is not None and is_alike(stand, made)


def backward(case: Case, stand: Stand, base: Model, candidates: Sequence[Candidate]) -> Stand:
    """Return the fit without effects that no longer earn their place beside the others."""
    for effect in stand.effects:
        if _is_firm(stand, effect):
            continue
        rest = tuple(other for other in stand.effects if other.name != effect.name)
        needed = critical_value(float(chdtri(1, LEVEL)), (effect,)) * stand.discrepancy
        without = refitted(case, stand, base, rest)
        if without is not None and without.cost - stand.cost < needed:
            return backward(case, without, base, candidates)
    return stand


def _is_firm(stand: Stand, effect: Candidate) -> bool:
    """Tell whether an effect is so many standard deviations from null that a fit without it says nothing new."""
    where, x = stand.solution.problem.where, stand.solution.x
    j = where.names.index(effect.strength)
    variance = where.slopes(x)[j] ** 2 * stand.solution.covariance[j, j]
    worth = FIRM * float(chdtri(1, LEVEL)) * stand.discrepancy
    return not effect.is_limit and where.values(x)[effect.strength] ** 2 > worth * variance


def _is_strained(case: Case, stand: Stand) -> bool:
    """Tell whether numbers of the model itself moved far to make up for what it lacks, beside a gross misfit."""
    if stand.scale <= GROSS:
        return False
    where = stand.solution.problem.where
    values = where.values(stand.solution.x)
    free = [name for name in case.designed if name in values and name not in where.known]
    return any(abs(values[name] - case.designed[name]) > CHANGED * abs(case.designed[name]) for name in free) or any(
        abs(values[name] - middle) > STRAINED * sigma
        for name, (middle, sigma) in where.known.items()
        if name in case.designed
    )


def _shortlist(
    screening: Screening, needed: float, *, is_gross: bool, is_strained: bool
) -> list[tuple[Direction, ...]]:
    """Return from where fits begin: the best trials of each candidate.

    Beside a gross misfit the score says little of the order: all that promise a finding are fitted. Where the model's
    own numbers made up for what it lacks it says nothing at all.
    """
    found: list[tuple[Direction, ...]] = []
    best = screening.best()
    for directions in best[: LONG_LIST if is_strained else len(best) if is_gross else SHORTLIST]:
        if directions[0].drop < (needed if is_gross else FAINT * best[0][0].drop) and not is_strained:
            break
        enough = max(0.5 * needed, SECOND_BEST * directions[0].drop)
        found += [(direction,) for direction in directions[:BEGINNINGS] if direction.drop > enough]
    return found


def _pairs(screening: Screening, needed: float) -> list[tuple[Direction, ...]]:
    """Return from where fits with two candidates begin: where both promise that much more than the best one alone."""
    best = screening.best()
    most = best[0][0].drop if best else 0.0
    return [(a, b) for promise, a, b in screening.pairs(PAIRS) if promise > most + needed]


def _extended(case: Case, stand: Stand, beginning: Sequence[Direction], *, is_strained: bool) -> Attempt | None:
    """Return a first fit with further effects, coarse, from the slopes that are known."""
    model, start, old = stand.model, dict[str, float](), dict(stand.solution.columns())
    ends = np.cumsum([record.rows for record in case.identify.records])[:-1]
    for direction in beginning:
        model = direction.candidate.add(model)
        start |= direction.start
        strength = direction.candidate.strength
        scale = next(p.scale for p in model.parameters() if p.name == strength)
        if scale == "linear" and not direction.candidate.is_limit:
            old[strength] = [-part for part in np.split(direction.move / direction.values[strength], ends)]
    added = tuple(direction.candidate for direction in beginning)
    bounds = {parameter.name: parameter.plausible for parameter in model.parameters()}
    start = {name: float(np.clip(value, *bounds.get(name, (-math.inf, math.inf)))) for name, value in start.items()}
    # A limit moves the prediction so far that slopes of the model without it mislead; and where the model missed the
    # runs by far, it also misled about where they came from.
    gross = stand.scale > GROSS
    if gross:
        start |= {p.name: p.screen[len(p.screen) // 2] for p in model.parameters() if p.run and p.screen}
    known = None if gross or any(candidate.is_limit for candidate in added) else old
    together, coarse = (*stand.effects, *added), case.coarse(model)
    most = FOLLOWED if gross else FIRST
    tried = [solved(case, coarse, together, start, old=known, most=most, share=FIRST_SHARE, exact=False)]
    if is_strained:
        # There its own numbers, too, made up for what it lacked: they begin where they were thought to be.
        begun = coarse.replace({**start, **case.designed})
        anew = grid_initial_states(case.prepared(case, coarse).identify, begun, case.identify.names, case.each)
        tried.append(solved(case, anew, together, {}, most=FOLLOWED, share=FIRST_SHARE, exact=False))
    best = min((each for each in tried if each is not None), key=lambda each: each.cost, default=None)
    return None if best is None else (_names(beginning), together, best)
