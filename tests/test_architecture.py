"""The house rules that no single module can keep: packages, light imports, documentation, size, sources of numbers."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MODULES = sorted((ROOT / "flexdesign").rglob("*.py"))
PARTS = sorted((ROOT / "geometry").glob("*.py"))
LONGEST = 400
#: Modules that may be longer, each with its reason.
LONG: dict[str, str] = {}
#: What only some commands need, and what takes a tenth of a second or more to import.
HEAVY = {
    "cadquery",
    "OCP",
    "pyvista",
    "vtkmodules",
    "skfem",
    "scipy",
    "numpy",
    "pytetwild",
    "netgen",
    "meshio",
    "pypardiso",
    "pint",
}
#: What the command line may not import either before it knows its command.
SLOW = {"cadquery", "OCP", "pyvista", "vtkmodules", "skfem", "pytetwild", "netgen", "meshio", "pypardiso"}


def imported_by(statement: str) -> set[str]:
    """Return the top-level modules loaded after running a statement in a fresh interpreter."""
    code = f"import sys; {statement}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def names(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_there_is_something_to_look_at() -> None:
    assert len(MODULES) > 25 and len(PARTS) >= 1


def test_imports_go_down_the_packages() -> None:
    """The contracts in pyproject.toml, by import-linter."""
    pytest.importorskip("importlinter")
    code = "import sys; from importlinter.cli import lint_imports_command; sys.argv[1:] = ['--no-cache']; "
    code += "lint_imports_command()"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout and "KEPT" in done.stdout


def test_importing_the_package_loads_nothing_heavy() -> None:
    loaded = imported_by("import flexdesign")
    assert "flexdesign" in loaded
    assert not loaded & HEAVY


@pytest.mark.parametrize("module", ["api.models", "api.recordings", "api.designs", "api.studies"])
def test_commands_begin_without_the_slowest_imports(module: str) -> None:
    """Each of these takes half a second or more; reports and statistics import them once they have something to say."""
    code = f"import flexdesign.{module}, flexdesign.core.units as u; u.from_text('1 mm', 'm')"
    code += "\nprint(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", f"import sys; {code}"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert not set(done.stdout.split()) & {"scipy.signal", "scipy.stats", "dask", "control", "matplotlib.pyplot"}


@pytest.mark.parametrize(
    "module", ["cli", "design.part", "design.design", "design.study", "core.model", "workflows.validation", "testing"]
)
def test_no_module_loads_cad_mesher_or_graphics_before_they_are_needed(module: str) -> None:
    assert not imported_by(f"import flexdesign.{module}") & SLOW


@pytest.mark.parametrize("arguments", [["--help"], ["materials"], ["effects"], ["effects", "--json"]], ids=" ".join)
def test_help_and_lists_wait_for_no_library(arguments: list[str]) -> None:
    """They take a second to import, and a list needs none of them; pint itself imports SciPy, the top of it."""
    command = f"import contextlib, io; from flexdesign.cli import main; sys.argv = ['flexdesign', *{arguments}]"
    quiet = "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit): main()"
    loaded = imported_by(f"{command}\n{quiet}")
    assert "flexdesign" in loaded
    assert not loaded & (SLOW | {"numba", "matplotlib", "control"})


@pytest.mark.parametrize(
    "module",
    ["dynamics.experiments.simulation", "diagnosis.identify", "report.terminal", "report.simulation.simulation_report"],
)
def test_dynamics_needs_nothing_of_the_design_extra(module: str) -> None:
    assert not imported_by(f"import flexdesign.{module}") & SLOW


@pytest.mark.parametrize("path", PARTS, ids=names)
def test_part_files_load_without_cad(path: Path) -> None:
    loaded = imported_by(f"from flexdesign.design import part; part.load({str(path)!r}, methods=part.PIECE_METHODS)")
    assert not loaded & SLOW


def test_modules_stay_short() -> None:
    """A module is split by idea long before; what is longer has its reason in `LONG`."""
    lengths = {names(path): len(path.read_text(encoding="utf-8").splitlines()) for path in [*MODULES, *PARTS]}
    long = {name: count for name, count in lengths.items() if count > LONGEST}
    assert set(long) <= set(LONG), long


def public(tree: ast.Module) -> Iterator[tuple[str, ast.AST]]:
    """Yield public functions, classes and their public methods; properties too."""
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
            yield node.name, node
            if isinstance(node, ast.ClassDef):
                for inner in node.body:
                    if isinstance(inner, ast.FunctionDef) and not inner.name.startswith("_"):
                        yield f"{node.name}.{inner.name}", inner


@pytest.mark.parametrize("path", [*MODULES, *PARTS], ids=names)
def test_everything_public_is_documented(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert not tree.body or ast.get_docstring(tree)
    missing = [name for name, node in public(tree) if not ast.get_docstring(node)]  # type: ignore[arg-type]
    assert not missing


@pytest.mark.parametrize("path", [*MODULES, *PARTS], ids=names)
def test_code_reads_no_published_numbers(path: Path) -> None:
    """What results are compared with stays out of reach of the code that computes them."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    texts = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
    documentation = {
        ast.get_docstring(n, clean=False)
        for n in ast.walk(tree)
        if isinstance(n, (ast.Module, ast.ClassDef, ast.FunctionDef))
    }
    forbidden = ("tests", "shared", "converged.toml", "reference/")
    pieces = {text: text.replace("\\", "/").split("/") for text in texts if text not in documentation}
    found = [t for t, parts in pieces.items() if any(word in parts or word in t.split() for word in forbidden)]
    assert not found
    modules = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    modules |= {n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert not [m for m in modules if m.partition(".")[0] == "tests"]
