"""The benchmark of peers: what it makes them solve, which of their runs count, and that it finds our own answer."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from flexdesign.design import design
from flexdesign.fem.meshing import domain
from studies.benchmarks import fem_peer_case, fem_peer_flexdesign, fem_peers
from studies.benchmarks.fem_peer_case import Case, PeerResult
from studies.benchmarks.fem_peers import Entry, Run
from tests.reference.hexahedra import RECORD

NAMES = ("bridge_amplifier", "lin2019_amplifier_xy")


def case_of(name: str) -> Case:
    return Case.of(design.read(design.find(name)))


@pytest.mark.parametrize("name", NAMES)
def test_peers_solve_the_same_body(name: str) -> None:
    """The outline has the area of the CAD solid's quarter, and as many re-entrant corners as hinges have roots."""
    case, part = case_of(name), design.read(design.find(name)).part()
    x, y = np.array(case.outline).T
    area = abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
    body = domain.of_part(part, chord=domain.chord(part))
    assert body.copies == 4
    assert area * case.depth == pytest.approx(body.volume * 1e9, rel=1e-9)
    assert len(case.roots) >= 4 * 4  # each of four hinges of this half has two roots at either end


def test_our_own_entry_answers_the_question_of_the_others() -> None:
    """Graded hexahedra, which share no code with it, say so to 0.1 %; two meshes and their limit to 0.5 %."""
    kept = tomllib.loads(RECORD.read_text(encoding="utf-8"))["bridge_amplifier"]["K_in_output_free"]
    found = fem_peer_flexdesign.solve(case_of("bridge_amplifier"), [2.2, 1.5])
    assert found.stiffness == pytest.approx(1e-3 * kept["value"], rel=5e-3)
    assert found.unknowns > 10_000 and found.mesh > 0 and found.solve > 0


def entry(program: str, wall: float, cpu: float, error: float) -> Entry:
    answer = PeerResult(1000 * (1 + error), 1000, 0.2 * wall, 0.5 * wall)
    return Entry(program, {"size": cpu}, Run({}, wall, cpu, 2**28), answer, error)


def test_the_cheapest_run_of_each_program_that_is_good_enough_counts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    entries = [
        entry("flexdesign", 2.0, 3.0, 0.02),
        entry("flexdesign", 4.0, 6.0, -0.009),
        entry("flexdesign", 9.0, 12.0, 0.001),
        entry("NGSolve", 6.0, 10.0, 0.009),
        entry("gmsh + scikit-fem", 5.0, 9.0, 0.05),
    ]
    again: list[tuple[str, Mapping[str, Any]]] = []

    def tried(program: str, case: Case, settings: Mapping[str, Any], truth: float) -> Entry:
        again.append((program, settings))
        return next(e for e in entries if e.program == program and e.settings == settings)

    monkeypatch.setattr(fem_peers, "run_program", tried)
    fem_peers.at(0.01, entries, case_of("bridge_amplifier"), 1000.0)
    said = capsys.readouterr().out
    assert again == [("flexdesign", {"size": 6.0}), ("NGSolve", {"size": 10.0})]
    assert "the best peer, NGSolve, takes 1.5 times as long as flexdesign" in said
    assert "gmsh + scikit-fem  reaches it with none of its settings" in said
    assert "-0.90 %    4.0 s   1.2 s   0.8 s   2.0 s    6.0 s   256 MB" in said


def test_a_case_travels_to_another_process_as_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What `tried` hands over, `serve` reads."""
    case, seen = case_of("bridge_amplifier"), []

    def solve(case: Case, coarseness: list[float]) -> PeerResult:
        seen.append((case, coarseness))
        return PeerResult(1950.0, 10, 0.1, 0.2)

    table = json.dumps({**asdict(case), "outline": list(case.outline)})
    monkeypatch.setattr("sys.argv", ["peer", table, json.dumps({"coarseness": [1.5]})])
    fem_peer_case.serve(solve)
    assert seen == [(case, [1.5])]
    assert json.loads(capsys.readouterr().out) == {"stiffness": 1950.0, "unknowns": 10, "mesh": 0.1, "solve": 0.2}


def test_a_run_that_fails_is_told_by_its_last_words() -> None:
    with pytest.raises(fem_peers.Failed, match=r"list index out of range|not enough values"):
        fem_peers.run(fem_peer_flexdesign)  # without a case
