"""Natural frequencies and mode shapes, class by class, by shift-invert on the factor that statics already made.

An actuator between the inputs is a massless spring k along their extension e = c . u: a rank-one update of the
stiffness, so that the same factor serves (Sherman and Morrison, 1950)

    (K + k c c^T)^-1 b = K^-1 b - K^-1 c (c . K^-1 b) / (1/k + c . K^-1 c).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh

from flexdesign.fem.solving.port_compliance import PortSpace
from flexdesign.fem.solving.statics import ClassSystem

FloatArray = NDArray[np.float64]
#: Most modes of a class among which the one that carries the output is looked for: a stiff actuator that pushes a table
#: lifts it above the first modes of its leaves, of which each leaf has one for every bending and twisting shape.
MOST = 32
#: A drive moves the output if the cosine between them, in the measure of strain energy, is more than rounding.
COUPLED = 1e-6


@dataclass(frozen=True)
class Mode:
    """A natural vibration with the ground held.

    Parameters
    ----------
    frequency
        [Hz].
    symmetry
        Name of its symmetry class.
    output_mass
        The mass that, moving with the output, has this mode's kinetic energy [kg]; infinite if the output rests.
    extension
        How far the shape parts the inputs [1/sqrt(kg)]; negative where they approach as the output moves along its
        normal, of either sign where the output rests.
    shape
        Displacements of the domain's nodes for unit modal mass of the whole part, the output moving along its normal,
        shape (n, 3) [1/sqrt(kg)].
    """

    frequency: float
    symmetry: str
    output_mass: float
    extension: float
    shape: FloatArray


def class_modes(system: ClassSystem, mass: sp.csr_matrix, space: PortSpace, count: int, actuator: float) -> list[Mode]:
    """Return the lowest `count` modes of one symmetry class, and above them those that carry most of the output.

    These are the modes with the largest share of the output's compliance and of its static motion by the actuator. More
    modes are found until no other can have a larger share of the compliance: until all others together have less.

    Parameters
    ----------
    system
        Its factorized equations.
    mass
        Mass matrix of the domain, upper triangle, all dofs.
    space
        The ports.
    count
        How many modes.
    actuator
        Stiffness of the spring between the inputs [N/m], 0 for none.
    """
    copies = 2 ** len(space.planes)
    extension, output = (system.gather(_measure(space, system, motion)) for motion in (space.extension, space.output))
    inverse = _spring_inverse(system, extension, actuator / copies)
    drives = [output, extension] if actuator else [output]
    values, vectors = _lowest_with_main(system.condense(mass), inverse, count, output, drives)
    modes = []
    for value, vector in zip(values, vectors.T, strict=True):
        shape = vector / np.sqrt(copies)
        shape *= -1.0 if output @ shape < 0 else 1.0
        output_motion = float(output @ shape)
        modes.append(
            Mode(
                frequency=float(np.sqrt(value) / (2 * np.pi)),
                symmetry=system.cls.name,
                output_mass=1 / output_motion**2 if output_motion > 1e-6 else np.inf,
                extension=float(extension @ shape),
                shape=system.spread(shape).reshape(-1, 3),
            )
        )
    return sorted(modes, key=lambda mode: mode.frequency)


def _lowest_with_main(
    mass: sp.csr_matrix,
    inverse: Callable[[FloatArray], FloatArray],
    count: int,
    output: FloatArray,
    drives: Sequence[FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return the `count` lowest modes, and those above that carry most of the output's motion by one of the drives.

    A mode has the share (d . v) (y . v) / omega^2 of the static motion y . K^-1 d at the output y by the drive d. Of a
    drive at the output itself all shares are positive, so that none is larger than what all others leave.
    """
    answers = [inverse(drive) for drive in drives]
    compliances = [
        (float(output @ answer), float(drive @ answer)) for drive, answer in zip(drives, answers, strict=True)
    ]
    driven = [
        (drive, static)
        for drive, (static, own) in zip(drives, compliances, strict=True)
        if abs(static) > COUPLED * math.sqrt(compliances[0][0] * own) > 0
    ]
    most, asked = max(count, min(MOST, len(output) - 2)), count
    while True:
        values, vectors = lowest(mass, inverse, asked)
        order = np.argsort(values)
        values, vectors = values[order], vectors[:, order]
        shares = [(drive @ vectors) * (output @ vectors) / values / static for drive, static in driven]
        if asked >= most or all(share.max() >= 1 - share.sum() for share in shares):
            kept = sorted({*range(count), *(int(share.argmax()) for share in shares)})
            return values[kept], vectors[:, kept]
        asked = min(2 * asked, most)


def lowest(
    mass: sp.csr_matrix, inverse: Callable[[FloatArray], FloatArray], count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the squares of the lowest angular frequencies, and their vectors of unit modal mass.

    Parameters
    ----------
    mass
        Upper triangle, shape (n, n).
    inverse
        Returns K^-1 b of a vector b.
    count
        How many; k < n.

    Returns
    -------
    squares
        Shape (k,) [rad^2/s^2].
    vectors
        Shape (n, k).
    """
    size = mass.shape[0]
    inner = (mass + sp.triu(mass, k=1).T).tocsr()
    unused = LinearOperator((size, size), matvec=lambda v: v, dtype=float)  # shift-invert only asks for its inverse
    values, vectors = eigsh(
        unused, count, M=inner, sigma=0.0, OPinv=LinearOperator((size, size), matvec=inverse, dtype=float),
        v0=np.random.default_rng(0).standard_normal(size), ncv=max(2 * count + 1, 10), tol=1e-7,
    )  # fmt: skip
    return values, vectors


def _spring_inverse(system: ClassSystem, extension: FloatArray, spring: float) -> Callable[[FloatArray], FloatArray]:
    """Return b -> (K + spring c c^T)^-1 b; `spring` is the domain's share, as it carries its share of the energy."""
    if spring == 0 or not np.any(extension):
        return lambda right: system.factor.solve(np.asarray(right).ravel())
    answer = system.factor.solve(extension)
    softness = 1 / spring + extension @ answer

    def inverse(right: FloatArray) -> FloatArray:
        solution = system.factor.solve(np.asarray(right).ravel())
        return np.asarray(solution - answer * (extension @ solution / softness))

    return inverse


def _measure(space: PortSpace, system: ClassSystem, motion: FloatArray) -> FloatArray:
    """Return the row c over the domain's dofs with c . u = the whole part's port motion `motion`, in this class."""
    projection = space.projection(system.cls)
    loads = np.hstack([space.loads[name] for name in space.retained])
    images = np.repeat([2.0 ** (len(space.planes) - space.swaps(name)) for name in space.retained], 6)
    return np.asarray(loads @ (images * (projection @ motion)))
