"""Effects by the names and paths that a user gives, of stages and of parts at rest."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from flexdesign import effects
from flexdesign.core.errors import InputError
from flexdesign.dynamics.stage_model import fields


def known_effect(name: str, field: str, catalogue: ModuleType = effects) -> str:
    """Return the name under which an effect is found from everywhere, a path as an absolute one.

    Parameters
    ----------
    name
        Of the catalogue, or a path.
    field
        Where it was given, for the message.
    catalogue
        `flexdesign.effects`, or `flexdesign.effects.statics` for parts at rest.

    Raises
    ------
    InputError
        If there is none, or it has nothing that a fit could move.
    """
    try:
        whole = str(catalogue.resolve_name(name, Path()))
        effect = catalogue.find(whole)
    except ValueError as error:
        raise InputError("command line", field, name, str(error)) from None
    if catalogue is effects and whole not in fields.AXIS_FIELDS and not (effect.faces and effect.acts_in_time):
        raise InputError("command line", field, name, "acts on parts at rest alone, which no run in time shows")
    if not any(p.null is not None for p in effect.parameters):
        raise InputError("command line", field, name, "none of its parameters states a null, at which it is not there")
    return whole


def own_effects(names: Sequence[str], catalogue: ModuleType = effects) -> list[str]:
    """Return effects in addition to those of the catalogue, as `diagnose` takes them.

    Raises
    ------
    InputError
        If one cannot be used.
    """
    whole = [known_effect(name, "--effect", catalogue) for name in names]
    return [name for name in dict.fromkeys(whole) if name not in catalogue.names()]
