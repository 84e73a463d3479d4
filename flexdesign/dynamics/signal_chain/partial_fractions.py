"""Motion over drive as a sum of parts of second order: the modes, or what linear forces make of them.

A force of Maxwell elements couples modes and relaxations to one linear system. Its eigenvalues and residues give parts
again, each of which the engine advances exactly, however fast a relaxation is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flexdesign.core.model import Maxwell, Socket
from flexdesign.dynamics.signal_chain import exact_step
from flexdesign.dynamics.signal_chain.chain import AxisChain, Oscillator


@dataclass(frozen=True)
class Part:
    """Position and velocity of one part under the drive d: p' = q + b0 d, q' = -a0 p - a1 q + b1 d.

    The motion is the sum of p over all parts; as their b0 add up to zero, the velocity is the sum of q. A real
    eigenvalue has a0 = 0.
    """

    a0: float
    a1: float
    b0: float
    b1: float


def parts(axis: AxisChain) -> tuple[Part, ...]:
    """Return the parts of an axis, those of its modes if no force is linear."""
    forces = tuple(block.maxwell(values) for block, values in axis.blocks(Socket.FORCE) if block.maxwell is not None)
    return _with_forces(axis.modes, forces) if forces else tuple(_of_mode(mode) for mode in axis.modes)


def _of_mode(mode: Oscillator) -> Part:
    w = 2 * math.pi * mode.frequency
    return Part(w**2, 2 * mode.damping_ratio * w, 0.0, mode.share * w**2)


@lru_cache(maxsize=256)
def _with_forces(modes: Sequence[Oscillator], forces: Sequence[Maxwell]) -> tuple[Part, ...]:
    """Return the parts of modes that linear forces act on.

    The states are the positions p and velocities q of the modes and the positions y of the elements, see
    `flexdesign.core.model.Maxwell`; the force acts on all modes as the drive does.
    """
    alone = [_of_mode(mode) for mode in modes]
    rates, stiffness = np.array([pair for force in forces for pair in force.elements]).reshape(-1, 2).T
    dashpot, n, k = sum(force.dashpot for force in forces), len(modes), len(rates)
    system = np.zeros((2 * n + k, 2 * n + k))
    p, q, y = slice(n), slice(n, 2 * n), slice(2 * n, None)
    system[p, q] = np.eye(n)
    system[q, p] = np.diag([-part.a0 for part in alone])
    system[q, q] = np.diag([-part.a1 for part in alone])
    system[y, p] = rates[:, None]
    system[y, y] = np.diag(-rates)
    position, force, into = np.zeros((3, 2 * n + k))
    position[p] = 1.0
    force[p], force[q], force[y] = -stiffness.sum(), -dashpot, stiffness
    into[q] = [part.b1 for part in alone]
    system += np.outer(into, force)
    eigenvalues, vectors = np.linalg.eig(system)
    residues = (position @ vectors) * np.linalg.solve(vectors, into.astype(vectors.dtype))
    return tuple(
        Part(abs(s) ** 2, -2 * s.real, 2 * r.real, 2 * (s * r).real)
        if s.imag
        else Part(0.0, -s.real, r.real, (s * r).real)
        for s, r in zip(eigenvalues.astype(complex).tolist(), residues.astype(complex).tolist(), strict=True)
        if s.imag >= 0
    )


@lru_cache(maxsize=4096)
def step_matrices(part: Part, length: float) -> tuple[float, ...]:
    """Return the 16 numbers of a part's passage over a step, see `memory_layout.Modes`."""
    return tuple(exact_step.half_and_whole(part.a0, part.a1, part.b0, part.b1, length).tolist())
