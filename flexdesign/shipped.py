"""Where the parts, designs and studies that come with flexdesign are: in the checkout, or in the installed package."""

from __future__ import annotations

from pathlib import Path


def root() -> Path:
    """Return the folder that holds ``geometry/`` and ``studies/``."""
    package = Path(__file__).resolve().parent
    installed = package / "_shipped"
    return installed if installed.is_dir() else package.parent
