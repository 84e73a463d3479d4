"""Planar finite elements of a leaf of thickness 1 and modulus 1 on what it runs into, in plane stress."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skfem.helpers import ddot, sym_grad, trace

from flexdesign.core.model import Notch
from flexdesign.fem.meshing.planar import triangulate
from flexdesign.fem.meshing.section import Curve

Array = NDArray[np.float64]
Point = tuple[float, float]
#: Length of the leaf, and Poisson's ratio.
LEAF, POISSON = 4.0, 0.33
#: Edges at the roots, their growth, and the order of what they leave open at sharp roots; two meshes are extrapolated.
FINEST, GROWTH, ORDER = 0.01, 0.25, 1.09
SHEAR = 0.5 / (1 + POISSON)
#: Corners of a side of a notch; its chords are off by 1e-4 of the neck where that is a tenth of the radius.
CORNERS = 321


class SupportedPlane:
    """A meshed outline, some of its motions held, ready for loads on its straight sides."""

    def __init__(self, outline: Sequence[Point], roots: Sequence[Point], finest: float, largest: float) -> None:
        corners = np.array(outline)
        sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        near = cKDTree(np.array(roots))

        def size(points: Array) -> Array:
            return np.asarray(np.minimum(finest + GROWTH * near.query(points)[0], largest))

        plan = triangulate([Curve(side, number) for number, side in enumerate(sides)], size, 1e-3)
        self.mesh = skfem.MeshTri(plan.points.T.copy(), plan.triangles.T.copy())
        self.element = skfem.ElementVector(skfem.ElementTriP2())
        self.basis = skfem.Basis(self.mesh, self.element)
        lame, shear = POISSON / (1 - POISSON**2), SHEAR

        @skfem.BilinearForm
        def energy(u: Any, v: Any, _: Any) -> Any:
            a, b = sym_grad(u), sym_grad(v)
            return lame * trace(a) * trace(b) + 2 * shear * ddot(a, b)

        self.stiffness = energy.assemble(self.basis)

    def side(self, holds: Callable[[Array], Any]) -> Any:
        """Return the boundary facets on which a condition holds."""
        return self.mesh.facets_satisfying(holds, boundaries_only=True)

    def load(self, side: Any, traction: Callable[[Array], tuple[Any, Any]]) -> Array:
        """Return the load of a traction on a side."""

        @skfem.LinearForm
        def work(v: Any, w: Any) -> Any:
            tx, ty = traction(w.x)
            return tx * v[0] + ty * v[1]

        return np.asarray(work.assemble(skfem.FacetBasis(self.mesh, self.element, facets=side)))

    def held(self, side: Any, *components: str) -> Array:
        """Return the unknowns of a side: all, or those named ``u^1`` and ``u^2``."""
        found = self.basis.get_dofs(side)
        return np.asarray(found.all(list(components)) if components else found.all())

    def at(self, point: Point, component: int) -> Array:
        """Return the unknown of the vertex next to a point."""
        vertex = np.argmin(np.linalg.norm(self.mesh.p.T - np.array(point), axis=1))
        return np.array([self.basis.nodal_dofs[component, vertex]])

    def compliance(self, loads: Sequence[Array], held: Array) -> Array:
        """Return the work of each load on the displacement of each."""
        moves = [skfem.solve(*skfem.condense(self.stiffness, load, D=np.unique(held))) for load in loads]
        return np.array([[load @ move for move in moves] for load in loads])


def leaf_loads(solved: SupportedPlane) -> list[Array]:
    """Return unit loads N, V and M at the free end of a leaf that runs along x from 0 to `LEAF`."""
    end = solved.side(lambda x: np.isclose(x[0], LEAF))
    return [
        solved.load(end, lambda x: (1 + 0 * x[0], 0 * x[0])),
        solved.load(end, lambda x: (0 * x[0], 1.5 * (1 - 4 * x[1] ** 2))),
        solved.load(end, lambda x: (-12 * x[1], 0 * x[0])),
    ]


def cantilever(length: float, thickness: float = 1.0) -> Array:
    """Return the compliance of a Timoshenko cantilever at its tip: N, V, M."""
    inertia = thickness**3 / 12
    shear = 1.2 * length / (SHEAR * thickness)
    v, m = length**3 / (3 * inertia) + shear, length**2 / (2 * inertia)
    return np.array([[length / thickness, 0, 0], [0, v, m], [0, m, length / inertia]])


def at_root(compliance: Array, reach: float) -> Array:
    """Return a compliance for loads taken `reach` further back: M there is M + reach V here."""
    back = np.linalg.inv(np.array([[1.0, 0, 0], [0, 1, 0], [0, reach, 1]]))
    return np.asarray(back.T @ compliance @ back)


def filleted_edge(radius: float) -> tuple[list[Point], Array]:
    """Return the upper edge of a leaf from its tip to the wall, and its compliance as a beam of growing thickness."""
    angles = np.linspace(0, np.pi / 2, 25) if radius else np.zeros(1)
    arc = [(radius * (1 - float(np.sin(a))), 0.5 + radius * (1 - float(np.cos(a)))) for a in angles]
    x = np.concatenate([np.linspace(0, radius, 4001), np.linspace(radius, LEAF, 201)])
    t = 1 + 2 * np.where(x < radius, radius - np.sqrt(np.maximum(radius**2 - (radius - x) ** 2, 0)), 0)
    reach = LEAF - x
    n, m = np.trapezoid(1 / t, x), np.trapezoid(12 / t**3, x)
    vm, v = np.trapezoid(12 * reach / t**3, x), np.trapezoid(12 * reach**2 / t**3, x) + 1.2 * n / SHEAR
    return [(LEAF, 0.5), *arc], np.array([[n, 0, 0], [0, v, vm], [0, vm, m]])


def extrapolate_root(root: Callable[[float], Array]) -> Array:
    """Return the limit of a root's compliance for vanishing edges."""
    coarse, fine = root(2 * FINEST), root(FINEST)
    return np.asarray(fine + (fine - coarse) / (2**ORDER - 1))


@cache
def end(depth: float, radius: float = 0.0) -> Array:
    """Return what the root gives way where a leaf runs into the end of a beam of thickness `depth`: 3 by 3."""
    upper, leaf = filleted_edge(radius)
    wall = 3 * depth
    mirrored = [(x, -y) for x, y in reversed(upper)]
    outline = [*mirrored, *upper, (0.0, depth / 2), (-wall, depth / 2), (-wall, -depth / 2), (0.0, -depth / 2)]
    roots = upper[1:] + mirrored[:-1]

    def root(finest: float) -> Array:
        solved = SupportedPlane(outline, roots, min(finest, radius / 6) if radius else finest, max(0.35, depth / 12))
        whole = solved.compliance(leaf_loads(solved), solved.held(solved.side(lambda x: np.isclose(x[0], -wall))))
        return at_root(whole - leaf, LEAF) - cantilever(wall, depth)

    return extrapolate_root(root)


@cache
def flank(depth: float, overhang: float, height: float) -> Array:
    """Return what the root gives way where a leaf pulls at the side of a beam that runs across, clamped below.

    Less the beam: a Timoshenko cantilever of `height` with its axis at half its `depth`.
    """
    outline = [(0, 0.5), (0, overhang), (-depth, overhang), (-depth, -height), (0, -height), (0, -0.5)]
    outline += [(LEAF, -0.5), (LEAF, 0.5)]
    tip = cantilever(height, depth)
    # The beam stands along y: its V is the leaf's N, its N the leaf's V; and the leaf's V has the lever depth / 2.
    beam = np.array([[tip[1, 1], 0, -tip[1, 2]], [0, tip[0, 0], 0], [-tip[1, 2], 0, tip[2, 2]]])
    lever = np.array([[1.0, 0, 0], [0, 1, 0], [0, depth / 2, 1]])

    def root(finest: float) -> Array:
        roots = [(0, 0.5), (0, -0.5), (-depth, -height), (0, -height)]
        solved = SupportedPlane([(float(x), float(y)) for x, y in outline], roots, finest, depth / 6)
        whole = solved.compliance(leaf_loads(solved), solved.held(solved.side(lambda x: np.isclose(x[1], -height))))
        return at_root(whole - cantilever(LEAF), LEAF) - lever.T @ beam @ lever

    return extrapolate_root(root)


@cache
def block(depth: float, overhang: float, height: float) -> Array:
    """Return what the root gives way where a leaf pulls at a block that its mirror image pulls at from behind: N, M."""
    below, above = -overhang, height - overhang
    outline = [(-depth, below), (0, below), (0, -0.5), (LEAF, -0.5), (LEAF, 0.5), (0, 0.5), (0, above), (-depth, above)]

    def root(finest: float) -> Array:
        largest = max(min(depth, height) / 5, 0.3)
        solved = SupportedPlane([(float(x), float(y)) for x, y in outline], [(0, 0.5), (0, -0.5)], finest, largest)
        middle = solved.side(lambda x: np.isclose(x[0], -depth))
        held = np.concatenate([solved.held(middle, "u^1"), solved.at((-depth, below), 1)])
        n, _, m = leaf_loads(solved)
        return solved.compliance([n, m], held) - np.diag([LEAF, 12 * LEAF])

    return extrapolate_root(root)


@cache
def pressed_root_compliance(depth: float, overhang: float, height: float) -> float:
    """Return what the root gives way per N where an actuator presses evenly on the side that the leaf pulls at.

    The block reaches from the plane y = 0, in which it is mirrored, to `overhang` above the leaf, whose axis lies at
    `height`. Less the block as a beam: see `flexdesign.analytic.beam.evenly_loaded`.
    """
    top, face = height + overhang, height - 0.5
    outline = [(0, 0), (depth, 0), (depth, top), (0, top), (0, height + 0.5), (-LEAF, height + 0.5)]
    outline += [(-LEAF, height - 0.5), (0, height - 0.5)]

    def root(finest: float) -> Array:
        roots = [(0.0, height + 0.5), (0.0, height - 0.5)]
        largest = max(min(depth, height) / 5, 0.3)
        solved = SupportedPlane([(float(x), float(y)) for x, y in outline], roots, finest, largest)
        pressed = solved.side(lambda x: np.isclose(x[0], 0) & (x[1] < face + 1e-9))
        push = solved.load(pressed, lambda x: (1 / face + 0 * x[0], 0 * x[0]))
        tip = solved.side(lambda x: np.isclose(x[0], -LEAF))
        middle = solved.side(lambda x: np.isclose(x[1], 0))
        held = np.concatenate([solved.held(middle, "u^2"), solved.held(tip)])
        return solved.compliance([push], held) - LEAF

    inertia = depth**3 / 12
    beam = 2 * height**3 / (15 * inertia) + 1.2 * height / (3 * SHEAR * depth)
    return float(extrapolate_root(root)[0, 0] - beam)


@cache
def notch(shape: Notch, neck: float) -> Array:
    """Return what a notch gives way about its centre, without the beams at its ends that are as deep as it is there.

    Parameters
    ----------
    shape
        Of its sides.
    neck
        Thickness of its neck, in the unit of the shape.
    """
    half = shape.half_length
    along = half * np.sin(np.linspace(-np.pi / 2, np.pi / 2, CORNERS))
    up = neck / 2 + shape.rise(along)
    deep = 2 * float(up[0])
    reach = half + 2 * deep
    upper = [(-reach, deep / 2), *zip(along.tolist(), up.tolist(), strict=True), (reach, deep / 2)]
    outline = upper + [(x, -y) for x, y in reversed(upper)]
    solved = SupportedPlane(outline, [(0.0, neck / 2), (0.0, -neck / 2)], 0.06 * neck, deep / 12)
    tip = solved.side(lambda x: np.isclose(x[0], reach))
    loads = [
        solved.load(tip, lambda x: (1 / deep + 0 * x[0], 0 * x[0])),
        solved.load(tip, lambda x: (0 * x[0], 1.5 / deep * (1 - (2 * x[1] / deep) ** 2))),
        solved.load(tip, lambda x: (-12 * x[1] / deep**3, 0 * x[0])),
    ]
    whole = solved.compliance(loads, solved.held(solved.side(lambda x: np.isclose(x[0], -reach))))
    inertia, beams = deep**3 / 12, 2 * (reach - half)
    sway = 2 * (reach**3 - half**3) / (3 * inertia) + 1.2 * beams / (SHEAR * deep)
    return at_root(whole, reach) - np.diag([beams / deep, sway, beams / inertia])
