"""Which versions made a result."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

__version__ = "1.0.0"
#: What simulation and identification rest on.
DYNAMICS = ("numpy", "scipy", "numba", "control")


def installed(libraries: Sequence[str] = DYNAMICS) -> dict[str, str]:
    """Return the versions of flexdesign, Python and the libraries named.

    >>> list(installed(["numpy"]))
    ['flexdesign', 'python', 'numpy']
    """
    found = {"flexdesign": __version__, "python": platform.python_version()}
    for name in libraries:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
