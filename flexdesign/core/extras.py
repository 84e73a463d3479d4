"""Optional dependencies: what each extra brings, and what to install where one of its packages is missing."""

from __future__ import annotations

#: What each extra brings, and its packages: name of the distribution, and of the module.
EXTRAS: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
    "design": (
        "solids, meshes, finite elements and pictures: validate, ports, size, reproduce",
        (("cadquery", "cadquery"), ("cadquery-ocp", "OCP"), ("pytetwild", "pytetwild"), ("netgen-mesher", "netgen"),
         ("scikit-fem", "skfem"), ("meshio", "meshio"), ("pyvista", "pyvista"), ("pillow", "PIL")),
    ),
    "import": (
        "recordings as HDF5, .mat of version 7.3, .tdms, universal files, Parquet",
        (("h5py", "h5py"), ("npTDMS", "nptdms"), ("pyuff", "pyuff"), ("pyarrow", "pyarrow")),
    ),
    "sensitivity": ("Sobol' indices in sweeps", (("SALib", "SALib"),)),
    "cluster": ("sweeps on several machines", (("dask", "dask"), ("distributed", "distributed"))),
}  # fmt: skip


def requirement(module: str) -> str:
    """Return what to install for a module of an extra; empty if no extra has it.

    >>> requirement("skfem")
    "needs scikit-fem: pip install 'flexdesign[design]'"
    """
    for extra, (_, packages) in EXTRAS.items():
        for distribution, name in packages:
            if name == module:
                return f"needs {distribution}: pip install 'flexdesign[{extra}]'"
    return ""


def remedy(error: BaseException) -> str:
    """Return what to install where a package of an extra is missing, else nothing.

    >>> remedy(ModuleNotFoundError("No module named 'mine'", name="mine"))
    ''
    """
    return requirement((error.name or "").partition(".")[0]) if isinstance(error, ImportError) else ""
