"""Samples, columns of answers, limits and fronts, beside definitions and brute force."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.workflows.sweeps import pareto
from flexdesign.workflows.sweeps.pareto import Aim, Limit
from flexdesign.workflows.sweeps.results import Results
from flexdesign.workflows.sweeps.sampling import Factor, cases
from flexdesign.workflows.sweeps.store import Store

WIDTH = Factor("dimensions.width", (0.01, 0.02, 0.04), (0.01, 0.04), True, "m", "mm")
METAL = Factor("material", ("AZ31B", "Ti-6Al-4V"))


def quantity(name: str, value: float, sigma: float | None = None) -> Quantity:
    return Quantity(name, value, "N/m", "N/mm", "output free", "test", sigma)


def test_a_grid_has_every_combination_once() -> None:
    found = [tuple(case.values.values()) for case in cases([WIDTH, METAL], "grid", 0, 0)]
    assert found == list(itertools.product(WIDTH.values, METAL.values))


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube"])
def test_samples_fill_every_tenth_of_each_range(method: str) -> None:
    """Both put n points into n equal parts of each range, one by one: Sobol's if n is a power of two."""
    n = 64
    found = list(cases([WIDTH, METAL], method, n, 3))  # type: ignore[arg-type]
    shares = np.log([float(case.values["dimensions.width"]) / 0.01 for case in found]) / math.log(4)
    assert sorted(np.floor(shares * n).astype(int)) == list(range(n))
    metals = [case.values["material"] for case in found]
    assert metals.count("AZ31B") == n / 2
    assert [c.values for c in cases([WIDTH, METAL], method, n, 3)] == [c.values for c in found]  # type: ignore[arg-type]
    assert [c.values for c in cases([WIDTH, METAL], method, n, 4)] != [c.values for c in found]  # type: ignore[arg-type]


def columns(numbers: np.ndarray, names: str = "ab") -> Results:
    return Results.of([([quantity(n, float(x)) for n, x in zip(names, row, strict=True)], "", 0.0) for row in numbers])


def test_the_front_is_what_no_other_beats() -> None:
    """Against the definition, pair by pair, on numbers with many ties."""
    numbers = np.random.default_rng(0).integers(0, 12, (300, 2)).astype(float)
    aims = [Aim("a_output_free", True), Aim("b_output_free", False)]
    found = pareto.pareto_front(columns(numbers), np.arange(300), aims)
    costs = numbers * [-1, 1]
    beaten = [any((o <= c).all() and (o < c).any() for o in costs) for c in costs]
    assert {tuple(costs[i]) for i in found} == {tuple(c) for c, lost in zip(costs, beaten, strict=True) if not lost}
    assert len({tuple(costs[i]) for i in found}) == len(found)
    assert costs[found[0]][0] == costs[:, 0].min()


def test_limits_are_read_in_the_unit_of_their_quantity() -> None:
    answers = Results.of([([quantity("K", 2e3)], "", 0.0), ([quantity("K", -5e3)], "", 0.0), ((), "no mesh", 0.0)])
    upper = Limit.read("K_output_free", "< 1 N/mm", Path("s"))
    size = Limit.read("|K_output_free|", "> 3 N/mm", Path("s"))
    assert upper.is_satisfied(answers).tolist() == [False, True, False]
    assert pareto.feasible(answers, [upper, size]).tolist() == [1]
    assert pareto.feasible(answers, []).tolist() == [0, 1]
    assert pareto.rank(answers, np.arange(3), Aim("|K_output_free|", True)).tolist() == [1, 0]
    with pytest.raises(InputError, match=r"limits\.K_output_free = 1 mm"):
        Limit.read("K_output_free", "< 1 mm", Path("s")).is_satisfied(answers)
    with pytest.raises(InputError, match="write < or >"):
        Limit.read("K", "1 N/mm", Path("s"))
    with pytest.raises(InputError, match="did you mean K_output_free"):
        pareto.refuse_unknown(answers, [], [Aim("K_output_fre", True)], Path("s"))


def test_answers_come_back_from_their_folder_in_any_order(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.keep(["one", "two"], Results.of([([quantity("K", 1.0, 0.1)], "", 0.5), ((), "does not fit", 0.2)]))
    store.keep(["three"], Results.of([([quantity("L", 3.0)], "", 0.1)]))
    again = Store(tmp_path)
    assert "one" not in again
    again.refresh()
    found = again.find(["three", "two", "one"])
    assert found.errors == ["", "does not fit", ""]
    assert found.at(0) == [quantity("L", 3.0)] and found.at(1) == [] and found.at(2) == [quantity("K", 1.0, 0.1)]
    assert found.seconds.tolist() == [0.1, 0.2, 0.5]
    assert found.in_unit("K_output_free")[2] == pytest.approx(1e-3)


def test_a_damaged_file_counts_as_none(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.keep(["one"], Results.of([([quantity("K", 1.0)], "", 0.5)]))
    (file,) = (tmp_path / "cases").iterdir()
    file.write_bytes(file.read_bytes()[:-40])
    again = Store(tmp_path)
    again.refresh()
    assert "one" not in again
