"""The levers, and how each is solved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from flexdesign.analytic.compliance import ComplianceModel, nominal_effects
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Cache
from flexdesign.design import study as studies
from flexdesign.fem import mesh_refinement
from flexdesign.fem.meshing import domain

SKETCH = Path(__file__).resolve().parents[2] / "geometry" / "sketches" / "lever_amplifier.toml"
KEYS = ("K_in_output_free", "lambda_output_free", "K_out_input_free")
#: What the hinge of each lever has in its table.
PROFILES = {
    "leaf": 'profile = "leaf"',
    "leaf with fillets": 'profile = "leaf", fillet = "1 mm"',
    "circular": 'profile = "circular"',
    "elliptic, depth 1 mm": 'profile = "elliptic", depth = "1 mm"',
    "elliptic, depth 3 mm": 'profile = "elliptic", depth = "3 mm"',
    "parabolic": 'profile = "parabolic", depth = "1 mm"',
    "v": 'profile = "v", depth = "1.5 mm", fillet = "0.5 mm"',
}


@dataclass(frozen=True)
class LeverSolution:
    """One lever.

    Parameters
    ----------
    fem, model
        Quantities of finite elements and of the compliance model, by key.
    unknowns
        Of the finest mesh.
    seconds
        For meshes and solutions.
    """

    fem: Mapping[str, Quantity]
    model: Mapping[str, Quantity]
    unknowns: int
    seconds: float


def lever(profile: str, folder: Path) -> Path:
    """Write the design of a lever; return its file."""
    text = SKETCH.read_text(encoding="utf-8")
    path = folder / f"{profile.replace(' ', '_').replace(',', '')}.toml"
    path.write_text(text.replace('profile = "circular"', PROFILES[profile]), encoding="utf-8")
    return path


def solve(profile: str, folder: Path, *overrides: str) -> LeverSolution:
    """Solve one lever to an estimated accuracy of 1 %, by default."""
    study = studies.read(str(lever(profile, folder)), ['mesh.accuracy="1 %"', *overrides])
    part = study.design.part()
    began = perf_counter()
    body = domain.of_part(part, chord=domain.chord(part))
    method = mesh_refinement.method_of(study, part, body)
    levels = mesh_refinement.refine(
        study, part, body, method, Cache(folder / "cache"), lambda _: None, all_classes=False
    )
    seconds = perf_counter() - began
    model = ComplianceModel.of_part(part, study.design.material).having(nominal_effects(part))
    return LeverSolution(
        by_key(mesh_refinement.gather_quantities(study, levels, method.scatter)),
        model.quantities(),
        levels[-1].solution.facts["unknowns"],
        seconds,
    )
