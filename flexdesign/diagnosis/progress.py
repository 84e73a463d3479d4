"""Progress of a diagnosis: what is tried, and about how long is left.

How long is left depends on what is found, so that it is an estimate from other diagnoses: the typical time of each
stage over that of the first screening, which makes about as many simulations in every diagnosis. Before the end of that
screening nothing is known, and nothing is said. A stage that lasts longer than usual is taken to need as long again as
it has taken so far: few do, and those by far. The report is written after all that.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from time import perf_counter

#: Stages. Until the catalogue is screened nothing is known of the time that follows.
PREPARATION, SCREENING, FITS, SECOND_SCREENING, ENDING = "beginning", "screening", "fits", "with_effect", "ending"
#: Typical time of each stage over that of the first screening: of the fits, of screening and fits with an effect that
#: was added, and of the last fit with test runs and intervals. Medians of ten diagnoses, where they were 1.2 to 20, 1.4
#: to 15 and 0.5 to 16; `python -m studies.benchmarks.progress` measures them.
TYPICAL = {FITS: 4.0, SECOND_SCREENING: 1.9, ENDING: 0.85}
#: What follows a stage, if an effect is added.
FOLLOWS = {FITS: (SECOND_SCREENING, ENDING), SECOND_SCREENING: (ENDING,)}
#: How the words of `flexdesign.diagnosis` begin where a stage does.
WORDS = {
    "predicting with the model as it is": PREPARATION,
    "screening the catalogue": SCREENING,
    "screening with": SECOND_SCREENING,
    "looking at the residual": ENDING,
}
#: Words of a fit.
FIT = ("trying", "fitting with")


class Progress:
    """Takes the words of a diagnosis, and says them with about how long is left.

    Parameters
    ----------
    say
        Takes what is said.
    clock
        Returns the time [s].
    """

    def __init__(self, say: Callable[[str], None], clock: Callable[[], float] = perf_counter) -> None:
        self.say, self.clock = say, clock
        self.stage, self.fits = PREPARATION, 0
        self._begun: dict[str, float] = {}  # when each stage began
        self._lock = Lock()  # fits run side by side

    def __call__(self, text: str) -> None:
        """Say what is being done."""
        with self._lock:
            self._enter(self._stage_of(text))
            self.fits += text.startswith(FIT)
            count = f"fit {self.fits}: " if text.startswith(FIT) else ""
            left = "last stage" if self.stage == ENDING else duration_text(self.left())
        self.say(f"{count}{text}{', ' if left else ''}{left}")

    def left(self) -> float | None:
        """Return about how long is left [s]; None where nothing is known of it, and in the last stage."""
        if self.stage not in FOLLOWS or not {SCREENING, FITS} <= self._begun.keys():
            return None
        unit = self._begun[FITS] - self._begun[SCREENING]
        typical, so_far = unit * TYPICAL[self.stage], self.clock() - self._begun[self.stage]
        return max(typical - so_far, so_far) + unit * sum(TYPICAL[stage] for stage in FOLLOWS[self.stage])

    def _stage_of(self, text: str) -> str:
        if text.startswith(FIT) and self.stage == SCREENING:
            return FITS
        return next((stage for words, stage in WORDS.items() if text.startswith(words)), self.stage)

    def _enter(self, stage: str) -> None:
        if stage == PREPARATION:  # of all runs, after a search in a part of them
            self._begun.clear()
        if stage != self.stage:
            self._begun[stage] = self.clock()
        self.stage = stage


def duration_text(seconds: float | None) -> str:
    """Return a time in words, with one significant digit: no finer than it is known.

    >>> duration_text(2.0), duration_text(17.0), duration_text(100.0)
    ('about 2 s left', 'about 20 s left', 'about 2 min left')
    >>> duration_text(290.0), duration_text(None)
    ('about 5 min left', '')
    """
    if seconds is None:
        return ""
    number, unit = (seconds, "s") if seconds < 60 else (seconds / 60, "min")
    return f"about {float(f'{number:.0e}'):.0f} {unit} left"
