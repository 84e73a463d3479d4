"""Fits that are caught beside the best one, and how they come free.

Hysteresis has corners: where a threshold is met, where a run turns, where a record began on the way back. Between them
the cost has minima of its own, some of them deep. A fit that has found what is missing and still leaves more than noise
begins again: single runs from elsewhere, hidden constants larger and smaller, all of it a little aside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from flexdesign.evidence.case import Case
from flexdesign.evidence.marquardt import Columns
from flexdesign.evidence.origins import begun_elsewhere, out_of_line
from flexdesign.evidence.screening import Candidate
from flexdesign.evidence.stand import GROSS, Stand, fitted, judged, solved
from flexdesign.model import Model

#: A fit that is followed for a while finds slopes so often; one that is only begun ends where a step lowers the cost by
#: less than this share.
SECOND, FIRST_SHARE = 6, 1e-3
#: Fits begin again so often where runs seem to have come from elsewhere, while that lowers the cost by this share.
ANEW, ANEW_SHARE = 2, 0.01
#: A fit that leaves no more than this share of what was too much has found its effects; where it leaves so many times
#: the noise all the same it may be caught between kinks: then it begins again with hidden constants times these.
FOUND, CAUGHT, ASIDE = 0.1, 1.05, (1.1, 0.9, 1.35, 0.75)
#: A fit with thresholds of voltage ends by beginning again with each times these, and is carried on if it has come so
#: close to the cost before, or below it where simulations are spared; better is what lowers that by so much, and so
#: often it may get better.
BESIDE, CLOSE, BETTER, LONGEST_WALK = (1.1, 0.9), 1.05, 2.0, 6
#: A fit in doubt begins again with turns of runs moved by these shares of their range, and hidden constants by so many
#: times as large shares of themselves.
ASTIR, ASTIR_HIDDEN = (0.005, -0.005, 0.01, -0.01), 20.0


def freed(case: Case, before: Stand, stand: Stand) -> Stand:
    """Return a fit that found what was missing, come free if it was caught; the stand itself if it was not.

    Parameters
    ----------
    case, before
        What is fitted, and how it stood without what was missing.
    stand
        The fit, carried to its end.
    """
    if not has_found(before, stand):
        return stand
    free = from_aside(case, stand) if _is_caught(case, stand) else stand
    return from_elsewhere(case, free, case.identify.names)


def has_found(before: Stand, stand: Stand) -> bool:
    """Tell whether a fit leaves so little of what was too much before that it has found what was missing."""
    noise = stand.solution.problem.suite.samples  # what it would leave on average
    return stand.cost - noise <= FOUND * (before.cost - noise)


def fitted_in_line(
    case: Case,
    model: Model,
    effects: tuple[Candidate, ...],
    start: Mapping[str, float] | None = None,
    old: Columns | None = None,
) -> Stand | None:
    """Return a fit carried to its end, its runs in line; None where the model cannot be simulated.

    Parameters are those of `flexdesign.evidence.stand.fitted`.
    """
    made = fitted(case, model, effects, start or {}, old=old)
    return None if made is None else in_line(case, made)


def in_line(case: Case, stand: Stand) -> Stand:
    """Return a fit begun again with runs out of line as if they had come from elsewhere, while that is better."""
    for _ in range(ANEW if stand.scale < GROSS else 0):
        before, stand = stand, from_elsewhere(case, stand, out_of_line(case.identify, stand.solution.residuals))
        if stand.cost > (1 - ANEW_SHARE) * before.cost:
            break
    return stand


def from_elsewhere(case: Case, stand: Stand, runs: Sequence[str]) -> Stand:
    """Return a fit begun again with some runs as if they had come from elsewhere; the stand itself if that is worse."""
    moved = begun_elsewhere(case, stand.solution.problem.suite, stand.model, runs) if runs else stand.model
    made = None if moved is stand.model else fitted(case, moved, stand.effects, {}, old=stand.solution.columns())
    return stand if made is None or made.cost >= stand.cost else made


def from_aside(case: Case, stand: Stand) -> Stand:
    """Return the best of fits that begin with a hidden constant larger or smaller; the stand itself if none is better.

    Thresholds make corners where the motion meets them, and between corners the cost has minima of its own.
    """
    values = stand.solution.problem.where.values(stand.solution.x)
    for name in (name for effect in stand.effects for name in effect.hidden):
        for factor in ASIDE:
            case.progress(f"fitting with {name} from elsewhere")
            ended = _begun_at(case, stand, {name: factor * values[name]}, (1 - ANEW_SHARE) * stand.cost)
            if ended is not None:
                stand = min(stand, in_line(case, ended), key=lambda each: each.cost)
            if not _is_caught(case, stand):
                return stand
    return stand


def carried_on(case: Case, stand: Stand) -> Stand:
    """Return a stand with its effects' values carried to where the last fit ends; itself if it was carried so far."""
    if not stand.effects or case.fitting.last >= case.fitting.share:
        return stand
    further = fitted(case.at_last, stand.model, stand.effects, {}, old=stand.solution.columns(), most=SECOND)
    return further or stand


def walked(case: Case, stand: Stand) -> Stand:
    """Return where fits end that begin with a threshold of voltage a little larger or smaller, until none is better.

    Wherever the voltage turns, a threshold has a corner and the cost a small minimum of its own, which leaves hardly
    more than noise, and yet a value that is many of its standard deviations off.
    """
    volts = {parameter.name for parameter in stand.model.parameters() if parameter.si == "V"}
    for name in (name for effect in stand.effects for name in effect.hidden if name in volts):
        for _ in range(LONGEST_WALK):
            case.progress(f"fitting with {name} beside where it ended")
            better = next((made for factor in BESIDE if (made := _beside(case, stand, name, factor)) is not None), None)
            if better is None:
                break
            stand = better
    return stand


def _beside(case: Case, stand: Stand, name: str, factor: float) -> Stand | None:
    """Return the fit that begins with a number times a factor; None if it is no better."""
    value = stand.solution.problem.where.values(stand.solution.x)[name]
    ended = _begun_at(case, stand, {name: factor * value}, (1.0 if case.fitting.sparing else CLOSE) * stand.cost)
    return ended if ended is not None and ended.cost < stand.cost - BETTER else None


def _begun_at(case: Case, stand: Stand, values: Mapping[str, float], enough: float) -> Stand | None:
    """Return a fit that begins at other values, carried to its end; None if it is not begun below some cost."""
    aside = case.coarse(stand.model.replace(values))
    found = solved(case, aside, stand.effects, {}, most=SECOND, share=FIRST_SHARE, exact=False)
    if found is None or found.cost >= enough or (begun := judged(case, found, stand.effects, FIRST_SHARE)) is None:
        return None
    return fitted(case, case.fine(begun.model), stand.effects, {}, old=begun.solution.columns())


def _is_caught(case: Case, stand: Stand) -> bool:
    """Tell whether something stays although the effects are found: of all runs a little, or of one of them."""
    return stand.scale > CAUGHT or bool(out_of_line(case.identify, stand.solution.residuals))


def shaken(case: Case, stand: Stand, enough: float) -> Stand:
    """Return the best of fits that begin beside where one ended, until one is good enough.

    Every run that turns where another number has a corner makes a small minimum of its own, which a further effect
    helps to leave: it would be named for that alone.
    """
    turns = {p.name: p for p in stand.model.parameters() if p.run and p.screen}
    hidden = [name for effect in stand.effects for name in effect.hidden]
    for aside in ASTIR:
        if stand.cost < enough:
            break
        values = stand.solution.problem.where.values(stand.solution.x)
        moved = {name: (p.start or 0.0) + aside * (p.plausible[1] - p.plausible[0]) for name, p in turns.items()}
        moved |= {name: (1 + ASTIR_HIDDEN * aside) * values[name] for name in hidden if name in values}
        case.progress(f"asking whether {', '.join(stand.names) or 'the model'} alone would do")
        made = fitted(case, stand.model.replace(moved), stand.effects, {})
        stand = stand if made is None else min(stand, made, key=lambda each: each.cost)
    return stand
