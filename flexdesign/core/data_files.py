"""Where the parts, designs and studies that come with flexdesign are: in the checkout, or in the installed package."""

from __future__ import annotations

from pathlib import Path


def root() -> Path:
    """Return the folder that holds ``geometry/`` and ``studies/``."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "_shipped"
    return installed if installed.is_dir() else package.parent


def in_studies(name: str | Path, mark: str) -> tuple[Path | None, list[str]]:
    """Return the file of a bare name in ``studies/``, here or as shipped, and the names of all files of its kind.

    Parameters
    ----------
    name
        Without ``.toml``; what is a path belongs to none.
    mark
        A text that every file of the kind holds.
    """
    files = [file for base in (Path(), root()) for file in sorted((base / "studies").glob("*.toml"))]
    found = next((file for file in files if file.stem == str(name)), None)
    return found, sorted({file.stem for file in files if _holds(file, mark)})


def _holds(file: Path, mark: str) -> bool:
    try:
        return mark in file.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return False
