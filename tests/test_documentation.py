"""Code blocks, links, commands, paths and terms of README, docs/, CONTRIBUTING.md and CHANGELOG.md."""

from __future__ import annotations

import ast
import doctest
import importlib.util
import re
import shlex
import tokenize
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from flexdesign import cli

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if "generated" not in page.parts]  # made from the code by `make docs`
PYTHON = ROOT / "docs" / "python.md"
#: How a block says that it takes more than some seconds.
SLOW = ">>> # takes"
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def names(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def blocks(page: Path, language: str) -> list[str]:
    """Return the code blocks of a page in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder with the inputs of the checkout, in which everything may be written."""
    for name in ("geometry", "studies"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FLEXDESIGN_CACHE", str(tmp_path / "cache"))


def run_examples(sources: list[str]) -> None:
    """Run doctest blocks of a page one after the other in one namespace, and check what they print."""
    runner = doctest.DocTestRunner(optionflags=FLAGS, verbose=False)
    text = "\n".join(sources)
    examples = doctest.DocTestParser().get_doctest(text, {"__name__": "examples"}, PYTHON.name, str(PYTHON), 0)
    printed: list[str] = []
    result = runner.run(examples, out=printed.append)
    assert result.attempted >= len(sources)
    assert result.failed == 0, "".join(printed)


# --- code blocks ----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("checkout")
def test_quick_examples_of_the_python_page_run() -> None:
    run_examples([block for block in blocks(PYTHON, "python") if not block.startswith(SLOW)])


@pytest.mark.slow
@pytest.mark.usefixtures("checkout")
def test_all_examples_of_the_python_page_run() -> None:
    run_examples(blocks(PYTHON, "python"))


@pytest.mark.slow
@pytest.mark.usefixtures("checkout")
@pytest.mark.parametrize("page", [page for page in PAGES if page != PYTHON and blocks(page, "python")], ids=names)
def test_python_blocks_run(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each block is a script of its own; the tests that it defines are called."""
    for block in blocks(page, "python"):
        namespace: dict[str, object] = {"__name__": "block"}
        exec(compile(block, page.name, "exec"), namespace)
        for name, test in namespace.items():
            if name.startswith("test_") and callable(test):
                test()
    if page.name == "README.md":
        assert "Missing: stress stiffening." in capsys.readouterr().out


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_names_in_python_blocks_exist(page: Path) -> None:
    """A quick check of the slow blocks: what they take from the package is there."""
    import flexdesign

    offered = set(flexdesign.__all__)
    for block in blocks(page, "python"):
        assert set(re.findall(r"\bfd\.(\w+)", block)) <= offered
        for line in re.findall(r"from flexdesign import ([\w, ]+)", block):
            assert {name.strip() for name in line.split(",")} <= offered
    assert page != PYTHON or len(set(re.findall(r"fd\.(\w+)", page.read_text(encoding="utf-8")))) >= 15


# --- commands, links and paths ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_commands_exist(page: Path) -> None:
    known = {command.name or command.callback.__name__ for command in cli.app.registered_commands if command.callback}
    known |= {str(group.name) for group in cli.app.registered_groups}
    text = page.read_text(encoding="utf-8")
    shown = {verb for block in blocks(page, "sh") for verb in re.findall(r"^flexdesign (\w+)", block, re.M)}
    shown |= set(re.findall(r"`flexdesign ([a-z]+)", text))
    assert shown <= known
    assert page.name != "README.md" or shown | set(re.findall(r"`(\w+)`", text)) >= known


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_commands_have_arguments_that_are_accepted(page: Path) -> None:
    """Names and numbers of options and arguments, by the parser itself; files of the examples need not exist."""
    group: Any = typer.main.get_command(cli.app)
    for block in blocks(page, "sh"):
        for line in re.findall(r"^flexdesign (.*)", block.replace("\\\n", " "), re.M):
            if re.search(r"[|<>…]|\.\.\.|--help", line):  # a pipe, words in place of something, an end
                continue
            verb, *given = shlex.split(line, comments=True)
            if verb in group.commands and "commands" not in vars(group.commands[verb]):
                group.commands[verb].make_context(verb, given, resilient_parsing=False)


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\((?!http)([^)]+)\)", page.read_text(encoding="utf-8")):
        if "generated/" in link:  # pages that `make docs` makes, and looks for; a clone lacks them
            assert "`make docs`" in page.read_text(encoding="utf-8"), link
            continue
        file, _, anchor = link.partition("#")
        target = (page.parent / file) if file else page
        assert target.exists(), link
        if anchor:
            heads = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.M)
            anchors = {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}
            assert anchor in anchors, link


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_make_targets_exist(page: Path) -> None:
    makefile = (ROOT / "Makefile").read_text()
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"(?:`|^)make ([a-z-]+)", text, re.M):
        assert re.search(rf"^{target}:", makefile, re.M), target


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_modules_that_are_run_exist(page: Path) -> None:
    for module in re.findall(r"python -m ([\w.]+)", page.read_text(encoding="utf-8")):
        assert importlib.util.find_spec(module), module


#: Files of a user, made up for an example, and folders that commands write.
MADE_UP = re.compile(r"my_|reports/(?!examples)|commands/|cases/|recordings/|axis\.|K_out")


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_paths_exist(page: Path) -> None:
    """A path in backquotes is one of the repository, or of flexdesign/ where it begins with a package."""
    for path in re.findall(r"`((?:[\w.-]+/)+[\w.-]*)`", page.read_text(encoding="utf-8")):
        if not MADE_UP.search(path):
            assert (ROOT / path).exists() or (ROOT / "flexdesign" / path).exists(), path


@pytest.mark.parametrize("folder", ["flexdesign", "geometry", "studies"])
def test_pages_that_code_names_exist(folder: str) -> None:
    files = [file for ending in ("py", "toml") for file in (ROOT / folder).rglob(f"*.{ending}")]
    named = {page for file in files for page in re.findall(r"docs/[\w/]+\.md", file.read_text(encoding="utf-8"))}
    assert [page for page in sorted(named) if not (ROOT / page).is_file()] == []


def test_the_glossary_is_a_glossary() -> None:
    """Each line has a term, a definition, and where it is in the code, as a path that `test_paths_exist` looks up."""
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").partition("## Old names")[0]
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")][1:]
    assert len(rows) >= 40
    terms = [row[0] for row in rows]
    assert terms == sorted(terms, key=str.lower) and len(set(terms)) == len(terms)
    for row in rows:
        assert len(row) == 3 and row[1] and re.search(r"`[\w./]+`", row[2]), row


# --- README and dependencies ------------------------------------------------------------------------------------------


def test_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 90
    first = "\n".join(text.splitlines()[:50])
    (code,) = re.findall(r"```python\n(.*?)```", first, re.S)
    assert len([line for line in code.splitlines() if line]) <= 5
    assert "![" in first and "make demo" in first and "make test" in first and "docs/" in text


def test_every_page_is_reached_from_the_first() -> None:
    """`make docs` fails at a page outside of the table of contents; this is the quick check, and README's."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "docs/index.md" in text and "docs/tutorial.md" in text
    listed = {"index"}
    for page in [each for each in PAGES if each.is_relative_to(ROOT / "docs")]:
        folder = page.parent.relative_to(ROOT / "docs")
        for block in blocks(page, r"\{toctree\}"):
            names_ = [line for line in block.splitlines() if line and not line.startswith(":")]
            listed |= {(folder / name).as_posix() for name in names_}
    assert {page.relative_to(ROOT / "docs").with_suffix("").as_posix() for page in PAGES[3:]} - listed == set()


def test_every_dependency_has_its_reason() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    groups = project["dependency-groups"]
    stated = [*project["project"]["dependencies"], *(each for some in extras.values() for each in some)]
    stated += [each for some in groups.values() for each in some]
    wanted = {re.match(r"[\w.-]+", each)[0] for each in stated}  # type: ignore[index]
    section = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Dependencies")[2]
    listed = {name.strip() for row in re.findall(r"^\| ([^|]+) \|", section, re.M) for name in row.split(",")}
    assert wanted <= listed, wanted - listed
    heads = {name.strip("*") for name in listed if name.startswith("**")}
    assert listed - wanted <= {"package", *(f"**{head}**" for head in heads)}


# --- plain English ----------------------------------------------------------------------------------------------------

#: Words of a private dialect, and the field's words in their place.
PRIVATE = {
    r"\bbeside\b": "next to, compared with, in addition to",
    r"\bso many\b": "a number",
    r"\btold\b": "stated, distinguished",
    r"\bno fit has seen\b": "validation runs",
    r"\bkept apart\b": "validation runs",
    r"\bslopes\b": "Jacobian",
    r"\bbeginnings\b": "initial conditions, starting points",
    r"\bwhat is left\b": "residual",
    r"\bleaves? more than noise\b": "the residual exceeds the noise",
    r"\bmore than noise\b": "the residual exceeds the noise",
    r"\bwhat was known\b": "prior",
    r"\bfree numbers\b": "free parameters",
    r"\bhangs? on\b": "depends on",
    r"\banswers? the actuator\b": "actuator participation",
    r"\bshak(?:es|en) along\b": "participating mass",
    r"\bdear\b": "expensive",
    r"\b[Ww]ild mesh": "unstructured mesh",
    r"\bcome free\b|\bis caught\b|\bare caught\b": "escapes local minima",
    r"\bearns its place\b": "is accepted",
    r"\blook-?alikes?\b": "confounded effects",
}


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_pages_use_the_words_of_the_field(page: Path) -> None:
    assert not private_words(page.read_text(encoding="utf-8").partition("## Old names")[0])


def test_help_uses_the_words_of_the_field() -> None:
    for command in cli.app.registered_commands:
        assert not private_words(str(command.help)), command.callback


def private_words(text: str) -> set[str]:
    """Return the patterns of private words that a text has; line breaks count as spaces."""
    flat = " ".join(text.split())
    return {word for word in PRIVATE if re.search(word, flat, re.IGNORECASE)}


def texts_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of every comment block, and of every string of more than one word.

    A lone word in quotes is a key of a file, and names in braces of an f-string are code.
    """
    block, last = "", -1
    with tokenize.open(path) as file:
        for token in tokenize.generate_tokens(file.readline):
            if token.type == tokenize.COMMENT:
                if token.start[0] != last + 1:
                    yield last, block
                    block = ""
                block, last = f"{block} {token.string.lstrip('#: ')}", token.start[0]
    yield last, block
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
            yield node.lineno, node.value


@pytest.mark.parametrize("folder", ["flexdesign", "studies", "geometry"])
def test_code_uses_the_words_of_the_field(folder: str) -> None:
    found = {
        f"{names(path)}:{line}": words
        for path in sorted((ROOT / folder).rglob("*.py"))
        for line, text in texts_of(path)
        if (words := private_words(text))
    }
    assert not found


@pytest.mark.parametrize("page", sorted((ROOT / "reports" / "examples").glob("*/report.md")), ids=names)
def test_kept_reports_use_the_words_of_the_field(page: Path) -> None:
    assert not private_words(page.read_text(encoding="utf-8"))


def test_private_words_are_found(tmp_path: Path) -> None:
    """In a comment over two lines, a docstring and an f-string; not in a key or a name."""
    file = tmp_path / "module.py"
    file.write_text('"""Beside it."""\n# Then what\n# is left\nkey = {"beside": 1}\ntext = f"{key} was told"\n')
    found = {word for _, text in texts_of(file) for word in private_words(text)}
    assert found == {r"\bbeside\b", r"\bwhat is left\b", r"\btold\b"}
