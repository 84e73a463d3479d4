"""Which versions made a result."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version

__version__ = "1.0.0"
#: What simulation and identification rest on.
DYNAMICS = ("numpy", "scipy", "numba", "control")


def installed(libraries: Sequence[str] = DYNAMICS) -> dict[str, str]:
    """Return the versions of flexdesign, Python and the libraries named.

    >>> list(installed(["numpy"]))
    ['flexdesign', 'python', 'numpy']
    """
    return {
        "flexdesign": __version__,
        "python": platform.python_version(),
        **{name: _installed(name) for name in libraries},
    }


@cache
def _installed(name: str) -> str:
    """Return the version of a library; to read it takes milliseconds, and every key of the cache holds eight."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
