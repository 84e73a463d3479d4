"""How long the installation takes, and how much room the packages need, each set of extras in a new environment::

    python -m studies.benchmarks.installation                # the core alone
    python -m studies.benchmarks.installation core design    # and with finite elements and CAD

Files are those of the packages, without pip itself. Python also writes their bytecode, at the latest when a module is
first imported; ``pip install --no-compile`` leaves it to that. The time includes the download.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
CORE = "core"
#: Packages that every environment has.
OF_PIP = ("pip", "setuptools", "pkg_resources", "_distutils_hack")
MEGABYTE = 1e6


@dataclass(frozen=True)
class Installed:
    """What an installation took.

    Parameters
    ----------
    seconds
        Time that a user waits [s].
    files, bytecode
        Room for the packages' own files, and for the bytecode of all of them [bytes].
    """

    seconds: float
    files: int
    bytecode: int


def sizes(site: Path) -> tuple[int, int]:
    """Return the room for the files of packages, and for their bytecode [bytes]."""
    own = [path for path in site.rglob("*") if path.is_file() and path.relative_to(site).parts[0] not in OF_PIP]
    bytecode = sum(path.stat().st_size for path in own if path.suffix == ".pyc")
    return sum(path.stat().st_size for path in own) - bytecode, bytecode


def install(extra: str, folder: Path) -> Installed:
    """Install flexdesign and one extra into an environment of their own."""
    python = folder / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    wanted = str(ROOT) if extra == CORE else f"{ROOT}[{extra}]"
    pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-compile", wanted]
    start = time.perf_counter()
    subprocess.run(pip, check=True)
    taken = time.perf_counter() - start
    script = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = subprocess.run([python, "-c", script], check=True, capture_output=True, text=True).stdout.strip()
    # Some packages hold templates that are no Python, which compileall reports: its exit code says nothing here.
    subprocess.run([python, "-m", "compileall", "-q", "-j", "0", site], check=False, capture_output=True)
    return Installed(taken, *sizes(Path(site)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each extra."""
    parser = argparse.ArgumentParser(prog="python -m studies.benchmarks.installation", description="room and time")
    parser.add_argument(
        "extras", nargs="*", default=[CORE], metavar="EXTRA", help="core, or an extra of pyproject.toml"
    )
    print(f"{'':14}{'time':>8}{'files':>12}{'bytecode':>12}")
    for extra in parser.parse_args(arguments).extras:
        with tempfile.TemporaryDirectory() as folder:
            found = install(extra, Path(folder))
        files, bytecode = (f"{size / MEGABYTE:.0f} MB" for size in (found.files, found.bytecode))
        print(f"{extra:14}{found.seconds:6.0f} s{files:>12}{bytecode:>12}", flush=True)


if __name__ == "__main__":
    main()
