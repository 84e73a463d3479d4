"""A circular notch hinge and a leaf hinge in pure bending, between plane stress and plane strain.

The notch is solved twice: on a structured mesh that is bent into its shape, and on the meshes that the program makes of
a part with this notch, extrapolated as a validation does.

Both are hinges of width b between blocks of height H, of which an eighth is meshed: bending about z is even in x = 0,
odd in y = 0, even in z = 0. What turns is measured by the work of the end moments, and what the blocks contribute as
beams is taken off.

Formulas are for beams, in plane stress. A hinge wider than it is long cannot contract freely across its width: it comes
near plane strain, which is stiffer by 1 / (1 - nu^2), or 12 % at nu = 0.33. Blocks, too, are no beams: they give way
around the roots. So a body in three dimensions has its stiffness between that of plane stress, with roots, and
1 / (1 - nu^2) times it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexdesign.analytic import notch
from flexdesign.design import part as parts
from flexdesign.design.materials import Material
from flexdesign.fem import convergence
from flexdesign.fem.meshing import domain, resolution_gate
from flexdesign.fem.meshing.methods import EXTRUDED_GRADING, Extruded, Grading
from flexdesign.fem.solving import port_compliance, statics
from flexdesign.fem.solving.elasticity import Elasticity
from studies.verification import loads
from studies.verification.finding import Finding, range_around
from studies.verification.solids import Array, Bent, graded_intervals, lattice

#: Where the notched bar is.
PARTS = Path(__file__).parent
METAL = Material("aluminium of the hinges", 71e9, 0.33, 2800.0, None)
#: Width of both hinges, their smallest thickness, the notch's radius, and how long the blocks are [m].
WIDTH, THICKNESS, RADIUS, BLOCK = 10e-3, 0.5e-3, 2e-3, 4e-3
#: Half the height of the blocks [m].
HALF = THICKNESS / 2 + RADIUS
#: Bending stiffness of the thinnest section and of a block [N m^2].
THIN, THICK = (METAL.youngs_modulus * WIDTH * height**3 / 12 for height in (THICKNESS, 2 * HALF))


def plane_stress(material: Material) -> Material:
    """Return constants with which a slice in plane strain has the in-plane motions of plane stress in `material`.

    E (1 + 2 nu) / (1 + nu)^2 and nu / (1 + nu) (Timoshenko and Goodier, Theory of Elasticity, section 17).

    >>> made = plane_stress(METAL)
    >>> made.youngs_modulus / (1 - made.poissons_ratio**2) / 1e9
    71.0
    """
    young, nu = material.youngs_modulus, material.poissons_ratio
    return Material("plane stress", young * (1 + 2 * nu) / (1 + nu) ** 2, nu / (1 + nu), material.density, None)


def euler_bernoulli() -> float:
    """Return the stiffness of the circular hinge as a beam of varying height, by quadrature [N m/rad]."""
    height = notch.circular_thickness(RADIUS, THICKNESS)
    beam = notch.beam_integral(METAL.youngs_modulus, WIDTH, height, 2 * RADIUS, RADIUS)
    return beam.rotational_stiffness


def paros_weisbord() -> float:
    """Return the same for a thin neck: Paros and Weisbord (1965), simplified [N m/rad]."""
    return notch.thin_neck(METAL.youngs_modulus, WIDTH, THICKNESS, RADIUS).rotational_stiffness


def circular(cells: tuple[int, int, int, int], material: Material) -> Bent:
    """Return an eighth of the notch hinge.

    Parameters
    ----------
    cells
        Around the notch, along the block, over half the height, over half the width.
    material
        What it is made of.
    """

    def shape(place: Array) -> Array:
        s, up, z = place.T
        angle = np.minimum(s, 1.0) * np.pi / 2
        x = RADIUS * np.sin(angle) + np.maximum(s - 1, 0.0) * BLOCK
        y = THICKNESS / 2 + RADIUS * (1 - np.cos(angle))
        # Lines lean so that they meet the notch, which ends upright, at a good angle.
        lean = np.where(s <= 1, s**2, 2 - s) * 0.375 * RADIUS
        return np.column_stack([x + (1 - up) * lean, up * y, z])

    around_, along, up, layers = cells
    x = np.concatenate(
        [graded_intervals(0.0, 1.0, around_, 6.0 ** (1 / around_)), graded_intervals(1.0, 2.0, along, 1.3)[1:]]
    )
    return Bent.of(lattice(x, graded_intervals(0.0, 1.0, up), _half_width(layers)), shape, material)


def leaf(length: float, cells: tuple[int, int, int], material: Material, finest: float = 60.0) -> Bent:
    """Return an eighth of the leaf hinge with sharp roots.

    Parameters
    ----------
    length
        Of the leaf [m].
    cells
        From a root to the middle of the leaf, and as many into the block, over half the thickness, over half the width.
    material
        What it is made of.
    finest
        How many times smaller the cells at the root are than the largest.
    """
    many, thin, layers = cells
    grow, middle, edge = finest ** (1 / many), length / 2, THICKNESS / 2
    x = np.concatenate(
        [graded_intervals(0.0, middle, many, 1 / grow), graded_intervals(middle, middle + BLOCK, many, grow)[1:]]
    )
    y = np.concatenate(
        [graded_intervals(0.0, edge, thin, 4.0 ** (-1 / thin)), graded_intervals(edge, HALF, many, grow)[1:]]
    )
    cut = lattice(x, y, _half_width(layers), lambda c: (c[:, 0] > middle) | (c[:, 1] < edge))
    return Bent.of(cut, lambda place: place, material)


def _half_width(layers: int) -> Array:
    """Layers over half the width, finest at the free side."""
    return graded_intervals(0.0, WIDTH / 2, layers, 4.0 ** (-1 / layers))


def turn(bent: Bent, end: float, *, flat: bool) -> float:
    """Return the angle between both ends of a hinge under unit moments on them [rad/(N m)], without its blocks' share.

    Parameters
    ----------
    bent
        An eighth of the hinge.
    end
        Where its block ends in the lattice.
    flat
        Whether nothing moves along the width, as in a slice.
    """
    body = bent.body
    inertia = WIDTH * (2 * HALF) ** 3 / 12
    load = loads.traction(body, bent.facets("x", end), lambda x: x[..., [1]] / inertia * np.array([-1.0, 0.0, 0.0]))
    middle, axis = bent.side("x", 0.0), bent.side("y", 0.0)
    held = [(middle, "x"), (axis, "x"), (bent.side("z", 0.0), "z")]
    if flat:
        held += [(np.arange(len(bent.places)), "z"), (np.intersect1d(middle, axis), "y")]
    else:  # one node keeps it from moving along y, and bears nothing
        held += [(axis, "z"), (np.array([bent.node(0.0, 0.0, 0.0)]), "y")]
    moved = bent.solve(bent.free(*held), load)
    return float(8 * load @ moved.ravel()) - 2 * BLOCK / THICK


def circular_hinge(
    flat: tuple[int, int, int, int] = (40, 12, 10, 1), solid: tuple[int, int, int, int] = (28, 8, 7, 5)
) -> list[Finding]:
    """Return the stiffness of the notch hinge R 2 mm, t 0.5 mm, b 10 mm, as a slice in plane stress and as a body."""
    slice_ = circular(flat, plane_stress(METAL))
    body = circular(solid, METAL)
    thin, thick = 1 / turn(slice_, 2.0, flat=True), 1 / turn(body, 2.0, flat=False)
    limits = thin, thin / (1 - METAL.poissons_ratio**2)
    problem = "circular hinge, R 2 mm, t 0.5 mm, b 10 mm"
    between = "from plane stress, as found, to 1 / (1 - nu^2) of it: too wide to contract"
    known = {
        "Euler-Bernoulli beam of varying height": euler_bernoulli(),
        "Paros and Weisbord (1965)": paros_weisbord(),
    }
    return [
        Finding(
            problem, "stiffness in plane stress", "independent code", "plane-stress finite elements",
            5923.2, 1e3 * thin, "N mm/rad", *range_around(5923.2, 2e-3), slice_.body.n_dofs,
            "chords on the notch 0.1 %; blocks, which are taken off as beams, 0.1 %",
        ),
        *(
            Finding(
                problem, "stiffness", "bound", source, 1e3 * stiffness, 1e3 * thick, "N mm/rad",
                1e3 * limits[0], 1e3 * limits[1], body.body.n_dofs, between,
            )
            for source, stiffness in known.items()
        ),
    ]  # fmt: skip


def own_mesh(coarseness: tuple[float, ...] = (1.35**2, 1.35, 1.0)) -> list[Finding]:
    """Return what the program's own meshes of the notch give, and of the structured one as a body.

    The part is a bar with the notch in its middle, held at one end. What a moment at the other end turns it by, less
    the share of the bar as a beam, is the notch's.
    """
    bar = parts.load("notched_bar", PARTS, parts.PIECE_METHODS)(neck=THICKNESS, radius=RADIUS, width=WIDTH, block=BLOCK)
    body = domain.of_part(bar, chord=domain.chord(bar))
    hinges = bar.linkage().of_kind("hinge")
    method = Extruded(Grading(body, bar.linkage().members, *EXTRUDED_GRADING, None))
    found, across, unknowns = [], [], 0
    for factor in coarseness:
        mesh = method.mesh(factor)
        across.append(min(check.across for check in resolution_gate.check(mesh, body, hinges)))
        stiffness, unknowns = _stiffness(Elasticity(mesh, METAL), body, bar)
        found.append(stiffness)
    sizes = [method.finest_edge(factor) for factor in coarseness]
    limit = convergence.extrapolate(found, sizes, mesh_noise=method.scatter)
    structured = 1 / turn(circular((36, 10, 9, 7), METAL), 2.0, flat=False)
    problem = "circular hinge, R 2 mm, t 0.5 mm, b 10 mm, the program's own meshes"
    return [
        Finding(
            problem, "stiffness", "independent code", "structured mesh", 1e3 * structured, 1e3 * limit.value,
            "N mm/rad", *range_around(1e3 * structured, 3e-3), unknowns,
            "chords on the structured notch make it 0.1 % too stiff, its elements 0.1 %; the error bar 0.1 %",
        ),
        Finding(
            problem, "difference, in error bars", "bound", "value ± error holds the structured mesh's", 0.0,
            (limit.value - structured) / (limit.error + 2e-3 * structured), "1", -1.0, 1.0, unknowns,
            "the structured mesh's own error, 0.2 %, is added",
        ),
        Finding(
            problem, "elements across the neck of the coarsest mesh", "bound", "mesh gate",
            resolution_gate.LEAST_ACROSS,
            across[0], "1", resolution_gate.LEAST_ACROSS, np.inf, unknowns, "one element knows nothing of the neck",
        ),
    ]  # fmt: skip


def _stiffness(body: Elasticity, whole: domain.Domain, bar: parts.Piece) -> tuple[float, int]:
    """Return moment per turn of the notch alone [N m/rad], and the unknowns."""
    held = [whole.ports["ground"]]
    space, stiffness = port_compliance.port_space(body, whole, bar.ports()), body.stiffness()
    system = statics.class_system(body, whole, port_compliance.classes(whole)[0], stiffness, held)
    share, checks, _, _ = statics.class_compliance(body, system, stiffness, space)
    checks.require()
    system.factor.free()
    return float(1 / (share[5, 5] - 2 * BLOCK / THICK)), body.n_dofs


def leaf_hinge(flat: tuple[int, int, int] = (14, 3, 1), solid: tuple[int, int, int] = (8, 3, 5)) -> list[Finding]:
    """Return what a leaf 4 mm long, 0.5 mm thick and 10 mm wide contributes per length, at its roots, and in all.

    At its roots the blocks give way. A half-plane under the linear stress of bending turns, on average over the work of
    the stress, by 18 M / (pi E b t^2): Flamant's solution integrated twice over the section, which comes to
    -(288 / pi) of the integral of x s ln|x - s| over the unit square about 0, or -1/16. That is 3 / (2 pi) = 0.477
    thicknesses of leaf; by the theorem of least complementary energy the true stress turns it
    less.
    O'Donnell (The additional deflection of a cantilever due to the elasticity of the support, Journal of Applied
    Mechanics 27 (1960), 461-464) has the same problem.
    """
    short, long = 4e-3, 8e-3
    slices = [leaf(length, flat, plane_stress(METAL)) for length in (short, long)]
    turns = [turn(s, length / 2 + BLOCK, flat=True) for s, length in zip(slices, (short, long), strict=True)]
    root = (turns[1] * THIN - long) / 2
    body = leaf(short, solid, METAL, finest=30.0)
    found = 1 / turn(body, short / 2 + BLOCK, flat=False)
    problem = "leaf hinge, l 4 mm, t 0.5 mm, b 10 mm"
    rooted = THIN / (short + 2 * root)
    unknowns = slices[1].body.n_dofs
    return [
        Finding(
            problem, "turn per length in plane stress", "analytic", "1 / E I, from two lengths", 1 / THIN,
            (turns[1] - turns[0]) / (long - short), "rad/(N m^2)", *range_around(1 / THIN, 2e-4), unknowns,
            "roots drop out but for what elements miss of them",
        ),
        Finding(
            problem, "length that a root adds, in thicknesses", "bound", "half-plane under linear stress, 3 / (2 pi)",
            3 / (2 * np.pi), root / THICKNESS, "1", 0.0, 3 / (2 * np.pi), unknowns,
            "least complementary energy: the true stress turns it less",
        ),
        Finding(
            problem, "stiffness", "bound", "E I / l", 1e3 * THIN / short, 1e3 * found, "N mm/rad", 1e3 * rooted,
            1e3 * rooted / (1 - METAL.poissons_ratio**2), body.body.n_dofs,
            "from beam to plate, both with the roots as found in plane stress: these soften, the width stiffens",
        ),
    ]  # fmt: skip
