"""flexdesign: design piezo-driven flexure stages, simulate them, and confront the model with measurements.

>>> import flexdesign as fd
>>> model = fd.read_model("lin2019_stage", axis={"x": {"damping_ratio": 0.02}})
>>> fd.effects["creep"].name, fd.materials["Ti-6Al-4V"].youngs_modulus
('creep', 113800000000.0)

Each command of the command line is a function here. Its result prints itself, holds numbers by name, and writes its
report: see `flexdesign.api.result.Result`. Names are imported when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexdesign import effects as effects
    from flexdesign.api.catalogue import materials as materials
    from flexdesign.api.confrontation import confront as confront
    from flexdesign.api.designs import draw as draw
    from flexdesign.api.designs import formulas as formulas
    from flexdesign.api.designs import read_design as read_design
    from flexdesign.api.designs import read_study as read_study
    from flexdesign.api.designs import validate as validate
    from flexdesign.api.health import doctor as doctor
    from flexdesign.api.models import plan as plan
    from flexdesign.api.models import read_model as read_model
    from flexdesign.api.models import simulate as simulate
    from flexdesign.api.published import published as published
    from flexdesign.api.recordings import add_effect as add_effect
    from flexdesign.api.recordings import check as check
    from flexdesign.api.recordings import compare as compare
    from flexdesign.api.recordings import diagnose as diagnose
    from flexdesign.api.recordings import identify as identify
    from flexdesign.api.recordings import import_recordings as import_recordings
    from flexdesign.api.recordings import read_recordings as read_recordings
    from flexdesign.api.step_files import read_ports as read_ports
    from flexdesign.api.studies import optimize as optimize
    from flexdesign.api.studies import reproduce as reproduce
    from flexdesign.api.studies import sweep as sweep
    from flexdesign.core.errors import InputError as InputError
    from flexdesign.core.model import Block as Block
    from flexdesign.core.model import Disturbance as Disturbance
    from flexdesign.core.model import Effect as Effect
    from flexdesign.core.model import Parameter as Parameter
    from flexdesign.core.model import Quantity as Quantity
    from flexdesign.core.versions import __version__ as __version__
    from flexdesign.design.design import Design as Design
    from flexdesign.design.part import Part as Part
    from flexdesign.design.part import Port as Port
    from flexdesign.dynamics.stage_model import StageModel as StageModel
    from flexdesign.measurements.recordings import FrequencyResponse as FrequencyResponse
    from flexdesign.measurements.recordings import Run as Run

#: Where each name comes from.
_HOME = {
    "flexdesign.api.catalogue": ("materials",),
    "flexdesign.api.confrontation": ("confront",),
    "flexdesign.api.designs": ("draw", "formulas", "read_design", "read_study", "validate"),
    "flexdesign.api.health": ("doctor",),
    "flexdesign.api.models": ("plan", "read_model", "simulate"),
    "flexdesign.api.published": ("published",),
    "flexdesign.api.recordings": (
        "add_effect", "check", "compare", "diagnose", "identify", "import_recordings", "read_recordings",
    ),
    "flexdesign.api.step_files": ("read_ports",),
    "flexdesign.api.studies": ("optimize", "reproduce", "sweep"),
    "flexdesign.core.errors": ("InputError",),
    "flexdesign.core.model": ("Block", "Disturbance", "Effect", "Parameter", "Quantity"),
    "flexdesign.core.versions": ("__version__",),
    "flexdesign.design.design": ("Design",),
    "flexdesign.design.part": ("Part", "Port"),
    "flexdesign.dynamics.stage_model": ("StageModel",),
    "flexdesign.measurements.recordings": ("FrequencyResponse", "Run"),
}  # fmt: skip
#: Nouns of part and effect files. They resolve here too, but are not offered: their modules are their place.
_OF_FILES = {
    "flexdesign.core.model": (
        "Adjust", "Formulas", "Linkage", "Member", "Notch", "Reshape", "Resonance", "Root", "Socket", "Term",
    ),
    "flexdesign.design.part": ("Outline", "SymmetryPlane"),
}  # fmt: skip
_MODULE = {name: module for homes in (_HOME, _OF_FILES) for module, names in homes.items() for name in names}

__all__ = ["effects", *sorted(name for names in _HOME.values() for name in names)]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used (PEP 562)."""
    if name == "effects":
        return import_module("flexdesign.effects")
    if name not in _MODULE:
        raise AttributeError(f"module 'flexdesign' has no attribute {name!r}")
    value = getattr(import_module(_MODULE[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the names that are offered."""
    return list(__all__)
