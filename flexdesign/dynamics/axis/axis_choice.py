"""What a command asks for: which axis of a stage model, and which of its numbers."""

from __future__ import annotations

from collections.abc import Sequence

from flexdesign import effects
from flexdesign.core.errors import InputError, suggest
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import StageModel, fields
from flexdesign.measurements.recordings import FrequencyResponse, Run


def choose_axis(model: StageModel, runs: Sequence[Run | FrequencyResponse], requested: str | None) -> str:
    """Return the axis that is meant.

    Raises
    ------
    InputError
        If it is unknown, or several could be meant.
    """
    known = list(model.axes)
    if requested is not None:
        if requested not in known:
            remedy = f"the model has no such axis; it has {', '.join(known)}"
            raise InputError("command line", "--axis", requested, remedy)
        return requested
    common = [name for name in known if all(name in run.responses for run in runs)]
    if len(common) == 1:
        return common[0]
    if len(known) == 1:
        return known[0]
    choice = " or ".join(f"--axis {name}" for name in common or known)
    why = "the runs hold several axes of the model" if common else "no axis of the model is in every run"
    raise InputError("command line", "--axis", None, f"{why}; write {choice}")


def require_parameters(dynamics: AxisDynamics, requested: Sequence[str]) -> tuple[str, ...]:
    """Return the names of numbers that are asked for, each one that the prediction of a run depends on.

    Raises
    ------
    InputError
        If there is none, or one is unknown, named twice, or does not act; the message says what to write.
    """
    known = [parameter.name for parameter in dynamics.parameters()]
    if not requested:
        raise InputError("command line", "--free", None, f"name what is to be fitted; there are {', '.join(known)}")
    for name in requested:
        owner = name.partition(".")[0]
        if name in known:
            continue
        if owner in fields.AXIS_FIELDS:
            remedy = f"is {fields.AXIS_FIELDS[owner]} of the axis; write --free {fields.AXIS_FIELDS[owner]}"
        elif f"controller.{name}" in known:
            remedy = f"is no number of the axis but of its controller; write --free controller.{name}"
        elif name in ("mass", "stiffness"):
            remedy = "a run shows only the natural frequency; write --free natural_frequency (the mass follows from it)"
        elif owner in effects.names() and owner not in dynamics.axis.effects:
            remedy = f"the model has no {owner}; add it first: --set axis.{dynamics.name}.effects.{name}=..."
        elif name in dynamics.axis.numbers:
            remedy = f"does not act on the prediction of a run; there are {', '.join(known)}"
        else:
            remedy = f"is not a number of this axis{suggest(name, known)}"
        raise InputError("command line", "--free", name, remedy)
    if len(set(requested)) < len(requested):
        raise InputError("command line", "--free", ",".join(requested), "names a number twice")
    return tuple(requested)
