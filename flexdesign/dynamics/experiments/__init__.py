"""What to simulate: a study of experiments, read from its file."""

from flexdesign.dynamics.experiments.plan import (
    AS_MODELLED,
    COMMANDS,
    KNOWN,
    MEASURES,
    SETTINGS,
    ControllerTable,
    Experiment,
    Gains,
    Plan,
    Published,
    Variant,
    pieces,
)
from flexdesign.dynamics.experiments.reading import find, read, variants

__all__ = [
    "AS_MODELLED",
    "COMMANDS",
    "KNOWN",
    "MEASURES",
    "SETTINGS",
    "ControllerTable",
    "Experiment",
    "Gains",
    "Plan",
    "Published",
    "Variant",
    "find",
    "pieces",
    "read",
    "variants",
]
