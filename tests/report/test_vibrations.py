"""The section on natural frequencies speaks of an actuator where the design has one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from flexdesign.report.validation import vibrations


@pytest.mark.parametrize("has_actuator", [True, False])
def test_what_needs_an_actuator_is_left_out_without_one(has_actuator: bool) -> None:
    solution = SimpleNamespace(facts={"unknowns": 35_439, "mass": 0.04}, modes=[], compliance=None)
    actuator = SimpleNamespace(installed_stiffness=6e7) if has_actuator else None
    validation: Any = SimpleNamespace(
        modal=SimpleNamespace(solution=solution),
        study=SimpleNamespace(design=SimpleNamespace(actuator=actuator)),
        comparisons=[],
        further=[],
    )
    made = vibrations.section(validation, ())
    heads = list(made.tables[1].columns)
    assert [head in heads for head in vibrations.DRIVEN] == [has_actuator] * 2
    assert ("actuator" in " ".join(made.paragraphs)) is has_actuator
    assert heads[-3:] == ["mass in x", "mass in y", "mass in z"]
