"""New files, alone or in a new folder, written completely or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from flexdesign.core.errors import InputError
from flexdesign.core.whole_files import written_whole


def write_folder(folder: Path, files: Mapping[str, str | bytes]) -> list[Path]:
    """Write files into a folder that does not exist yet, or is empty.

    The files are written into a folder of another name first, which then gets its own.

    Parameters
    ----------
    folder
        The new folder. Its parents are made.
    files
        Path of each file inside the folder, with ``/``, and its content.

    Returns
    -------
    list of Path
        The written files, in the given order.

    Raises
    ------
    InputError
        If the folder holds something, or cannot be written.
    """
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError("command line", "FOLDER", str(folder), "exists and is not empty; choose another folder")
        parent = folder.absolute().parent
        parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=parent, prefix=f".{folder.name}-") as scratch:
            made = Path(scratch) / "made"
            made.mkdir()  # with the permissions of an ordinary folder, unlike the scratch folder
            for name, content in files.items():
                path = made / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content.encode() if isinstance(content, str) else content)
            if folder.is_dir():
                folder.rmdir()
            made.rename(folder)
    except OSError as error:
        remedy = f"cannot be written ({error.strerror or error}); choose another folder"
        raise InputError("command line", "FOLDER", str(folder), remedy) from error
    return [folder / name for name in files]


def write_files(folder: Path, files: Mapping[str, str]) -> list[Path]:
    """Write new files into a folder, which is made if it is not there.

    Parameters
    ----------
    folder
        Where they are written.
    files
        Name and text of each.

    Returns
    -------
    list of Path
        The written files, in the given order.

    Raises
    ------
    InputError
        If one of them exists, or the folder cannot be written.
    """
    paths = [folder / name for name in files]
    for path in paths:
        if path.exists():
            raise InputError("command line", "NAME", str(path), "exists; choose another name")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with written_whole(folder) as scratch:
            for name, text in files.items():
                (scratch / name).write_text(text, encoding="utf-8")
    except OSError as error:
        remedy = f"cannot be written ({error.strerror or error}); choose another place"
        raise InputError("command line", "NAME", str(folder), remedy) from error
    return paths
