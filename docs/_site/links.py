"""Links that leave docs/ work on the site, without a network: to kept reports, and to files of the repository.

On a code host ``[answer](../studies/hidden_effect_demo/answer.toml)`` shows the file. On the site it leads to a page
that shows the file too. Reports of ``reports/examples`` are pages already: they are copied as they are.
"""

from __future__ import annotations

import html
import posixpath
import re
import shutil
from pathlib import Path
from typing import Any

from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import get_lexer_for_filename
from pygments.util import ClassNotFound

ROOT = Path(__file__).resolve().parent.parent.parent
#: Files of the repository that are pages of the site as well.
PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md", "README.md": "index.md"}
#: Of these, the pages that have no text of their own.
TAKEN = {"contributing": ROOT / "CONTRIBUTING.md", "changelog": ROOT / "CHANGELOG.md"}
#: A link, not an image, with a relative target.
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(((?!\w+:|#)[^)\s]+)\)")
#: Files of the repository that a page links to, and their pages.
linked: dict[str, str] = {}
#: Files that are longer are shown to this many letters.
SHOWN = 200_000


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("source-read", rewrite)
    app.connect("build-finished", copy)
    return {"parallel_read_safe": False}  # what is linked is collected in one process


def rewrite(app: Any, docname: str, source: list[str]) -> None:
    """Replace the links of a page that leave docs/."""
    at = Path(app.env.doc2path(docname))
    written = TAKEN.get(docname, at)
    if docname in TAKEN:
        app.env.note_dependency(written)
        source[0] = written.read_text(encoding="utf-8")
    if docname.startswith("generated/"):
        return
    source[0] = LINK.sub(lambda found: _link(Path(app.srcdir).resolve(), written, at, found), source[0])


def _link(source: Path, written: Path, at: Path, found: re.Match[str]) -> str:
    """Return a link of the file `written`, which is the page `at` of the site."""
    text, target = found.groups()
    file, _, anchor = target.partition("#")
    path = (written.parent / file).resolve() if file else at
    if not path.is_relative_to(ROOT) or not path.exists():
        return found[0]  # Sphinx says what is wrong
    tail = f"#{anchor}" if anchor else ""
    inside = path.relative_to(ROOT).as_posix()
    if inside in PAGES:
        path = source / PAGES[inside]
    if path.is_relative_to(source):
        return f"[{text}]({posixpath.relpath(path, at.parent)}{tail})"
    if inside.startswith("reports/examples/"):
        name = f"{inside.removesuffix('/report.md').removesuffix('/')}/report.html"
    else:
        name = f"files/{inside.rstrip('/')}.html"
        linked[inside] = name
    up = "../" * len(at.relative_to(source).parent.parts)
    return f'<a class="reference external" href="{up}{name}">{text}</a>'


def copy(app: Any, error: Exception | None) -> None:
    """Copy the kept reports, and write a page for each file of the repository that a page links to."""
    if error or app.builder.format != "html":
        return
    out = Path(app.outdir)
    for report in (ROOT / "reports" / "examples").glob("*/report.html"):
        to = out / "reports" / "examples" / report.parent.name
        to.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(report, to / report.name)
    for inside, name in linked.items():
        to = out / name
        to.parent.mkdir(parents=True, exist_ok=True)
        to.write_text(_page(ROOT / inside, inside), encoding="utf-8")


def _page(path: Path, title: str) -> str:
    """Return a page that shows a file, or lists a folder."""
    if path.is_dir():
        names = (f"{each.name}{'/' if each.is_dir() else ''}" for each in sorted(path.iterdir()))
        rows = "\n".join(f"<li><code>{html.escape(name)}</code></li>" for name in names if not name.startswith("_"))
        return f"<!doctype html><meta charset='utf-8'><title>{title}</title><h1>{title}</h1><ul>{rows}</ul>"
    text = path.read_text(encoding="utf-8", errors="replace")[:SHOWN]
    try:
        lexer = get_lexer_for_filename(path.name)
    except ClassNotFound:
        lexer = get_lexer_for_filename("x.txt")
    return highlight(text, lexer, HtmlFormatter(full=True, title=title, linenos="inline"))
