"""One closed solid of what a STEP file holds: those that are meant, bonded, filled, healed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError, shorten

#: Solids overlap if they share more than this part of the smaller one.
OVERLAP = 1e-6
#: Most names of solids in a message, letters of each, and runs of numbers of each.
MOST_NAMES, LONGEST_NAME, MOST_RUNS = 4, 28, 3


@dataclass(frozen=True)
class NamedSolid:
    """A solid where it stands [mm], and its names in the file: its own first, then of what it is a part of."""

    solid: Any
    names: tuple[str, ...]

    @property
    def name(self) -> str:
        """The first of its names; empty if it has none."""
        return next(iter(self.names), "")


def one_solid(
    solids: Sequence[NamedSolid], shapes: Sequence[Any], asked: Sequence[str], path: Path
) -> tuple[Any, list[str]]:
    """Return the solid of a file, and what was done; bodies that touch are bonded, shells that close are filled.

    Parameters
    ----------
    solids, shapes
        What the file holds: its solids, and all that it has.
    asked
        Names or numbers of the solids that are meant; by default all.
    path
        The file.

    Raises
    ------
    InputError
        If there is no closed solid, none of a name, or several that cannot be taken as one.
    """
    if solids or asked:
        chosen = _chosen(solids, asked, path)
        some = f"Of the {len(solids)} solids of the file" if asked else "The file holds"
        called = " and ".join(_label(solids, k) for k in chosen)
        if len(chosen) == 1:
            return solids[chosen[0]].solid, [f"{some}, {called} is taken."] * (len(solids) > 1)
        count = f", {called} are taken" if asked else f" {len(solids)} solids that touch"
        return _fuse(solids, chosen, path, is_chosen=bool(asked)), [f"{some}{count}; they are bonded to one."]
    shells = [shell for shape in shapes for shell in shape.Shells()]
    faces = [face for shape in shapes for face in shape.Faces()]
    if not faces:
        raise InputError(path, "", None, "holds no faces; export the part as a solid body")
    solid, gap = _sewn(faces)
    if solid is None:
        remedy = (
            f"holds no solid, but {len(shells) or len(faces)} open shell{'s' * (len(shells) > 1)} with {gap} free "
            "edges; close the surface in the CAD program, and export a solid body"
        )
        raise InputError(path, "", None, remedy)
    return solid, [f"The file holds {len(faces)} faces and no solid; sewn together they close, and are filled."]


def _chosen(solids: Sequence[NamedSolid], asked: Sequence[str], path: Path) -> list[int]:
    """Return the indices of the solids that are meant: those of a name, or the one of a number."""
    chosen = set[int]()
    for each in asked:
        named = {k for k, solid in enumerate(solids) if each in solid.names}
        number = int(each) - 1 if each.isdecimal() else -1
        if not named and not 0 <= number < len(solids):
            known = f"; the file holds {listed(solids)}" if solids else "; the file holds no solid"
            raise InputError(path, "solids", each, f"no solid has this name or number{known}")
        chosen |= named or {number}
    return sorted(chosen) if asked else [*range(len(solids))]


def listed(solids: Sequence[NamedSolid]) -> str:
    """Return the names of solids, each with the numbers of those that have it: of the largest, as many as are read."""
    numbers = dict[str, list[int]]()
    for k in sorted(range(len(solids)), key=lambda k: -abs(solids[k].solid.Volume())):
        numbers.setdefault(solids[k].name, []).append(k + 1)
    named = [
        (f'"{shorten(name, LONGEST_NAME)}"' if name else "without a name") + f" ({_ranges(sorted(each))})"
        for name, each in numbers.items()
    ]
    more = len(named) - MOST_NAMES
    return ", ".join(named[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def _ranges(numbers: Sequence[int]) -> str:
    """Return whole numbers in ascending order in few words.

    >>> _ranges([1, 3, 4, 5, 8, 9])
    '1, 3-5, 8, 9'
    """
    runs = list[list[int]]()
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    few = [f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs]
    return ", ".join(few[:MOST_RUNS]) + ", …" * (len(few) > MOST_RUNS)


def _label(solids: Sequence[NamedSolid], k: int, longest: int = 1000) -> str:
    return f"solid {k + 1}" + f' "{shorten(solids[k].name, longest)}"' * bool(solids[k].name)


def _sewn(faces: Sequence[Any]) -> tuple[Any, int]:
    """Sew faces to a closed shell and fill it; None, and how many edges are free, where it does not close."""
    import cadquery as cq
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Sewing

    sewing = BRepBuilderAPI_Sewing(1e-4)
    for face in faces:
        sewing.Add(face.wrapped)
    sewing.Perform()
    shells = cq.Shape.cast(sewing.SewedShape()).Shells()
    if sewing.NbFreeEdges() or len(shells) != 1:
        return None, sewing.NbFreeEdges()
    return cq.Solid.makeSolid(shells[0]).fix(), 0


def _fuse(named: Sequence[NamedSolid], chosen: Sequence[int], path: Path, *, is_chosen: bool) -> Any:
    """Fuse solids that touch.

    Raises
    ------
    InputError
        If two overlap, or one touches no other.
    """
    solids = [named[k].solid for k in chosen]
    labels = [_label(named, k, LONGEST_NAME) for k in chosen]
    others = "" if is_chosen else f"; or take some of its solids (solids = [...], --solid): {listed(named)}"
    gaps = _gaps_of_boxes(solids)
    for first, second in np.argwhere(np.triu(gaps <= 0, 1)).tolist():
        common = solids[first].intersect(solids[second])
        shared = sum(solid.Volume() for solid in common.Solids())
        if shared > OVERLAP * min(solids[first].Volume(), solids[second].Volume()):
            remedy = (
                f"{labels[first]} and {labels[second]} of {len(named)} overlap by {shared:.3g} mm^3; "
                f"cut one from the other in the CAD program{others}"
            )
            raise InputError(path, "", None, remedy)
    fused = solids[0].fuse(*solids[1:])
    if len(fused.Solids()) == 1:
        return fused.Solids()[0]
    bodies = _of_each(fused.Solids(), solids)
    widest, lonely = _widest_gap(bodies, solids, gaps)
    why = f"{labels[lonely]} is {widest:.3g} mm away from the others" if widest > 0 else "they meet in no face"
    if len(bodies) < len(solids):
        told = "; ".join(_ranges([chosen[k] + 1 for k in body]) for body in bodies[:MOST_NAMES])
        more = f"; and {len(bodies) - MOST_NAMES} more" if len(bodies) > MOST_NAMES else ""
        why = f"only some of them touch, and make {len(bodies)} bodies (solids {told}{more}); {why}"
    remedy = f"holds {len(solids)} solids that cannot be bonded: {why}; export one body, or let them touch in faces"
    raise InputError(path, "", None, f"{remedy}{others}")


def _gaps_of_boxes(solids: Sequence[Any]) -> NDArray[np.float64]:
    """Return how far the bounding boxes of solids are apart at least, shape (n, n) [mm]; solids are no nearer."""
    boxes = [solid.BoundingBox() for solid in solids]
    low, high = (np.array([[getattr(box, f"{x}{end}") for x in "xyz"] for box in boxes]) for end in ("min", "max"))
    between = np.maximum(low[:, None] - high[None], low[None] - high[:, None])
    return np.asarray(np.linalg.norm(np.maximum(between, 0.0), axis=2))


def _of_each(bodies: Sequence[Any], solids: Sequence[Any]) -> list[list[int]]:
    """Return which solids each of the bodies that they make up holds, the one of the largest volume first."""
    gaps = _gaps_of_boxes([*bodies, *solids])[: len(bodies), len(bodies) :]
    held: list[list[int]] = [[] for _ in bodies]
    for k, solid in enumerate(solids):
        near = np.flatnonzero(gaps[:, k] <= 0).tolist()
        shared = {i: sum(each.Volume() for each in bodies[i].intersect(solid).Solids()) for i in near}
        held[max(near, key=lambda i: shared[i])].append(k)
    volumes = [sum(solids[k].Volume() for k in body) for body in held]
    return [held[i] for i in np.argsort(volumes)[::-1]]


def _widest_gap(bodies: Sequence[Sequence[int]], solids: Sequence[Any], gaps: NDArray[np.float64]) -> tuple[float, int]:
    """Return how far the body that is farthest from the others is away from them [mm], and its solid nearest to them.

    The distance of two solids takes a second: pairs whose boxes are farther apart than the nearest are left out.
    """
    found = list[tuple[float, int]]()
    for body in bodies:
        others = [k for other in bodies if other is not body for k in other]
        nearest = np.inf, body[0]
        for gap, one, other in sorted((gaps[i, j], i, j) for i in body for j in others):
            if gap >= nearest[0]:
                break
            nearest = min(nearest, (solids[one].distance(solids[other]), one))
        found.append(nearest)
    return max(reversed(found), key=lambda each: each[0])


def valid(solid: Any, path: Path) -> tuple[Any, list[str]]:
    """Return a solid without errors, healed where it has some, and what was done.

    Raises
    ------
    InputError
        If its boundary stays open, or crosses itself.
    """
    notes = []
    if not solid.isValid():
        fixed = solid.fix()
        healed = fixed.Solids()[0] if len(fixed.Solids()) == 1 else fixed
        if not healed.isValid() or not healed.Solids():
            remedy = "the solid is not valid, and healing fails: its boundary is open or crosses itself; repair it"
            raise InputError(path, "", None, f"{remedy} in the CAD program")
        change = healed.Volume() / solid.Volume() - 1 if solid.Volume() else 0.0
        notes.append(f"The solid was not valid and was healed; its volume changed by {100 * change:.2g} %.")
        solid = healed
    if solid.Volume() < 0:
        solid = _cast(solid.wrapped.Reversed())
        notes.append("The solid was inside out and was turned.")
    if not all(shell.Closed() for shell in solid.Shells()):
        raise InputError(path, "", None, "the solid's shell is open; close the surface in the CAD program")
    if solid.Volume() <= 0:
        raise InputError(path, "", None, "the solid has no volume; export the part as a solid body")
    if pair := _crossing(solid):
        remedy = (
            f"the solid's boundary crosses itself ({pair}); there change the feature that runs into itself or another, "
            "such as a thread, a fillet or a cut, and export anew"
        )
        raise InputError(path, "", None, remedy)
    return solid, notes


def _crossing(solid: Any) -> str:
    """Say which faces cross and between which corners of a box; empty if none do."""
    from OCP.BOPAlgo import BOPAlgo_ArgumentAnalyzer, BOPAlgo_CheckStatus

    analyzer = BOPAlgo_ArgumentAnalyzer()
    analyzer.SetShape1(solid.wrapped)
    analyzer.ArgumentTypeMode = False
    analyzer.SelfInterMode = True
    analyzer.SmallEdgeMode = False
    analyzer.Perform()
    faces = solid.Faces()
    for result in analyzer.GetCheckResult():
        if result.GetCheckStatus() != BOPAlgo_CheckStatus.BOPAlgo_SelfIntersect:
            continue
        shapes = [_cast(shape) for shape in (*result.GetFaultyShapes1(), *result.GetFaultyShapes2())]
        found = sorted({i for shape in shapes for i, face in enumerate(faces) if face.isSame(shape)})
        if not shapes:
            return "at an unknown place"
        boxes = [shape.BoundingBox() for shape in shapes]  # where they cross lies in all of them
        low = ", ".join(f"{round(max(getattr(box, f'{axis}min') for box in boxes), 3) + 0.0:g}" for axis in "xyz")
        high = ", ".join(f"{round(min(getattr(box, f'{axis}max') for box in boxes), 3) + 0.0:g}" for axis in "xyz")
        what = f"{'faces' if len(found) > 1 else 'face'} {' and '.join(f'{i + 1}' for i in found)}, " if found else ""
        return f"{what}between ({low}) and ({high}) mm"
    return ""


def _cast(shape: Any) -> Any:
    import cadquery as cq

    return cq.Shape.cast(shape)
