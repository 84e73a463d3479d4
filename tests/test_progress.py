"""Progress of a diagnosis: stages by its words, and what is said of the time left."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexdesign.diagnosis import progress
from flexdesign.diagnosis.progress import ENDING, FITS, SECOND_SCREENING, TYPICAL, Progress
from studies.benchmarks import progress as benchmark
from studies.benchmarks.progress import Message

#: A diagnosis that finds creep: words and when they were said [s]. The first screening takes two seconds.
FOUND = (
    (0.0, "reading the noise"),
    (1.0, "predicting with the model as it is"),
    (2.0, "calibrating"),
    (4.0, "screening the catalogue"),
    (6.0, "trying creep"),
    (7.0, "fitting with creep"),
    (13.0, "screening with creep"),
    (16.0, "looking at the residual"),
    (18.0, "predicting the test runs"),
)
SCREENING = 2.0


PACKAGE = Path(progress.__file__).parents[1]


class Told:
    """A progress with a clock that is set, and what it said."""

    def __init__(self) -> None:
        self.now, self.said = 0.0, list[str]()
        self.progress = Progress(self.said.append, lambda: self.now)

    def say(self, at: float, text: str) -> float | None:
        self.now = at
        self.progress(text)
        return self.progress.left()


def left_after(*words: tuple[float, str]) -> float | None:
    told = Told()
    return [told.say(*word) for word in words][-1]


@pytest.mark.parametrize("words", [*progress.WORDS, *progress.FIT])
def test_the_diagnosis_says_the_words_at_which_stages_begin(words: str) -> None:
    sources = [path for part in ("diagnosis", "estimation") for path in (PACKAGE / part).rglob("*.py")]
    assert any(f'"{words}' in path.read_text(encoding="utf-8") for path in sources if path.stem != "progress")


def test_nothing_is_said_of_the_time_before_the_catalogue_is_screened() -> None:
    told = Told()
    assert [told.say(*word) for word in FOUND[:4]] == [None] * 4
    assert told.said == [text for _, text in FOUND[:4]]


def test_time_left_is_that_of_the_stages_that_follow() -> None:
    usual = sum(TYPICAL[stage] for stage in (FITS, SECOND_SCREENING, ENDING))
    assert left_after(*FOUND[:5]) == pytest.approx(SCREENING * usual)
    assert left_after(*FOUND[:6]) == pytest.approx(SCREENING * usual - 1.0)  # a second later, in the same stage


def test_beside_an_effect_its_own_stages_count() -> None:
    usual = SCREENING * (TYPICAL[SECOND_SCREENING] + TYPICAL[ENDING])
    assert left_after(*FOUND[:7]) == pytest.approx(usual)


def test_a_stage_that_lasts_long_is_taken_to_last_as_long_again() -> None:
    late = 6.0 + 3 * TYPICAL[FITS] * SCREENING
    left = left_after(*FOUND[:5], (late, "fitting with sensor_drift"))
    assert left == pytest.approx(SCREENING * (3 * TYPICAL[FITS] + TYPICAL[SECOND_SCREENING] + TYPICAL[ENDING]))


def test_no_time_is_promised_in_the_last_stage() -> None:
    told = Told()
    assert [told.say(*word) for word in FOUND][-2:] == [None] * 2
    assert told.said[-1] == "predicting the test runs, last stage"
    told = Told()
    for word in FOUND[:4]:
        told.say(*word)
    assert told.say(6.0, "looking at the residual") is None  # nothing was worth a fit
    assert told.said[-1] == "looking at the residual, last stage"


def test_without_a_screening_of_all_runs_nothing_is_said() -> None:
    confirmed = ((3.0, "fitting with creep, the whole runs"), (9.0, "looking at the residual"))
    assert left_after(*FOUND[:3], confirmed[0]) is None
    assert left_after(*FOUND[:3], *confirmed) is None


def test_other_words_of_a_diagnosis_are_said_as_they_are() -> None:
    """Also where a stage comes that had none before it."""
    assert left_after(*FOUND[:4], (6.0, "screening with creep")) is None
    told = Told()
    told.say(1.0, "asking something new")
    assert told.said == ["asking something new"]


def test_fits_are_counted() -> None:
    told = Told()
    for word in FOUND[:6]:
        told.say(*word)
    assert told.said[-2].startswith("fit 1: trying creep, about")
    assert told.said[-1].startswith("fit 2: fitting with creep, about")


def test_words_of_time_are_no_finer_than_it_is_known() -> None:
    said = {progress.duration_text(float(seconds)) for seconds in range(1, 3600)}
    assert said == {f"about {n} {unit} left" for n in (*range(1, 10), *range(10, 70, 10)) for unit in ("s", "min")}


# --- the benchmark --------------------------------------------------------------------------------------------------


def test_estimates_are_set_beside_what_was_true() -> None:
    words = [*(Message(*each) for each in FOUND), Message(20.0, "")]
    found = {each.stage: each for each in benchmark.estimates(words)}
    assert list(found) == ["screening", FITS, SECOND_SCREENING, ENDING]
    assert found["screening"].predicted is None and found["screening"].true == 16.0
    assert found[ENDING].predicted is None
    assert found[FITS].true == 14.0 and found[SECOND_SCREENING].true == 7.0 and found[ENDING].true == 4.0
    assert found[FITS].predicted == left_after(*FOUND[:5])
    assert benchmark.stage_durations(words) == {FITS: 3.5, SECOND_SCREENING: 1.5, ENDING: 2.0}
