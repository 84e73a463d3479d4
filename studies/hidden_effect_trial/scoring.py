"""The rule of the trial, and what many cases add up to."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from studies.hidden_effect_trial.effects import CATALOGUE_NAMES
from studies.hidden_effect_trial.faults import TRUE
from studies.hidden_effect_trial.folder import Answer

#: Verdicts that a diagnosis gives.
NOTHING, FOUND, UNKNOWN = "nothing-missing", "effects-found", "unknown"
#: Largest number of effects in a group.
LARGEST_GROUP = 3
#: Kinds of cases in which something is to be named, and those in which nothing is.
NAMED, UNNAMED = ("single", "pair"), ("none", "faint")


@dataclass(frozen=True)
class Diagnosed:
    """What the trial looks at in a diagnosis.

    Parameters
    ----------
    verdict
        One of the three words.
    named
        Effects that were named.
    groups
        Effects that it did not distinguish.
    floor, error
        Noise floor and the error on the run for testing, or the validation error [m]; NaN if it gives none.
    inside
        By parameter of what is hidden, whether the 95 % interval holds the truth, and the interval's half width over
        the true value.
    seconds
        How long it took.
    is_tested
        Whether `error` is that on the run for testing.
    remainder, words
        What the named effects leave unexplained [m], zero if only noise; and what it is said to look like.
    """

    verdict: str
    named: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    floor: float
    error: float
    inside: Mapping[str, tuple[bool, float]]
    seconds: float
    is_tested: bool = False
    remainder: float = 0.0
    words: str = ""


#: Which name of the catalogue is right for what it does not hold. A name is right only where the mechanism and its
#: place in the signal chain are those of the catalogue, in another form. A similar curve made elsewhere is a wrong
#: name: its remedy would be wrong.
NAMES: Mapping[str, tuple[str, ...]] = {
    "quadratic_sensor": (),  # looks like a gain that grows with stroke, but the guides are sound: calibrate the sensor
    "s_shaped_sensor": (),  # likewise; nothing in the catalogue is an error of the sensor's scale
    "backlash": (),  # at low rates a reading with friction, but behind the motion: friction would damp the mode
    "contact_spring": (
        "preload_loss",
    ),  # a contact that opens or closes amid the stroke: another stiffness on one side
    "telegraph_jump": (),  # a drift is steady, this jumps
    "quadratic_drag": (),  # no damping of the catalogue grows with the velocity
    "interpolation_error": (),  # periodic in position, where hum is periodic in time
    "stick_slip": (),  # blows at random moments, in motion and at rest; friction is a function of the motion
    "two_slope_gain": (
        "stroke_dependent_amplification",
    ),  # the gain changes with the stroke, at once instead of evenly
    "lost_samples": (),  # of the recorder; rounding is to steps, this to the sample before
}


def is_right(answer: Answer, found: Diagnosed) -> bool:
    """Tell whether a verdict is right.

    Every hidden effect is named, alone or in a group of at most three that the data truly cannot separate, and nothing
    else is; where nothing is missing, or it is too faint to show, nothing is named; what no catalogue holds is unknown,
    or has a name that is right for it (`NAMES`) and a stated remainder. On an imperfect bench the main effect is named,
    and none is invented.

    >>> from studies.hidden_effect_trial.folder import Answer
    >>> creep = Answer("c", "single", {"creep": {}}, {"creep": ()}, {"creep": 5.0}, 1e-8, 1e-4)
    >>> is_right(creep, Diagnosed("effects-found", ("creep",), (), 1e-8, 1e-8, {}, 1.0))
    True
    >>> is_right(creep, Diagnosed("effects-found", ("creep", "mains_hum"), (), 1e-8, 1e-8, {}, 1.0))
    False
    """
    if answer.fault:
        return names_main(answer, found) and not false_effects(answer, found)
    if answer.kind in UNNAMED:
        return found.verdict == NOTHING and not found.named
    if answer.kind == "outside":
        return found.verdict == UNKNOWN or _is_named_with_remainder(answer, found)
    if found.verdict != FOUND:
        return False
    open_effects = set(answer.effects)
    for name in found.named:
        meant = [hidden for hidden in open_effects if _means(answer, group_of(found, name), hidden)]
        if not meant:
            return False
        open_effects.remove(meant[0])
    return not open_effects


def _means(answer: Answer, group: tuple[str, ...], hidden: str) -> bool:
    """Return whether a group has a hidden effect, and otherwise only effects truly confounded with it."""
    called = CATALOGUE_NAMES.get(hidden, hidden)
    return len(group) <= LARGEST_GROUP and called in group and set(group) <= {called, *answer.groups.get(hidden, ())}


def names_main(answer: Answer, found: Diagnosed) -> bool:
    """Tell whether the hidden effect of an imperfect bench is named, whatever else is; true if nothing is hidden."""
    groups = [group_of(found, name) for name in found.named]
    return all(any(_means(answer, group, hidden) for group in groups) for hidden in answer.effects)


def false_effects(answer: Answer, found: Diagnosed) -> tuple[str, ...]:
    """Return the groups, in words, that are named on an imperfect bench and are not what is hidden there.

    What a structural error truly contains is no invention.
    """
    groups = [group_of(found, name) for name in found.named]
    known = TRUE.get(answer.fault, ())
    meant = [any(_means(answer, group, hidden) for hidden in answer.effects) or group[0] in known for group in groups]
    return tuple(" or ".join(group) for group, right in zip(groups, meant, strict=True) if not right)


def _is_named_with_remainder(answer: Answer, found: Diagnosed) -> bool:
    """Return whether an effect outside the catalogue has a right name or group, with a stated remainder."""
    names = NAMES.get(next(iter(answer.effects)), ())
    groups = [group_of(found, name) for name in found.named]
    right = [len(group) <= LARGEST_GROUP and not set(group).isdisjoint(names) for group in groups]
    return found.verdict == FOUND and found.remainder > 0.0 and bool(right) and all(right)


def group_of(found: Diagnosed, name: str) -> tuple[str, ...]:
    """Return the group in which an effect is named; itself if it is named alone."""
    return next((group for group in found.groups if name in group), (name,))


def error_ratio(answer: Answer, found: Diagnosed) -> float:
    """Return the error over the one that no model can go below, on the same runs."""
    return found.error / (answer.floor if found.is_tested else answer.validation_floor or answer.floor)


def is_false_alarm(answer: Answer, found: Diagnosed) -> bool:
    """Tell whether an effect was named where nothing is missing."""
    return answer.kind in UNNAMED and bool(found.named)


def wilson(hits: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Return the 95 % interval of a rate, after Wilson (1927).

    >>> low, high = wilson(0, 10)  # with no hits the interval is from 0 to z^2 / (n + z^2)
    >>> low, round(high, 4) == round(1.959964**2 / (10 + 1.959964**2), 4)
    (0.0, True)
    """
    if not trials:
        return 0.0, 1.0
    rate, weight = hits / trials, z * z / trials
    middle = (rate + weight / 2.0) / (1.0 + weight)
    half = z / (1.0 + weight) * math.sqrt(rate * (1.0 - rate) / trials + weight / (4.0 * trials))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def row_of(answer: Answer) -> str:
    """Return the row of the confusion matrix that a case belongs to."""
    return next(iter(answer.effects)) if answer.kind == "single" else answer.kind


def columns_of(answer: Answer, found: Diagnosed) -> tuple[str, ...]:
    """Return the columns of the confusion matrix that a verdict counts in.

    A named effect counts as what was hidden, if it stands in a group with it that the data cannot separate.
    """
    if not found.named or found.verdict != FOUND:
        return (found.verdict,)
    if answer.kind == "pair":
        return ("right",) if is_right(answer, found) else ("wrong",)
    groups = {name: group_of(found, name) for name in found.named}
    return tuple(next((hidden for hidden in answer.effects if hidden in group), name) for name, group in groups.items())


def median(values: Iterable[float]) -> float:
    """Return the median of what is finite; NaN of nothing."""
    ordered = sorted(value for value in values if math.isfinite(value))
    n = len(ordered)
    return 0.5 * (ordered[(n - 1) // 2] + ordered[n // 2]) if n else math.nan


def matrix(judged: Sequence[tuple[Answer, Diagnosed]]) -> dict[str, dict[str, int]]:
    """Return how often each row of the confusion matrix met each column."""
    counts: dict[str, dict[str, int]] = {}
    for answer, found in judged:
        row = counts.setdefault(row_of(answer), {})
        for column in columns_of(answer, found):
            row[column] = row.get(column, 0) + 1
    return counts
