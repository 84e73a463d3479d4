"""What an installation has and lacks: versions, optional packages, solver, pictures, memory, folders."""

from __future__ import annotations

import importlib.util
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from flexdesign.core import result_cache, versions
from flexdesign.core.errors import InputError
from flexdesign.core.extras import EXTRAS
from flexdesign.fem.solving.solver import available_memory

State = Literal["ok", "missing", "problem"]
#: Libraries that are always there.
CORE = ("numpy", "scipy", "numba", "control", "matplotlib", "pint", "pydantic", "typer")
#: A picture is drawn in a process of its own, which may end without a word; it takes no longer [s].
DRAWING = (
    "import pyvista; plotter = pyvista.Plotter(off_screen=True, window_size=(32, 32)); "
    "plotter.add_mesh(pyvista.Sphere()); plotter.screenshot()"
)
LONGEST = 60
EXTRA_DESIGN = "pip install 'flexdesign[design]'"
#: Less memory than this is little for a part at an accuracy of 1 % [bytes].
LITTLE = 4 * 2**30


@dataclass(frozen=True)
class Item:
    """One thing that was looked at.

    Parameters
    ----------
    name
        What.
    state
        ``ok``, ``missing`` where it is optional, or ``problem``.
    found
        What was found, in words.
    remedy
        What to do about it; empty if nothing.
    """

    name: str
    state: State
    found: str
    remedy: str = ""


@dataclass(frozen=True)
class Health:
    """What an installation has and lacks.

    Parameters
    ----------
    items
        All that was looked at.
    """

    items: tuple[Item, ...]

    @property
    def is_sound(self) -> bool:
        """Whether there is no problem; an optional package that is missing is none."""
        return all(item.state != "problem" for item in self.items)


def examine(cache: Path | None = None) -> Health:
    """Look at the installation.

    Parameters
    ----------
    cache
        The folder of the cache; the default one without it.
    """
    items = [_core()]
    items += [_extra(name, brings, packages) for name, (brings, packages) in EXTRAS.items()]
    return Health((*items, _solver(), _pictures(), _memory(), _cache(cache), *_folders()))


def _core() -> Item:
    message = ", ".join(f"{name} {number}" for name, number in versions.installed(CORE).items())
    lacking = [name for name in CORE if importlib.util.find_spec(name) is None]
    if lacking:
        return Item("flexdesign", "problem", f"{', '.join(lacking)} cannot be found", "pip install flexdesign")
    return Item("flexdesign", "ok", f"{message}; {platform.platform(terse=True)}")


def _extra(name: str, brings: str, packages: Sequence[tuple[str, str]]) -> Item:
    lacking = [package for package, module in packages if importlib.util.find_spec(module) is None]
    if lacking:
        found = f"{', '.join(lacking)} missing; brings {brings}"
        return Item(f"extra {name}", "missing", found, f"pip install 'flexdesign[{name}]'")
    return Item(f"extra {name}", "ok", ", ".join(f"{package} {_version(package)}" for package, _ in packages))


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "of unknown version"


def _solver() -> Item:
    if importlib.util.find_spec("pypardiso") is None:
        found = "Intel MKL missing: SciPy's SuperLU solves, slower and with more memory"
        return Item("solver", "missing", found, "pip install pypardiso (x86-64 Linux and Windows)")
    try:
        from pypardiso import PyPardisoSolver

        PyPardisoSolver(mtype=2)
    except Exception as error:  # the library of MKL itself is missing or of another kind of machine
        remedy = "pip install --force-reinstall mkl pypardiso"
        return Item("solver", "problem", f"Intel MKL cannot be loaded: {type(error).__name__}", remedy)
    return Item("solver", "ok", f"Intel MKL PARDISO by pypardiso {_version('pypardiso')}")


def _pictures() -> Item:
    if importlib.util.find_spec("pyvista") is None:
        return Item("pictures", "missing", "pyvista missing: reports have no pictures of parts", EXTRA_DESIGN)
    try:
        command = [sys.executable, "-c", DRAWING]
        ended = subprocess.run(command, capture_output=True, timeout=LONGEST, check=False)
        failed = ended.returncode != 0
    except subprocess.TimeoutExpired:
        failed = True
    if failed:
        found = "OpenGL cannot draw without a screen: reports have no pictures of parts"
        return Item("pictures", "problem", found, "apt-get install libgl1 libegl1 libxrender1, or a graphics driver")
    return Item("pictures", "ok", "OpenGL draws without a screen")


def _memory() -> Item:
    free = available_memory()
    if free is None:
        return Item("memory", "ok", "the system does not say how much is free")
    message = f"{free / 2**30:.1f} GiB free, {os.cpu_count()} processors"
    if free < LITTLE:
        return Item("memory", "problem", message, "close other programs, or ask for less mesh.accuracy")
    return Item("memory", "ok", message)


def _cache(folder: Path | None) -> Item:
    try:
        place = result_cache.open_cache(folder).folder
    except InputError as error:
        return Item("cache", "problem", f"{error.value}: {error.remedy}", "set FLEXDESIGN_CACHE to a folder")
    entries = [path.stat().st_size for path in place.rglob("*.npz")]
    return Item("cache", "ok", f"{place}: {len(entries)} entries, {sum(entries) / 2**20:.0f} MiB")


def _folders() -> list[Item]:
    found = []
    for name, place in (("working folder", Path()), ("temporary folder", Path(tempfile.gettempdir()))):
        try:
            with tempfile.TemporaryFile(dir=place):
                pass
            found.append(Item(name, "ok", f"{place.resolve()} can be written"))
        except OSError as error:
            remedy = "change to another folder" if place == Path() else "set TMPDIR to another folder"
            found.append(Item(name, "problem", f"{place.resolve()} cannot be written: {error.strerror}", remedy))
    return found
