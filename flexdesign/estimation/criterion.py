"""The criterion: when an effect is added to a model, which of several is preferred, and when it is named.

An effect is *added* if it passes four checks.

1. *Evidence.* chi^2 of the fitted runs falls by more than the largest score of the catalogue does by chance
   (family-wise critical value of the score test), times the discrepancy of the model: reduced chi^2 times the number of
   samples that count as one (Bartlett 1946). The unexplained residual is treated as coloured noise: a thousand
   correlated samples do not count as a thousand samples.
2. *Share.* It removes at least the share `SHARE` of the unexplained mean square of the validation runs.
3. *Relevance.* It changes the prediction by more than the tolerance, also by itself.
4. *Determination.* The 95 % interval of its strength excludes the null, and the strength is not at the end of its
   range.

Of several effects that pass, the one with the least BIC is *preferred*. If BIC does not distinguish them and none is
adequate, each is an approximation. Then an effect that predicts the validation runs better by `SHARE` comes before it.

All added effects are *named* if the residual is noise. Otherwise they are named if they explain much compared with the
residual, and if neither smooth functions, a static curve nor a linear system explain more in their place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.special import chdtri

#: Family-wise probability of a false effect in one step; half of it or twice it moves the critical value by 1.4. Also
#: the probability of a false sinusoid in a record, and of a false term among smooth functions.
LEVEL = 1e-3
#: Least share of the unexplained mean square of the validation runs; a smaller one is no finding for a user.
SHARE = 0.05
#: BIC does not distinguish models that differ by less: "very strong" evidence begins at 10 (Kass and Raftery 1995).
INDISTINGUISHABLE = 10.0
#: Confidence of intervals, by convention, and their half-width in standard deviations.
CONFIDENCE = 0.95
HALF_WIDTH = math.sqrt(chdtri(1, 1 - CONFIDENCE))
#: A parameter is undetermined if its 95 % interval is wider than this share of the plausible range.
SHARE_OF_RANGE = 0.5
#: What is large. An effect is named despite a residual if it explains this multiple of it, in squares: two thirds of
#: both together. Models without physics explain more than effects if these leave more than this multiple of what they
#: leave. Sensors and amplifiers are out of calibration by percents: a gain beyond this factor, up or down, is a wrong
#: unit, a wrong channel or physics that the model lacks. Noise is overstated if the residual is smaller by this factor,
#: which chance does not reach with ten samples. Scores are linear estimates, and may be wrong by this factor.
LARGE = 2.0
#: Reason why an effect is not added, after the names of its strengths.
NOT_DETERMINED = "is not determined: its null is less than 1.96 standard errors away"
#: Reason why an added effect is not named, after the name of its strength.
INCLUDES_NULL = "is not determined: its 95 % interval includes its null"


@dataclass(frozen=True)
class Evidence:
    """The results of the four checks for an effect, or for two that are added at once.

    Parameters
    ----------
    gain, needed
        Fall of chi^2 of the fitted runs, less what further initial conditions explain by chance; and its critical value
        times the discrepancy.
    helps
        Whether chi^2 of the validation runs falls.
    share
        Share of the unexplained mean square of the validation runs that the effect removes.
    change, own_change, tolerance
        Change of the prediction against the previous model, or the improvement on the validation runs if that is less;
        change against the model without this effect alone; and the tolerance; all rms [response].
    trace
        Score of the columns of `Candidate.trace`, such as the line of a sinusoid; infinite without columns.
    at_bound, open
        Strengths at the end of the plausible range; and strengths with intervals that include the null.
    """

    gain: float
    needed: float
    helps: bool
    share: float
    change: float
    own_change: float
    tolerance: float
    trace: float = math.inf
    at_bound: tuple[str, ...] = ()
    open: tuple[str, ...] = ()

    @property
    def is_small(self) -> bool:
        """Whether relevance is the first check that fails."""
        return self.refusal.startswith("moves")

    @property
    def refusal(self) -> str:
        """The reason why the effect is not added; empty if it is added."""
        if self.gain < self.needed:
            return "no more than chance gives"
        if self.trace < self.needed:
            return "shows no line at its frequency"
        if not self.helps:
            return "does not help on the validation runs"
        if self.share < SHARE:
            return f"explains less than {100 * SHARE:.0f} % of what is unexplained"
        if min(self.change, self.own_change) < self.tolerance:
            itself = "" if self.change < self.tolerance else "itself "
            return f"{itself}moves the prediction by less than the tolerance"
        if self.at_bound:  # other parameters may leave their limits as further effects are added
            return f"{' and '.join(self.at_bound)} at the end of what is plausible"
        if self.open:
            return f"{' and '.join(self.open)} {NOT_DETERMINED}"
        return ""


def critical_value(score: float, numbers: int) -> float:
    """Return the fall of chi^2 that chance does not reach.

    Parameters
    ----------
    score
        Critical value of the largest score of the catalogue, for effects with one free parameter.
    numbers
        Number of free parameters that are added; each additional one adds a quantile of chi^2.
    """
    return score + float(chdtri(max(numbers, 1), LEVEL) - chdtri(1, LEVEL))


def explained_share(before: float, after: float, floor: float) -> float:
    """Return the share of the mean square above the noise that is removed as an rms residual falls."""
    return (before**2 - after**2) / max(before**2 - floor**2, 1e-300)


def significant_deviation() -> float:
    """Return the standard deviations beyond which a deviation is a finding, at `LEVEL`."""
    return math.sqrt(chdtri(1, LEVEL))


def is_worse(error: float, before: float) -> bool:
    """Tell whether an rms residual is larger than before by more than `SHARE` of the mean square."""
    return error**2 > (1 + SHARE) * before**2


def large_share() -> float:
    """Return `LARGE` as a share of the mean square that was unexplained before."""
    return LARGE / (1.0 + LARGE)


def excludes(value: float, null: float, half_width: float) -> bool:
    """Tell whether a 95 % interval excludes the null."""
    return abs(value - null) > half_width


def is_undetermined(half_width: float, plausible: float) -> bool:
    """Tell whether a 95 % interval covers too large a share of the plausible range."""
    return math.isfinite(plausible) and 2 * half_width > SHARE_OF_RANGE * plausible


def cannot_tell_apart(difference: float, discrepancy: float) -> bool:
    """Tell whether a difference of BIC is too small to distinguish two models, with the discrepancy."""
    return difference < INDISTINGUISHABLE * discrepancy
