"""Pages of the reference that are made from the code, at every build, into docs/generated/."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from _site import catalogue, commands, formats

#: Makers of pages: each yields paths inside docs/generated/ with their contents.
MAKERS: tuple[Callable[[], Iterator[tuple[str, str | bytes]]], ...] = (commands.pages, catalogue.pages, formats.pages)


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("config-inited", make)
    return {"parallel_read_safe": True}


def make(app: Any, _config: Any) -> None:
    """Write the pages anew."""
    folder = Path(app.srcdir) / "generated"
    shutil.rmtree(folder, ignore_errors=True)
    for maker in MAKERS:
        for name, content in maker():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content.encode() if isinstance(content, str) else content)
