"""The performance table: what a row says, and which entry of a program counts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from studies.benchmarks import __main__ as table
from studies.benchmarks import installation
from studies.benchmarks.fem_peer_case import PeerResult
from studies.benchmarks.fem_peers import Entry, Run, cheapest


def entry(program: str, error: float, cpu: float) -> Entry:
    return Entry(program, {}, Run({}, 1.0, cpu, 0), PeerResult(1.0, 1, 0.0, 0.0), error)


def test_of_each_program_the_cheapest_that_is_right_counts() -> None:
    entries = [entry("a", 0.02, 1.0), entry("a", -0.009, 3.0), entry("a", 0.001, 5.0), entry("b", 0.05, 0.1)]
    assert {name: each.run.cpu for name, each in cheapest(0.01, entries).items()} == {"a": 3.0}


def test_rows_are_printed_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [table.Row("task", "1 %", "peer", 2.0, 492.0)]
    monkeypatch.setattr(table, "TASKS", {"one": lambda: iter(rows)})
    assert table.main(["--out", str(tmp_path)]) == 0
    assert "task | 1 % | peer | 2.0 s | 250\n" in capsys.readouterr().out
    found: dict[str, Any] = json.loads((tmp_path / "result.json").read_text())
    assert found["rows"][0]["ratio"] == 246.0 and "numpy" in found["versions"]


def test_a_kept_result_is_reported_again(tmp_path: Path) -> None:
    rows = [{"task": "a", "equal": "1 %", "peer": "p", "own": 2.0, "other": 1.0, "ratio": 0.5}]
    rows.append({**rows[0], "task": "b", "other": 300.0, "ratio": 150.0})
    (tmp_path / "kept.json").write_text(json.dumps({"rows": rows, "processors": 3, "load": 0.4}))
    assert table.main(["--result", str(tmp_path / "kept.json"), "--out", str(tmp_path / "out")]) == 0
    report = (tmp_path / "out" / "report.md").read_text()
    assert "Peers take 0.5 to 150 times the processor time of flexdesign; more in 1 of 2 comparisons." in report
    assert "3 processors" in report and "| b | 1 % | p | 2.0 s | 150 |" in report


def test_an_unknown_task_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        table.main(["flying"])
    assert "flying is none of finite_elements, sweep" in capsys.readouterr().err


def test_room_is_counted_without_pip_and_apart_from_bytecode(tmp_path: Path) -> None:
    for name, size in {"one/a.py": 100, "one/__pycache__/a.pyc": 40, "b.so": 7, "pip/c.py": 1000}.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(size))
    assert installation.sizes(tmp_path) == (107, 40)
