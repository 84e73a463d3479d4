"""Tutorial, how-to pages and the first half hour of CONTRIBUTING do what they say: every block runs, in its order.

A block of ``sh`` runs in bash and must end well. A block ``LANGUAGE file=NAME`` is written to that file. A block of
``python`` runs as a script. A block of ``bash`` is for other machines, and does not run. A block of ``text`` behind a
block of ``sh`` is what that printed, with ``...`` for more.
"""

from __future__ import annotations

import doctest
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
#: Pages that take seconds run with every test; the others mesh or diagnose.
QUICK = [DOCS / "how_to" / "my_recordings.md"]
SLOW = [page for page in [DOCS / "tutorial.md", *sorted((DOCS / "how_to").glob("*.md"))] if page not in QUICK]
#: A block: language, file name or nothing, content.
BLOCK = re.compile(r"^```(\w+)(?: file=(\S+))?\n(.*?)^```", re.M | re.S)


def blocks(page: Path, section: str = "") -> list[tuple[str, str, str]]:
    """Return language, file and content of the blocks of a page, or of one of its sections."""
    text = page.read_text(encoding="utf-8")
    if section:
        _, _, text = text.partition(f"\n## {section}\n")
        text = text.partition("\n## ")[0]
    return [(language, file, content) for language, file, content in BLOCK.findall(text)]


def follow(page: Path, folder: Path, section: str = "") -> None:
    """Do what a page says, or one of its sections, in a folder."""
    commands = folder / "bin"
    commands.mkdir()
    for name, started in (("flexdesign", "-m flexdesign"), ("python", "")):
        (commands / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {started} "$@"\n')
        (commands / name).chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{commands}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "FLEXDESIGN_CACHE": str(folder / "cache"),
        "COLUMNS": "80",
    }
    printed, at = "", folder

    def run(*command: str) -> str:
        done = subprocess.run(command, cwd=at, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, f"{page.name}: {command[-1]}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    found = blocks(page, section)
    assert found, section
    for language, file, content in found:
        if file:
            (at / file).write_text(content, encoding="utf-8")
        elif language == "python":
            run(sys.executable, "-c", content)
        elif language == "sh":
            printed = run("bash", "-euc", f"{content}\npwd > {folder}/where")
            at = Path((folder / "where").read_text().strip())
        elif language == "text" and printed:
            shown = doctest.OutputChecker()
            assert shown.check_output(f"...{content}", f"\n{printed}", doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
            printed = ""


@pytest.mark.parametrize("page", QUICK, ids=lambda page: page.stem)
def test_quick_pages_do_what_they_say(page: Path, tmp_path: Path) -> None:
    follow(page, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("page", SLOW, ids=lambda page: page.stem)
def test_pages_do_what_they_say(page: Path, tmp_path: Path) -> None:
    for name in ("geometry", "studies"):
        (tmp_path / name).symlink_to(ROOT / name)
    follow(page, tmp_path)


@pytest.mark.slow
def test_the_first_half_hour_of_a_contributor(tmp_path: Path) -> None:
    """An effect, a mechanism and a recording are added, each with a test of its own."""
    follow(ROOT / "CONTRIBUTING.md", tmp_path, "The first half hour")


def test_a_wrong_page_fails(tmp_path: Path) -> None:
    page = tmp_path / "wrong.md"
    page.write_text("```sh\necho one\n```\n\n```text\ntwo\n```\n")
    with pytest.raises(AssertionError):
        follow(page, tmp_path)
    shutil.rmtree(tmp_path / "bin")
    page.write_text("```sh\nfalse\n```\n")
    with pytest.raises(AssertionError, match=r"wrong\.md: false"):
        follow(page, tmp_path)


# --- the equations of the paper ---------------------------------------------------------------------------------------


def test_every_equation_has_its_function_and_its_test() -> None:
    """Of the 34 numbered equations none is missing; functions and tests are where the page says."""
    text = (DOCS / "reference" / "equations.md").read_text(encoding="utf-8")
    row = r"^\| ([^|]+) \| [^|]+ \| \[`([\w.]+)`\]\(([^)]+)\) \| \[`(\w+)`\]\(([^)]+)\) \|$"
    rows = re.findall(row, text, re.M)
    assert [int(n) for numbers, *_ in rows for n in re.findall(r"\d+", numbers)] == list(range(1, 35))
    for _, function, module, test, file in rows:
        for name, path in ((function.rpartition(".")[2], module), (test, file)):
            source = (DOCS / "reference" / path).read_text(encoding="utf-8")
            assert re.search(rf"^ *(?:def|class) {name}\b", source, re.M), (name, path)
