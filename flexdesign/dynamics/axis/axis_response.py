"""A measured frequency response as seen by one axis: its unit, its size, and what the axis expects of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.dynamics import spectrum
from flexdesign.dynamics.signal_chain.chain import AxisChain
from flexdesign.dynamics.spectrum import WorkingPoint
from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.measurements.recordings import FrequencyResponse

#: Lines below this share of the natural frequency are about as large as the gain; how near to a power of a thousand
#: from it they are to count as of a wrong unit, in powers of ten.
LOW, NEAR = 0.5, 0.5


def of_axis(response: FrequencyResponse, name: str, axis: AxisModel) -> FrequencyResponse:
    """Return a frequency response as one axis sees it, with remarks on what its model leaves out.

    Raises
    ------
    InputError
        If it is of another axis, in another unit, or in one that is wrong by a power of a thousand.
    """
    if name not in response.responses:
        remedy = f"is of axis {response.axis}; leave it out, or correct output in measurements.toml"
        raise InputError(response.name, name, None, remedy)
    if response.si != axis.response:
        remedy = f"the model's axis {name} responds in {axis.response} (the unit of its gain); correct one of the two"
        raise InputError(response.name, name, f"in {response.si}/V", remedy)
    remarks = []
    if response.payload and axis.mass is None:
        added = units.to_text(response.payload, "g", 3)
        remarks.append(
            f"carries {added}, which means nothing to a model without mass and stiffness: predicted without it"
        )
    if not {"gain", "driver.gain"} & set(axis.assumed):
        _refuse_wrong_unit(response, name, axis)
    return replace(response, axis=name, remarks=(*response.remarks, *remarks))


def _refuse_wrong_unit(response: FrequencyResponse, name: str, axis: AxisModel) -> None:
    low = response.present & (response.frequencies < LOW * axis.natural_frequency)
    due = abs(axis.gain * (axis.driver.gain if response.command_is == "dac" else 1.0))
    if not low.any() or not due:
        return
    seen = float(np.median(np.abs(response.response[low])))
    decades = math.log10(seen / due) if seen else -math.inf
    thousands = round(decades / 3) if math.isfinite(decades) else 0
    if thousands and abs(decades - 3 * thousands) < NEAR:
        remedy = f"the model's gain is {due:.3g} {axis.response}/V, 1e{-3 * thousands} of that: correct the unit"
        raise InputError(response.name, name, f"{seen:.3g} {response.si}/V", remedy)


def predict(
    chain: AxisChain,
    measured: FrequencyResponse,
    delay: float,
    frequencies: Array | None = None,
    reading_delay: float = 0.0,
) -> NDArray[np.complex128]:
    """Return the response of a chain about the working point of a measured one [response/V].

    Parameters
    ----------
    chain
        The axis; for a measured voltage at the stack with an amplifier that does nothing but amplify.
    measured
        Says the bias, the amplitude, and what the command was.
    delay
        How late commands act [s]; they are late no more at the stack.
    frequencies
        Where [Hz]; by default its own.
    reading_delay
        How late readings are [s], wherever the command was measured.
    """
    at_stack = measured.command_is != "dac"
    stack = chain.amplifier if at_stack else 1.0  # of a voltage at the stack: per volt there
    about = WorkingPoint(
        bias=measured.bias / stack,
        amplitude=(measured.amplitude or 0.0) / abs(stack),
        delay=(0.0 if at_stack else delay) + reading_delay,
        period=measured.period,
    )
    return spectrum.response(chain, measured.frequencies if frequencies is None else frequencies, about) / stack
