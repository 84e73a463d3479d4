"""The command line teaches, keeps stdout for answers, and ends as it should."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import flexdesign
from flexdesign.cli.shared import CATALOGUES, DESIGN, INSTALLATION, MEASUREMENTS, PUBLICATIONS, SIMULATION, app
from flexdesign.core.result_cache import Cache
from flexdesign.design.study import Study
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.report.document import Document, Figure, Section
from flexdesign.report.validation import validation_report
from flexdesign.workflows import validation

Run = Callable[..., Any]

RESULT = {"K_in": {"value": 1906.2, "unit": "N/mm"}, "title": "λ"}


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Study, Cache]]:
    """Replace the solution and its report by small ones; return what was asked."""
    asked: list[tuple[Study, Cache]] = []

    def validate(study: Study, cache: Cache, progress: Callable[[str], None]) -> Any:
        progress("meshing with 0.1 mm at the hinge roots")
        asked.append((study, cache))
        return SimpleNamespace(study=study, comparisons=(), further=(), levels=(), seconds=0.0, has_input=True,
                               stage_model=StageModel({}, source="made up"))  # fmt: skip

    def document(found: Any, progress: Callable[[str], None]) -> Document:
        progress("drawing")
        return Document(
            "An amplifier", ["It is stiff."], [Section("Figures", figures=[Figure("a.svg", b"<svg/>", "")])]
        )

    monkeypatch.setattr(validation, "validate", validate)
    monkeypatch.setattr(validation_report, "document", document)
    monkeypatch.setattr(validation_report, "result", lambda _: RESULT)
    return asked


# --- help ---------------------------------------------------------------------------------------------------------


def test_help_names_the_commands(command_line: Run) -> None:
    ended = command_line("--help")
    assert (ended.code, ended.stderr) == (0, "")
    assert "validate" in ended.stdout and "--version" in ended.stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shell_can_complete_verbs_and_options(shell: str) -> None:
    known = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}  # there may be no shell above
    asked = [sys.executable, "-m", "flexdesign", "--show-completion", shell]
    script = subprocess.run(asked, capture_output=True, text=True, check=True, env=known).stdout
    assert "COMPLETE" in script


@pytest.mark.parametrize(
    ("words", "completed"), [("flexdesign opt", "optimize"), ("flexdesign optimize --ou", "--out")]
)
def test_completions_are_the_verbs_and_options(words: str, completed: str) -> None:
    asked = {"_FLEXDESIGN_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    code = "import sys; sys.argv = ['flexdesign']; from flexdesign.cli import main; main()"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **asked})
    assert ended.stdout.split() == [completed]


@pytest.mark.parametrize("wraps", [True, False])
def test_nothing_is_cut_off_on_a_narrow_terminal(wraps: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    from rich.console import Console

    from flexdesign.report import terminal
    from flexdesign.report.document import Table

    heads = ["quantity", *(f"{'a' * 14}_model_{k} [N/mm]" for k in range(7))]
    table = Table(heads, [["a_very_long_name_of_a_quantity_of_a_stage", *(["12345.678 ± 0.123"] * 7)]])
    console = Console(width=80, no_color=True)
    with console.capture() as capture:
        console.print(terminal._render(table, wraps=wraps))
    text = capture.get()
    assert "…" not in text and text.count("12345.678") + text.count("12345.67") >= 7


def test_verbs_stand_in_the_order_of_the_work() -> None:
    known = [command.name or command.callback.__name__ for command in app.registered_commands if command.callback]
    asked = ["validate", "simulate", "import", "compare", "diagnose", "effects"]
    assert [verb for verb in known if verb in asked] == asked
    groups = dict.fromkeys(str(command.rich_help_panel) for command in app.registered_commands)
    assert list(groups) == [DESIGN, SIMULATION, MEASUREMENTS, PUBLICATIONS, CATALOGUES, INSTALLATION]


def test_every_verb_has_help_with_examples(command_line: Run) -> None:
    for command in app.registered_commands:
        assert command.callback is not None
        name = command.name or command.callback.__name__
        assert f"flexdesign {name}" in str(command.help), name


def test_without_arguments_it_shows_the_help(command_line: Run) -> None:
    ended = command_line()
    assert ended.code == 2
    assert "validate" in ended.stdout
    assert ended.stderr == ""


def test_help_teaches_by_examples(command_line: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERMINAL_WIDTH", "120")
    ended = command_line("validate", "-h")
    assert ended.code == 0
    for words in (
        "flexdesign validate bridge_amplifier",
        '--set dimensions.hinge_thickness="0.4 mm"',
        "--json > result.json",
        "resumes",
        "FLEXDESIGN_CACHE",
        *("--set", "--out", "--json", "--cache", "--export"),
    ):
        assert words in ended.stdout


def test_the_examples_of_the_help_can_be_read(command_line: Run, solved: list[tuple[Study, Cache]]) -> None:
    assert (
        command_line("validate", "bridge_amplifier", "--set", "dimensions.hinge_thickness=0.4 mm", "--json").code == 0
    )
    assert solved[0][0].design.dimensions["hinge_thickness"] == pytest.approx(0.4e-3)


def test_version(command_line: Run) -> None:
    ended = command_line("--version")
    assert (ended.code, ended.stdout, ended.stderr) == (0, f"flexdesign {flexdesign.__version__}\n", "")


@pytest.mark.parametrize("arguments", [("--nope",), ("nope",), ("validate", "--nope"), ("validate", "a", "b")])
def test_a_usage_error_ends_with_code_2(command_line: Run, arguments: tuple[str, ...]) -> None:
    ended = command_line(*arguments)
    assert (ended.code, ended.stdout) == (2, "")
    assert ended.stderr.startswith("flexdesign: ") and "--help" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


# --- a run --------------------------------------------------------------------------------------------------------


def test_json_has_stdout_to_itself(tmp_path: Path, command_line: Run, solved: list[tuple[Study, Cache]]) -> None:
    ended = command_line("validate", "bridge_amplifier", "--json", "--out", "report")
    assert ended.code == 0
    assert "meshing" in ended.stderr and "drawing" in ended.stderr
    written = (tmp_path / "report" / "result.json").read_text(encoding="utf-8")
    for result in (json.loads(ended.stdout), json.loads(written)):
        assert result.pop("inputs")["command"] == "validate"
        assert result == RESULT


def test_a_report_goes_to_a_folder_of_the_study_s_name(tmp_path: Path, command_line: Run, solved: list[Any]) -> None:
    assert command_line("validate", "bridge_amplifier", "--json").code == 0
    folder = tmp_path / "reports" / "bridge_amplifier"
    written = {path.name for path in folder.iterdir()}
    assert written == {"report.html", "report.md", "result.json", "stage_model.toml", "fem.csv", "a.svg"}


def test_options_reach_the_run(tmp_path: Path, command_line: Run, solved: list[tuple[Study, Cache]]) -> None:
    overrides = ("--set", "mesh.levels=2", "--set", 'dimensions.width="15 mm"')
    assert command_line("validate", "--json", *overrides, "--cache", "kept").code == 0
    assert command_line("validate", "--json").code == 0
    (first, chosen), (second, default) = solved
    assert first.mesh.levels == 2
    assert first.design.dimensions["width"] == pytest.approx(15e-3)
    assert second.mesh.levels == 3
    assert (chosen.folder, default.folder) == (Path("kept"), tmp_path / "cache")


def test_an_interrupted_run_says_that_it_resumes(
    tmp_path: Path, command_line: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(validation, "validate", interrupted)
    ended = command_line("validate", "--json", "--out", "report")
    assert (ended.code, ended.stdout) == (130, "")
    assert "the same command resumes" in ended.stderr
    assert not (tmp_path / "report").exists()


def test_a_mistake_of_the_program_is_not_hidden(command_line: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def mistaken(*_: object) -> None:
        raise AssertionError("a bug")

    monkeypatch.setattr(validation, "validate", mistaken)
    with pytest.raises(AssertionError, match="a bug"):
        command_line("validate", "--json")
