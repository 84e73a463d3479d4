"""Small sines through the chain of an axis: its frequency response about a working point, without any simulation.

Where a chain is linear this is what the engine would give after all has settled; what bends is taken by its slope at
the working point, and what turns, such as hysteresis, by its describing function (Krylov and Bogoliubov 1937; Gelb and
Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, 1968). Blocks say it of themselves, see
`flexdesign.core.model.Block`; the order of the signal is that of `flexdesign.dynamics.signal_chain.chain`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array, Complex
from flexdesign.core.model import Adjust, Block, Effect, Resonance, Socket
from flexdesign.core.model.effect import Values
from flexdesign.dynamics.signal_chain.chain import AxisChain

#: The effects that act on commands and readings without being blocks of the chain.
DELAYS = ("transport_delay", "sensor_delay")
#: Images of a held command that are counted to each side: the residual falls with the square of their number.
IMAGES = 6
#: Newton's steps to the position at which forces and drive are in balance, and the share of it below which one is last.
STEPS, BALANCED = 50, 1e-12


@dataclass(frozen=True)
class WorkingPoint:
    """About which command small sines are looked at.

    Parameters
    ----------
    bias
        The command there [V].
    amplitude
        Of the sine [V]; zero where it is not known: then it is taken to be as small as can be.
    delay
        How late commands act [s].
    period
        Of the samples, where a command is held between them [s]; None where it is a continuous signal.
    """

    bias: float = 0.0
    amplitude: float = 0.0
    delay: float = 0.0
    period: float | None = None


def shows(effect: Effect) -> bool:
    """Tell whether a frequency response can show an effect at all.

    >>> from flexdesign import effects
    >>> [shows(effects.find(name)) for name in ("creep", "second_mode", "mains_hum", "driver_slew")]
    [True, True, False, False]
    """
    passes = (isinstance(face, Block) and face.transfer is not None for face in effect.faces)
    adjusts = (isinstance(face, Resonance) or (isinstance(face, Adjust) and face.of == "axis") for face in effect.faces)
    return effect.name in DELAYS or any(passes) or any(adjusts)


def response(chain: AxisChain, frequency: Array, about: WorkingPoint) -> Complex:
    """Return reading over command of small sines [response/V], n complex numbers.

    Parameters
    ----------
    chain
        The axis.
    frequency
        n frequencies [Hz].
    about
        The working point.
    """
    if about.period is None:
        return _continuous(chain, frequency, about)
    # Samples of a held command's answer: the spectrum with all its images (Astrom and Wittenmark 1997, chapter 7).
    total, rate = np.zeros(len(frequency), dtype=np.complex128), 1 / about.period
    for image in range(-IMAGES, IMAGES + 1):
        at = frequency + image * rate
        there = _continuous(chain, np.abs(at), about)
        held = np.sinc(at * about.period) * np.exp(-1j * math.pi * at * about.period)
        total += np.where(at < 0, there.conj(), there) * held
    return total


def added_stiffness(chain: AxisChain) -> float:
    """Return the stiffness that forces on the table have for small motions about rest, over that of the main mode."""
    return -_at_rest(chain, Socket.FORCE)


def added_gain(chain: AxisChain) -> float:
    """Return what hysteresis adds to the gain for small motions about rest [response/V]; mostly it holds back."""
    return _at_rest(chain, Socket.HYSTERESIS)


def _at_rest(chain: AxisChain, socket: Socket) -> float:
    """Return the sum of what the blocks of a socket that add pass of small and slow sines about rest."""
    still = np.zeros(1)
    blocks = [(block, values) for block, values in chain.blocks(socket) if block.mode == "add"]
    return float(sum(_of(block, values, still, 0.0, 0.0)[0].real for block, values in blocks))


def _continuous(chain: AxisChain, frequency: Array, about: WorkingPoint) -> Complex:
    passed = np.exp(-2j * math.pi * frequency * about.delay)
    at, size = about.bias, abs(about.amplitude)
    upside = -1.0 if chain.gain < 0 else 1.0  # hysteresis sees the voltage upside down where the gain is negative
    for socket, base in (
        (Socket.COMMAND, 1.0),
        (Socket.DRIVER, chain.amplifier),
        (Socket.HYSTERESIS, upside),
        (Socket.ACTUATOR, 1.0),
    ):
        at, size, passed = at * base, size * abs(base), passed * base
        own = abs(chain.gain) if socket is Socket.HYSTERESIS else 1.0
        blocks = chain.blocks(socket)
        through, rests = _through(blocks, frequency, at, size, own)
        passed, at, size = passed * through, rests, size * own
    forces = chain.blocks(Socket.FORCE)
    position = _equilibrium(forces, at)
    modes = _modes(chain, frequency)
    stiffness = sum((_of(b, v, frequency, position, 0.0) for b, v in forces), np.zeros_like(passed))
    passed = passed * modes / (1.0 - modes * stiffness)
    through, _ = _through(chain.blocks(Socket.SENSOR), frequency, position, 0.0, 1.0)
    return np.asarray(passed * through)


def _through(
    blocks: Sequence[tuple[Block, Values]], frequency: Array, at: float, size: float, own: float
) -> tuple[Complex, float]:
    """Return what a socket does to small sines, and its output at rest; those that replace work in series."""
    through, rests = np.full(len(frequency), own, dtype=np.complex128), own * at
    replacing = [each for each in blocks if each[0].mode == "replace" and each[0].transfer is not None]
    if replacing:
        through[:] = 1.0
    for block, values in replacing:
        passed = _of(block, values, frequency, at, size)
        through, rests = through * passed, rests * float(_of(block, values, np.zeros(1), at, size)[0].real)
    for block, values in blocks:
        if block.mode == "add":
            passed = _of(block, values, frequency, at, size)
            through = through + passed
            rests += _static_value(block, values, at)
    return through, rests


def _of(block: Block, values: Values, frequency: Array, at: float, size: float) -> Complex:
    if block.transfer is None:
        return np.zeros(len(frequency), dtype=np.complex128)
    return np.zeros(len(frequency)) + np.asarray(block.transfer(values, frequency, at, size))


def _static_value(block: Block, values: Values, at: float) -> float:
    if block.settled is not None:
        return block.settled(values, at)
    return float(_of(block, values, np.zeros(1), at, 0.0)[0].real) * at


def _equilibrium(forces: Sequence[tuple[Block, Values]], drive: float) -> float:
    """Return the position at which the forces over the stiffness and the drive are in balance."""
    position, still = drive, np.zeros(1)
    for _ in range(STEPS):
        off = position - drive - sum(_static_value(block, values, position) for block, values in forces)
        slope = 1.0 - sum(float(_of(block, values, still, position, 0.0)[0].real) for block, values in forces)
        step = off / slope if slope else 0.0
        position -= step
        if abs(step) <= BALANCED * abs(drive):
            break
    return position


def _modes(chain: AxisChain, frequency: Array) -> Complex:
    """Return motion over drive of all modes together."""
    total = np.zeros(len(frequency), dtype=np.complex128)
    for mode in chain.modes:
        ratio = frequency / mode.frequency
        total += mode.share / (1.0 - ratio**2 + 2j * mode.damping_ratio * ratio)
    return total
