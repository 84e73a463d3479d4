"""One rule turns results into JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

from flexdesign.core.model import Quantity
from flexdesign.core.serialise import to_json


class Kind(Enum):
    STATIC = "static"


@dataclass
class Inner:
    number: float
    place: Path


@dataclass
class Outer:
    inner: Inner
    kind: Kind
    values: np.ndarray
    stiffness: Quantity


def test_a_dataclass_goes_through_json_and_back() -> None:
    stiffness = Quantity("K_in", 2e6, "N/m", "N/mm", half_width=1e4)
    given = Outer(Inner(math.inf, Path("a/b")), Kind.STATIC, np.array([[1.0, math.nan]]), stiffness)
    found = to_json(given)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["inner"] == {"number": None, "place": "a/b"}
    assert found["kind"] == "static"
    assert found["values"] == [[1.0, None]]
    assert (found["stiffness"]["value"], found["stiffness"]["half_width"]) == (2000.0, 10.0)
    assert found["stiffness"]["unit"] == "N/mm"


@pytest.mark.parametrize("value", [object(), {1: "a"}, Outer])
def test_what_has_no_rule_is_refused(value: object) -> None:
    with pytest.raises(TypeError):
        to_json(value)


def test_numbers_of_numpy_become_plain() -> None:
    assert [type(to_json(v)) for v in (np.float32(1), np.int64(2), np.bool_(True))] == [float, int, bool]
