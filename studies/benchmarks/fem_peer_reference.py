"""The converged input stiffness of a sharp-rooted bridge amplifier, by graded hexahedra of order 2.

They share no code with any program of `fem_peers` (`studies.error_bars.bridge`). Two meshes are solved here; the third
and finest, which takes minutes, is on record. Their error falls about fourfold from mesh to mesh: the limit is that of
the last two, and how far that of the first two lies from it is its doubt.
"""

from __future__ import annotations

import json
import sys
import tomllib
from typing import Any

from flexdesign.design import design
from studies.error_bars.bridge import Fineness, solve
from tests.reference.hexahedra import COMMAND, RECORD

#: How well the record must return what its second mesh gives here: it has seven digits, and its change three.
SAME = 1e-5


def reference(name: str) -> dict[str, Any]:
    """Return K_in on the meshes and in the limit [N/mm], and how far that may be off, relative.

    Raises
    ------
    ValueError
        If there is no record, or it is of another part than the one there now.
    """
    records = tomllib.loads(RECORD.read_text(encoding="utf-8"))
    if name not in records:
        raise ValueError(f"no converged K_in of {name} is on record; let {COMMAND} make one")
    kept = records[name]["K_in_output_free"]
    read = design.read(design.find(name))
    part: Any = read.part()
    metal, third = read.material, 1e-3 * kept["value"]
    first, second = (
        1e-3 * solve(part, metal.youngs_modulus, metal.poissons_ratio, fineness=Fineness.of(level)).K_in_output_free
        for level in (1, 2)
    )
    if abs(second / third * (1 + kept["last_change"]) - 1) > SAME:
        raise ValueError(f"the record of {name} is of another part; make it anew: {COMMAND}")
    before, limit = (fine + (fine - coarse) / 3 for coarse, fine in ((first, second), (second, third)))
    return {"meshes": (first, second, third), "limit": limit, "doubt": abs(before / limit - 1)}


if __name__ == "__main__":
    print(json.dumps(reference(sys.argv[1])))
