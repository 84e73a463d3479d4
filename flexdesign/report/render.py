"""A document as HTML that opens offline, as Markdown, and as files in a folder, all of them or none."""

from __future__ import annotations

import base64
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from jinja2 import Environment, PackageLoader, select_autoescape

from flexdesign.core import units
from flexdesign.core.errors import InputError
from flexdesign.core.serialise import to_json
from flexdesign.core.versions import __version__
from flexdesign.core.whole_files import written_whole
from flexdesign.report import origin
from flexdesign.report.document import Document, Figure

#: What shows each kind of live picture.
SCRIPTS = {"traces": ("uplot.min.js", "traces.js"), "view": ("three.min.js", "view.js")}
#: Bytes of all curves of a page, about; bytes of a point; the least and most points of a curve.
CURVES_BYTES, BYTES, POINTS = 2e6, 5.0, (1000, 20000)


@dataclass(frozen=True)
class ReportFacts:
    """When and how a report was made, and which files lie next to it.

    Parameters
    ----------
    date, command, version
        When, by which command line, by which version.
    files
        Names of files next to the report, pictures left out.
    """

    date: str
    command: str
    version: str
    files: Sequence[str] = ()


def to_html(document: Document, made: ReportFacts | None = None) -> str:
    """Return one self-contained page, readable in light and dark."""
    live = [figure.live for figure in document.figures if figure.live is not None]
    kinds = {each.kind for each in live}
    curves = sum(each.curves for each in live)
    points = int(np.clip(CURVES_BYTES / (BYTES * max(curves, 1)), *POINTS))
    return (
        _environment(_typeset)
        .get_template("report.html")
        .render(
            document=document,
            body=document.body,
            embed=_embed,
            made=made,
            link=quote,
            asset=asset,
            kinds=kinds,
            scripts=[name for kind in sorted(kinds) for name in SCRIPTS[kind]] + ["page.js"],
            payload=lambda figure: _in_script(figure.live.payload(points)),
        )
    )


@cache
def asset(name: str) -> str:
    """Return a style or script of a page, as it stands in the package."""
    return resources.files("flexdesign.report").joinpath("assets", name).read_text(encoding="utf-8")


def _in_script(data: Mapping[str, Any]) -> str:
    """Return data as JSON that ends no script element."""
    return json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def to_markdown(document: Document, made: ReportFacts | None = None) -> str:
    """Return Markdown with tables, figures linked by file name."""
    return _environment().get_template("report.md").render(document=document, made=made, link=quote)


def prepare(folder: Path) -> None:
    """Check that the folder can be made and written to, before long work begins; leaves nothing behind.

    Raises
    ------
    InputError
        If it cannot.
    """
    try:
        made = [place for place in (folder, *folder.parents) if not place.exists()]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        finally:
            for place in made:
                if place.is_dir():
                    place.rmdir()
    except OSError as error:
        raise _refusal(folder, error) from error


def write(
    folder: Path,
    document: Document,
    result: Mapping[str, Any],
    others: Mapping[str, str | bytes],
    links: Sequence[str] = (),
) -> list[Path]:
    """Write report.html, report.md, result.json, the figures and other files.

    The report has the date, the command line and links to the other files; `links` are more files in the folder.
    Everything is written next to its place first and moved there at the end, so that a failure leaves what was there.

    Raises
    ------
    InputError
        If the folder cannot be written or the disk is full.
    """
    contents: dict[str, bytes] = {figure.file: figure.data for figure in document.figures}
    contents |= {name: data.encode() if isinstance(data, str) else data for name, data in others.items()}
    made = ReportFacts(origin.date(), origin.command(), __version__, [*others, "result.json", *links])
    contents["report.md"] = to_markdown(document, made).encode()
    contents["report.html"] = to_html(document, made).encode()
    contents["result.json"] = (
        json.dumps(to_json(result), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    ).encode()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with written_whole(folder) as scratch:
            for name, data in contents.items():
                (scratch / name).write_bytes(data)
    except OSError as error:
        raise _refusal(folder, error) from error
    return [folder / name for name in contents]


def _refusal(folder: Path, error: OSError) -> InputError:
    why = "it is a file" if isinstance(error, FileExistsError) else error.strerror or error
    return InputError("command line", "--out", str(folder), f"cannot be written ({why}); choose another folder")


def _embed(figure: Figure) -> str:
    kind = "image/svg+xml" if figure.file.endswith(".svg") else "image/png"
    return f"data:{kind};base64,{base64.b64encode(figure.data).decode()}"


def _typeset(value: Any) -> Any:
    """Write the units of a text with the Greek letter for micro; what is marked as safe stays."""
    return units.typeset(value) if isinstance(value, str) and not hasattr(value, "__html__") else value


def _environment(finalize: Callable[[Any], Any] | None = None) -> Environment:
    return Environment(
        finalize=finalize,
        loader=PackageLoader("flexdesign.report"),
        autoescape=select_autoescape(["html"]),
        trim_blocks=True,
        lstrip_blocks=True,
    )
