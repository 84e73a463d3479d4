"""The record of two sharp-rooted bridge amplifiers by extruded, graded 27-node hexahedra.

The reference itself, which shares nothing with `flexdesign.fem`, is `studies.error_bars.bridge`: here it is refined
until it settles, without extrapolation.

Regenerate ``converged.toml`` (a few minutes, 8 GB)::

    python -m tests.reference.hexahedra
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from studies.error_bars.bridge import Bridge, Fineness, Reference, solve

COMMAND = "python -m tests.reference.hexahedra"
RECORD = Path(__file__).with_name("converged.toml")
TOLERANCE = 2e-3
DESIGNS = ("bridge_amplifier", "lin2019_amplifier_xy")
UNITS = {
    "K_in_output_free": "N/m",
    "lambda_output_free": "1",
    "K_out_input_free": "N/m",
    "K_out_input_held": "N/m",
    "C11": "m/N",
    "C12": "m/N",
    "C22": "m/N",
}


def converged(
    part: Bridge,
    youngs_modulus: float,
    poissons_ratio: float,
    density: float | None = None,
    *,
    tolerance: float = TOLERANCE,
    finest: int = 4,
) -> tuple[int, Reference, Reference]:
    """Refine until K_in moves by less than `tolerance` from one mesh to the next.

    Parameters
    ----------
    part, youngs_modulus, poissons_ratio, density
        As in `solve`.
    tolerance
        Relative change of K_in that ends the refinement.
    finest
        Last level tried; level 4 wants about 16 GB.

    Returns
    -------
    The level of the finest mesh, the result on it, and that on the mesh before.

    Raises
    ------
    RuntimeError
        If K_in has not settled at level `finest`.
    """
    before = solve(part, youngs_modulus, poissons_ratio, fineness=Fineness.of(1), density=density)
    for refinement in range(2, finest + 1):
        after = solve(part, youngs_modulus, poissons_ratio, fineness=Fineness.of(refinement), density=density)
        change = abs(after.K_in_output_free / before.K_in_output_free - 1)
        if change < tolerance:
            return refinement, after, before
        before = after
    raise RuntimeError(f"K_in still moves by {change:.2g} at refinement {finest}; allow a larger tolerance")


HEAD = f"""\
# The sharp-rooted bridge amplifiers: ground face clamped, the actuator pushing both input blocks apart.
# Written by the command below; do not edit. last_change is the relative change from the mesh before; it falls
# about fourfold from mesh to mesh. C11: extension per actuator force; C12: output per actuator force; C22:
# output per output force. Frequencies: modes symmetric in x = 0 and z = 0, inputs and output free.
command = "{COMMAND}"
method = "27-node hexahedra graded to the hinge roots, refined until K_in moves by less than {TOLERANCE:.1%}"

"""


def record(name: str, refinement: int, after: Reference, before: Reference) -> str:
    """Return the TOML tables of one design: each number, its unit, and its change from the mesh before."""
    lines = [f"[{name}]", f"refinement = {refinement}"]
    lines += [f"n_dof = {after.n_dof}", f"n_dof_before = {before.n_dof}"]
    numbers = [(key, getattr(after, key), getattr(before, key), unit) for key, unit in UNITS.items()]
    pairs = zip(after.frequencies, before.frequencies, strict=True)
    numbers += [(f"frequency_{i}", new, old, "Hz") for i, (new, old) in enumerate(pairs, 1)]
    for key, new, old, unit in numbers:
        lines.append(f'{key} = {{ value = {new:.7g}, unit = "{unit}", last_change = {new / old - 1:.2e} }}')
    return "\n".join(lines) + "\n"


def main() -> None:
    """Solve both designs until converged, and write the record."""
    from flexdesign.design import design

    tables = []
    for name in DESIGNS:
        read = design.read(design.find(name))
        metal = read.material
        part: Any = read.part()
        tables.append(record(name, *converged(part, metal.youngs_modulus, metal.poissons_ratio, metal.density)))
        print(tables[-1], flush=True)
    RECORD.write_text(HEAD + "\n".join(tables), encoding="utf-8")


if __name__ == "__main__":
    main()
