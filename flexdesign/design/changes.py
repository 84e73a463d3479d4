"""Changes from the command line (`--set`), as they stand in a title and in the name of a folder."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence

from flexdesign.core.errors import shorten

#: Most letters for the changes in a title, and in the name of a folder.
TITLE, NAME = 100, 60


def describe(overrides: Sequence[str]) -> str:
    """Return what overrides change.

    >>> describe(['dimensions.hinge_thickness="0.4 mm"', "axis.x.mass*=1.1"])
    'hinge_thickness 0.4 mm, axis.x.mass x 1.1'
    """
    return shorten(", ".join(f"{key} {times}{value}" for key, times, value in map(_pieces, overrides)), TITLE)


def title_with_changes(title: str, overrides: Sequence[str]) -> str:
    """Return the title of something with its changes.

    >>> title_with_changes("Bridge amplifier", ["dimensions.width=12 mm"])
    'Bridge amplifier (width 12 mm)'
    >>> title_with_changes("Bridge amplifier", ["title=Mine"])
    'Bridge amplifier'
    """
    listed = [override for override in overrides if _pieces(override)[0] != "title"]
    return f"{title} ({describe(listed)})" if listed else title


def as_name(overrides: Sequence[str]) -> str:
    """Return the end of a folder's name that states the changes; empty without any.

    >>> as_name(["dimensions.hinge_thickness=0.4 mm"])
    '_hinge_thickness_0.4_mm'
    """
    words = [f"{key}_{'x' if times else ''}{value}" for key, times, value in map(_pieces, overrides)]
    name = re.sub(r"[^\w.+-]+", "_", "_".join(words)).strip("_.")
    if len(name) > NAME:
        digest = hashlib.sha256("\n".join(overrides).encode()).hexdigest()[:8]
        name = f"{name[:NAME].rstrip('_.')}_{digest}"
    return f"_{name}" if name else ""


def _pieces(override: str) -> tuple[str, str, str]:
    """Return key, sign of a multiple and value of an override; dimensions by their bare names."""
    key, _, value = override.partition("=")
    times = "x " if key.rstrip().endswith("*") else ""
    bare = key.strip().removesuffix("*").strip().removeprefix("dimensions.")
    return bare, times, " ".join(value.split()).strip("\"'")
