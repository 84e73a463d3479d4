"""Where the parts, designs and studies that come with flexdesign are: in the checkout, or in the installed package."""

from __future__ import annotations

from pathlib import Path

from flexdesign.core.errors import InputError, suggest
from flexdesign.core.toml_files import as_written, is_file, is_folder


def root() -> Path:
    """Return the folder that holds ``geometry/`` and ``studies/``."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "_shipped"
    return installed if installed.is_dir() else package.parent


def find(name: str | Path, kind: str, mark: str, argument: str, *, folder: str = "", remedy: str = "") -> Path:
    """Find a file of one kind: a path, or a bare name looked up in ``studies/``, here and as shipped.

    Parameters
    ----------
    name
        The path, or the name without ``.toml``.
    kind
        The kind of file in words, such as ``stage model``.
    mark
        A text that every file of the kind holds.
    argument
        The argument of the command line that names the file.
    folder
        The remedy if the path is a folder.
    remedy
        The end of the message if there is no such file.

    Raises
    ------
    InputError
        If there is no such file; the message suggests the nearest names.
    """
    path = Path(name)
    if is_file(path):
        return path
    files = [file for base in (Path(), root()) for file in sorted((base / "studies").glob("*.toml"))]
    for file in files:
        if file.stem == str(name):
            return file
    if folder and is_folder(path):
        raise InputError(path, "", None, folder)
    known = sorted({file.stem for file in files if _holds(file, mark)})
    raise InputError(
        "command line", argument, as_written(str(name)), f"no such {kind}{suggest(path.stem, known)}{remedy}"
    )


def _holds(file: Path, mark: str) -> bool:
    try:
        return mark in file.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return False
