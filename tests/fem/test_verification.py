"""The problems of the verification study on coarse meshes, as fine as in its table where that takes longer; its report.

What it rests on, too: loads on bodies and surfaces, formulas, and ranges that a wrong answer does not pass.
"""

from __future__ import annotations

import doctest
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexdesign.fem.solving import port_compliance
from studies.verification import __main__ as command
from studies.verification import beams, elements, finding, hinges, large, loads, nafems, report
from studies.verification.finding import Finding, failures, range_around
from studies.verification.solids import CORK, METAL, Array, Bent, beam, lattice

#: Problems that take less than a second or two; elastica and parallelogram are tests of large displacements.
FAST: dict[str, Callable[[], list[Finding]]] = {
    "patch test": elements.patch_test,
    "rigid motions": elements.rigid_motions,
    "manufactured solution": elements.manufactured_solution,
    "reciprocity and scaling": elements.reciprocity_and_scaling,
    "LE1": lambda: nafems.elliptic_membrane((16, 24)),
    "FV32": lambda: nafems.tapered_membrane(16, 8),
    "cantilevers": lambda: beams.cantilevers(4),
    "circular hinge": lambda: hinges.circular_hinge((32, 8, 8, 1), (16, 6, 5, 4)),
    "leaf hinge": lambda: hinges.leaf_hinge((10, 3, 1), (6, 3, 3)),
}


@pytest.mark.parametrize("name", FAST)
def test_answers_lie_where_their_references_allow(name: str) -> None:
    assert failures(FAST[name]()) == []


@pytest.mark.slow
@pytest.mark.parametrize("group", command.PROBLEMS)
def test_answers_on_the_meshes_of_the_table(group: str) -> None:
    for problem in command.PROBLEMS[group]:
        assert failures(problem()) == []


@pytest.mark.slow
def test_stresses_of_nafems_come_nearer_on_finer_meshes() -> None:
    """LE1 halves its cells; LE10 has all three directions finer by four thirds."""
    for coarse, fine in (
        (nafems.elliptic_membrane((16, 24)), nafems.elliptic_membrane((32, 48))),
        (nafems.thick_plate((12, 18), 6), nafems.thick_plate((16, 24), 8)),
    ):
        assert abs(fine[0].found - fine[0].reference) < abs(coarse[0].found - coarse[0].reference)


def test_roots_of_a_leaf_are_found_from_below() -> None:
    """Elements are too stiff: what a root adds grows as they get smaller, by less and less, and keeps its bound."""
    added = [hinges.leaf_hinge((cells, 3, 1), (4, 2, 2))[1] for cells in (6, 9, 13)]
    steps = np.diff([row.found for row in added])
    assert 0 < steps[1] < steps[0]
    assert added[-1].found + steps[1] < added[-1].high


# --- references -----------------------------------------------------------------------------------------------------


def test_formulas_of_the_circular_hinge_have_the_published_numbers() -> None:
    """6486.3 and 6277.8 N mm/rad for R 2 mm, t 0.5 mm, b 10 mm, E 71 GPa: five digits."""
    assert hinges.euler_bernoulli() == pytest.approx(6.4863, abs=5e-5)
    assert hinges.paros_weisbord() == pytest.approx(6.2778, abs=5e-5)


def test_flamant_gives_the_root_its_bound() -> None:
    """-(288 / pi) of the mean of x s ln|x - s| over a unit interval for both, times E b t^2, over the leaf's 12.

    The inner integral in closed form: of s ln|x - s| over s it is F(x + 1/2) - F(x - 1/2) with r = x - s and
    F(r) = x r (ln|r| - 1) - r^2 (ln|r| / 2 - 1/4). The outer one by Gauss's rule of 400 points, which leaves 1e-6 of
    it where the logarithms bend at the ends.
    """

    def antiderivative(x: Array, r: Array) -> Array:
        return x * r * (np.log(np.abs(r)) - 1) - r**2 * (np.log(np.abs(r)) / 2 - 0.25)

    places, weights = np.polynomial.legendre.leggauss(400)
    x, w = places / 2, weights / 2
    inner = antiderivative(x, x + 0.5) - antiderivative(x, x - 0.5)
    assert -288 / np.pi * (w @ (x * inner)) / 12 == pytest.approx(3 / (2 * np.pi), rel=1e-6)


@pytest.mark.parametrize("module", [finding, hinges, large])
def test_examples_of_the_study(module: object) -> None:
    failed, tried = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)  # type: ignore[arg-type]
    assert tried > 0 and failed == 0


# --- loads ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def column() -> Bent:
    """An upright column of irregular elements, without lateral contraction, standing on z = 0."""
    x, y, z = np.linspace(0, 2e-3, 4), np.linspace(0, 3e-3, 4), np.linspace(0, 8e-3, 9)
    return Bent.of(lattice(x, y, z, wobble=1e-4), lambda place: place, CORK)


def test_a_column_shortens_under_its_weight(column: Bent) -> None:
    """u = -(w / E) (L z - z^2 / 2) under w per volume: quadratic, so that elements have it to rounding."""
    weight = 5e6
    load = loads.body_force(column.body, lambda x: np.broadcast_to([0.0, 0.0, -weight], x.shape))
    found = column.solve(column.free((column.side("z", 0.0), "xyz")), load)
    z = column.body.positions[:, 2]
    exact = -weight / CORK.youngs_modulus * (8e-3 * z - z**2 / 2)
    assert found[:, 2] == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())
    assert np.abs(found[:, :2]).max() < 1e-9 * np.abs(exact).max()


def test_pressure_all_round_squeezes_evenly(column: Bent) -> None:
    """p / 3K along every axis, K = E / 3 (1 - 2 nu); three walls only guide it."""
    body, p = replace(column, material=METAL), 3e6
    load = loads.pressure(body.body, body.body.mesh.facets, p)
    free = body.free(*((body.side(axis, 0.0), axis) for axis in "xyz"))
    shrunk = -p * (1 - 2 * METAL.poissons_ratio) / METAL.youngs_modulus * body.body.positions
    assert body.solve(free, load) == pytest.approx(shrunk, abs=1e-9 * np.abs(shrunk).max())
    assert np.abs(load.reshape(-1, 3).sum(axis=0)).max() < 1e-12 * np.abs(load).sum()


def test_pressure_buoys_up(column: Bent) -> None:
    """Archimedes: what a pressure that grows with depth exerts on all sides is the weight of what is displaced."""
    body, w = column.body, 9.81e3

    def pushing(outward: Array) -> loads.Field:
        return lambda x: -w * (1 - x[..., [2]]) * outward

    sides = [(axis, value) for axis, size in zip("xyz", (2e-3, 3e-3, 8e-3), strict=True) for value in (0.0, size)]
    total = np.zeros(3)
    for axis, value in sides:
        outward = (1.0 if value else -1.0) * np.eye(3)["xyz".index(axis)]
        force = loads.traction(body, column.facets(axis, value), pushing(outward))
        total += force.reshape(-1, 3).sum(axis=0)
    assert sum(len(column.facets(*side)) for side in sides) == len(body.mesh.facets)
    assert total == pytest.approx([0.0, 0.0, w * body.mesh.volume], abs=1e-12 * w * 1e-5)


def test_linear_traction_is_the_moment_of_a_port() -> None:
    """Two ways to the same nodal forces: a port's unit moment about z, and the stress -y / I of beam theory."""
    solid = beam(10e-3, 2e-3, 3e-3, (4, 3, 3), METAL, wobble=1e-4)
    body = solid.body
    unit = port_compliance.port_space(body, solid.domain, solid.ports).loads["output"][:, 5]
    inertia = 3e-3 * 2e-3**3 / 12
    facets = body.mesh.on_face(solid.domain.ports["output"])
    found = loads.traction(body, facets, lambda x: x[..., [1]] / inertia * np.array([-1.0, 0.0, 0.0]))
    assert found == pytest.approx(unit, abs=1e-12 * np.abs(unit).max())


# --- the table ------------------------------------------------------------------------------------------------------

ROW = Finding(
    "bar", "length", "analytic", "a ruler", 2.0, 2.01, "m", *range_around(2.0, 0.01), unknowns=30, note="rounding"
)


def test_a_number_outside_its_range_fails() -> None:
    low, high, wrong = replace(ROW, found=1.97), replace(ROW, found=2.03), replace(ROW, found=float("nan"))
    assert ROW.holds and not low.holds and not high.holds and not wrong.holds
    assert failures([ROW, high]) == ["bar, length: 2.03 m, not in 1.98 to 2.02"]


def test_allowed_ranges_in_words() -> None:
    assert report.range_text(ROW) == "± 1 %"
    assert report.range_text(replace(ROW, low=1.9, high=2.0)) == "-5 to +0 %"
    assert report.range_text(replace(ROW, reference=-2.0, found=-2.0, low=-2.0, high=-1.9)) == "-5 to +0 %"
    assert report.range_text(replace(ROW, reference=0.0, found=0.0, low=0.0, high=1e-10)) == "to 1e-10"


def test_the_command_writes_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "PROBLEMS", {"Elements": (elements.patch_test, lambda: [ROW])})
    assert command.main(["--out", str(tmp_path)]) == 0
    result = json.loads((tmp_path / "result.json").read_text())
    row = next(row for row in result["findings"] if row["problem"] == "bar")
    assert (row["reference"], row["found"], row["unit"], row["source"], row["holds"]) == (
        2.0,
        2.01,
        "m",
        "a ruler",
        True,
    )
    text = (tmp_path / "report.md").read_text()
    assert "2 of 2 numbers" in text and "| bar | length | a ruler | m | 2 | 2.01 | +0.5 % | ± 1 % |" in text
    assert "| bar | rounding | 30 | 0.0 s |" in text
    assert (tmp_path / "report.html").exists()
    assert str(tmp_path / "report.md") in capsys.readouterr().out


def test_the_command_says_what_is_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "PROBLEMS", {"Elements": (lambda: [replace(ROW, found=2.03)],)})
    assert command.main(["--out", str(tmp_path)]) == 1
    assert "bar, length: 2.03 m, not in 1.98 to 2.02" in capsys.readouterr().err
    assert "Outside: bar, length." in (tmp_path / "report.md").read_text()


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert command.main(["--out", str(tmp_path / "file")]) == 2
    assert "--out" in capsys.readouterr().err
