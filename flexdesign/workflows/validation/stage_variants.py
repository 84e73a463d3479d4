"""What a variant of a stage changes, from meshes that are not fine, and how well that is known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from flexdesign.core.model import Quantity
from flexdesign.fem.convergence import MeshNoise, extrapolate

#: Stage and variant are of the same or of like meshes, so that what is irregular in these cancels in the ratio.
SAME_MESHES = MeshNoise(0.0)


def variant_quantities(
    here: Sequence[Mapping[str, Quantity]],
    there: Sequence[Mapping[str, Quantity]],
    sizes: Sequence[float],
    limits: Mapping[str, Quantity],
) -> dict[str, Quantity]:
    """Return the quantities of a variant for vanishing element size: those of the stage, times what it changes.

    What is zero in the stage itself, a coupling that symmetry forbids, is extrapolated as the variant has it. What the
    stage has not is left out.

    Parameters
    ----------
    here, there
        Quantities of stage and variant by key, on the same meshes from coarse to fine.
    sizes
        Edge length of each mesh at the hinge roots [m].
    limits
        Those of the stage for vanishing element size, by key, each with its estimated error.
    """
    found = {}
    for key, quantity in there[0].items():
        if key not in here[0] or key not in limits:
            continue
        base, values = [level[key].value for level in here], [level[key].value for level in there]
        if any(value == 0 for value in base):
            own = extrapolate(values, sizes, mesh_noise=SAME_MESHES)
            found[key] = replace(quantity, value=own.value, half_width=own.error)
            continue
        ratio = extrapolate([v / b for v, b in zip(values, base, strict=True)], sizes, mesh_noise=SAME_MESHES)
        limit = limits[key]
        sigma = math.hypot(limit.value * ratio.error, (limit.half_width or 0.0) * ratio.value)
        found[key] = replace(quantity, value=limit.value * ratio.value, half_width=sigma)
    return found
