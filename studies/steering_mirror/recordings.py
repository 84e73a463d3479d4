"""The recordings, what of them teaches and judges, and the same in modal coordinates as runs and a stage model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.measurements.recordings import AXES, DESCRIPTION, write_run
from studies.steering_mirror.modes import Complex, Modes, apply_response, fit, frequency_response

Array = NDArray[np.float64]
#: Sampling rate [Hz], levels [mV], and excited lines from the first on: up to 2999.2 Hz.
RATE, LEVELS, LINES = 6400.0, (100, 200, 300), 3839
#: What files hold: samples, channels, realisations, periods.
SHAPE = (8192, 3, 3, 2)
#: Realisations, counted from zero: the linear response is estimated from two; a diagnosis is shown the first, and the
#: third judges.
TEACHING, SHOWN, JUDGING = (0, 1), 0, 2
#: Samples that a run keeps, so that a diagnosis takes minutes: half a period, ten times what a mode needs to ring down,
#: is for fits; judging runs keep one, at the lowest level both, whose difference is the noise.
KEPT_SAMPLES = {"identify": SHAPE[0] // 2, "validate": SHAPE[0]}
#: The band in which the three strongest modes stand by themselves, and about where they are [Hz].
BAND, STARTS = (700.0, 1150.0), (813.0, 924.0, 1003.0)


@dataclass(frozen=True, eq=False)
class Recordings:
    """What was recorded.

    Parameters
    ----------
    u, y
        Inputs [V] and outputs [m] by level [mV], `SHAPE`.
    """

    u: dict[int, Array]
    y: dict[int, Array]

    def record(self, level: int, realisation: int) -> tuple[Array, Array]:
        """Return inputs and outputs of one realisation, samples x channels x periods."""
        return self.u[level][:, :, realisation], self.y[level][:, :, realisation]


@dataclass(frozen=True, eq=False)
class Decoupled:
    """The linear part of the mirror: what all channels answer, and the modes among it.

    Parameters
    ----------
    response
        Of outputs per input [m/V], lines x outputs x inputs.
    modes
        The three strongest modes.
    """

    response: Complex
    modes: Modes

    def remainder(self) -> Complex:
        """Return the linear response without the modes [m/V]."""
        return self.response - self.modes.response(lines_of(self.response))

    def modal(self, u: Array, y: Array) -> tuple[Array, Array]:
        """Return modal inputs [V] and coordinates [m] of whole periods, modes x samples, one period after the other."""
        remainder, periods = self.remainder(), range(u.shape[2])
        inputs = [self.modes.inputs(u[:, :, p].T) for p in periods]
        coordinates = [self.modes.coordinates((y[:, :, p] - apply_response(remainder, u[:, :, p])).T) for p in periods]
        return np.concatenate(inputs, axis=1), np.concatenate(coordinates, axis=1)


def lines_of(response: Complex) -> Array:
    """Return the frequencies of a response's lines [Hz]."""
    return np.arange(len(response)) * RATE / SHAPE[0]


def read(folder: Path) -> Recordings:
    """Read the arrays.

    Raises
    ------
    InputError
        If one is not there or has another shape.
    """
    return Recordings(*({level: _array(folder / f"{name}_{level}mV_test.npy") for level in LEVELS} for name in "uy"))


def _array(path: Path) -> Array:
    try:
        values: Array = np.load(path)
    except (OSError, ValueError) as error:
        remedy = "cannot be read; name the folder that holds the arrays of merijnfloren/fsm-benchmark-data"
        raise InputError(path, "", None, remedy) from error
    if values.shape != SHAPE or not np.isfinite(values).all():
        raise InputError(path, "", values.shape, f"expected finite numbers of shape {SHAPE}")
    return values


def linear(recordings: Recordings, levels: Sequence[int]) -> Complex:
    """Return the linear response of the realisations that teach, over some levels."""
    u, y = (
        np.concatenate([its[level][:, :, list(TEACHING)].mean(axis=3) for level in levels], axis=2)
        for its in (recordings.u, recordings.y)
    )
    return frequency_response(u, y, LINES)


def decouple(recordings: Recordings) -> Decoupled:
    """Return the linear response over all levels, and the modes in it."""
    response = linear(recordings, LEVELS)
    frequency = lines_of(response)
    band = (frequency > BAND[0]) & (frequency < BAND[1])
    return Decoupled(response, fit(frequency[band], response[band], STARTS))


def name_of(level: int, realisation: int) -> str:
    """Return what the run of a realisation is called."""
    return f"level{level}_{realisation + 1}"


def runs() -> Iterator[tuple[int, int, str]]:
    """Yield level, realisation and role of each run."""
    for realisation, role in ((SHOWN, "identify"), (JUDGING, "validate")):
        yield from ((level, realisation, role) for level in LEVELS)


def write(recordings: Recordings, decoupled: Decoupled, folder: Path) -> tuple[Path, Path]:
    """Write the modal axes as a stage model and a folder of runs; return both."""
    model, place = folder / "model.toml", folder / "runs"
    place.mkdir(parents=True, exist_ok=True)
    model.write_text(model_text(decoupled.modes), encoding="utf-8")
    # The levels are too small to drive piezos: an amplifier follows. The samples hold no more than 94 % of the Nyquist
    # frequency, so that between them the command is smooth.
    lines = ['title = "Fine steering mirror, modal axes"', 'command_is = "dac"', 'between_samples = "smooth"']
    for level, realisation, role in runs():
        name = name_of(level, realisation)
        kept = None if role == "validate" and level == LEVELS[0] else KEPT_SAMPLES[role]
        u, y = (each[:, :kept] for each in decoupled.modal(*recordings.record(level, realisation)))
        columns = {f"u{axis} [V]": u[m] for m, axis in enumerate(AXES)}
        columns |= {f"{axis} [um]": y[m] for m, axis in enumerate(AXES)}
        write_run(place / f"{name}.csv", np.arange(u.shape[1]) / RATE, columns)
        lines += ["", "[[run]]", f'file = "{name}.csv"', f'kind = "multisine {level} mV"', f'role = "{role}"']
    (place / DESCRIPTION).write_text("\n".join([*lines, ""]), encoding="utf-8")
    return model, place


def model_text(modes: Modes) -> str:
    """Return the stage model's file: each mode an axis."""
    lines = ["format = 1", 'title = "Fine steering mirror, modal axes"']
    for m, axis in enumerate(AXES):
        lines += ["", f"[axis.{axis}]", f'natural_frequency = "{modes.frequencies[m]:.6g} Hz"']
        lines += [f"damping_ratio = {modes.damping_ratios[m]:.6g}", f'gain = "{1e6 * modes.gains[m]:.6g} um/V"']
    delay = f'delay = "{1e3 * max(modes.delay, 0.0):.6g} ms"'
    return "\n".join([*lines, "", "[controller]", f'rate = "{RATE:g} Hz"', delay, ""])
