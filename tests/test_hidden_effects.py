"""Cases of the hidden-effect trial, made by an independent simulator, that every change must pass."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from studies.hidden_effect_trial import trial
from studies.hidden_effect_trial.scoring import is_right

ASKED = trial.settings()


# With 95 % right in the long run, more cases than these are wrong once in a hundred times.
@pytest.mark.parametrize(
    ("numbers", "allowed"), [(ASKED.ci, 1), pytest.param(ASKED.guard, 4, marks=pytest.mark.slow)], ids=["few", "all"]
)
def test_the_diagnosis_names_what_is_hidden(tmp_path: Path, numbers: Sequence[int], allowed: int) -> None:
    outcomes = trial.run(numbers, tmp_path, jobs=1, seconds=ASKED.seconds, say=print)
    assert len(outcomes) == len(numbers) and not [outcome.error for outcome in outcomes if outcome.error]
    wrong = [trial.outcome_text(o) for o in outcomes if o.found is None or not is_right(o.answer, o.found)]
    named_in_nothing = [o for o in outcomes if o.answer.kind == "none" and o.found and o.found.named]
    assert not named_in_nothing and len(wrong) <= allowed, "\n".join(wrong)
