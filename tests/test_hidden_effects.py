"""The part of the hidden-effect trial that every change must pass: 24 cases of an independent simulator."""

from __future__ import annotations

from pathlib import Path

from studies.hidden_effect_trial import trial
from studies.hidden_effect_trial.scoring import is_right

#: Of 24 cases so many may be wrong: with 95 % right in the long run, more than that happen once in a hundred times.
ALLOWED = 4


def test_the_diagnosis_names_what_is_hidden(tmp_path: Path) -> None:
    asked = trial.settings()
    outcomes = trial.run(asked.ci, tmp_path, jobs=2, seconds=asked.seconds, say=print)
    assert len(outcomes) == 24 and not [outcome.error for outcome in outcomes if outcome.error]
    wrong = [trial.described(o) for o in outcomes if o.found is None or not is_right(o.answer, o.found)]
    named_in_nothing = [o for o in outcomes if o.answer.kind == "none" and o.found and o.found.named]
    assert not named_in_nothing and len(wrong) <= ALLOWED, "\n".join(wrong)
