"""The catalogue of effects: a page for each, with its parameters and the picture of its signature."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

from flexdesign import effects
from flexdesign.cli import effects as command
from flexdesign.design import design as designs
from flexdesign.effects import statics
from flexdesign.report.catalogue import effect_pages, static_effect_pages
from flexdesign.report.document import Document, Table

INTRODUCTION = """Each page is made from the file of the effect at every build. `flexdesign effects NAME` prints it,
also for an [effect of your own](../../contributing.md). The picture shows the response of the stage of Lin et al.
(2019) with and without the effect, at a strength that changes the reading by 1 % of the stroke. A static effect is
shown by its change of the stiffnesses of an amplifier, or of the stage."""


def pages() -> Iterator[tuple[str, str | bytes]]:
    """Yield one page for each effect with its pictures, and the page that lists them."""
    moving = list(effects.names())
    at_rest = [name for name in statics.names() if name not in moving]
    with ProcessPoolExecutor(os.cpu_count()) as pool:  # a simulation of every effect: a minute of one processor
        for made in pool.map(_moving, moving):
            yield from made
    for name in at_rest:
        shown_on = command.WHOLE if name in statics.OF_STAGES else command.DESIGN
        yield from _page(static_effect_pages.document(name, designs.read(designs.find(shown_on), [])))
    rows = [[f"[{name}]({name}.md)", *words] for name, *words in effect_pages.catalogue().rows]
    table = Table(["effect", "where it acts", "what reveals it"], rows)
    contents = ["```{toctree}", ":hidden:", "", *moving, *at_rest, "```"]
    yield "effects/index.md", "\n".join(["# Effects", "", INTRODUCTION, "", *_table(table), "", *contents, ""])


def _moving(name: str) -> list[tuple[str, str | bytes]]:
    """Return the page of an effect on a moving stage, simulated; without the picture in a quick build.

    One picture is drawn, of the experiment that comes first; `flexdesign effects NAME` draws one of each kind.
    """
    if os.environ.get("FLEXDESIGN_DOCS_QUICK"):
        return list(_page(effect_pages.document(name, None)))
    signature, on = command._signature(name, command.STAGE, None, [])
    return list(_page(effect_pages.document(name, signature, on, drawn=1)))


def _page(document: Document) -> Iterator[tuple[str, str | bytes]]:
    name = document.title
    lines = [f"# {name}", ""]
    for paragraph in document.summary:
        lines += [paragraph, ""]
    for section in document.sections:
        lines += [f"## {section.title}", ""]
        for paragraph in section.paragraphs:
            lines += [paragraph, ""]
        for table in section.tables:
            lines += [*_table(table), ""]
            if table.caption:
                lines += [f"*{table.caption}*", ""]
        for figure in section.figures:
            yield f"effects/{name}/{figure.file}", figure.data
            lines += [f"![{_plain(figure.caption)}]({name}/{figure.file})", "", f"*{figure.caption}*", ""]
    yield f"effects/{name}.md", "\n".join(lines)


def _table(table: Table) -> list[str]:
    lines = [f"| {' | '.join(table.columns)} |", f"|{'---|' * len(table.columns)}"]
    return lines + [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |" for row in table.rows]


def _plain(text: str) -> str:
    return text.replace("[", "(").replace("]", ")")
