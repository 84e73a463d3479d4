"""The force method: what a frame gives way between a few loads, for any compliances of its members.

`frame.solve` finds the motions of every body and the forces of every member. A fit asks for less, and thousands of
times: the compliance between a few loads, of a frame that stays where it is while its members change. What is in
equilibrium is then found once. With B the parting per motion of the nodes, F the loads and C the compliances of the
members, their forces are

    f = P + N x,     B^T P = F,     B^T N = 0,     N^T C N x = - N^T C P:

P carries the loads, N holds the self-stresses, three for each closed loop, and the last equation says that the members
fit together. By virtual work the compliance between the loads is f^T C f: that of an x that is slightly off is right to
second order if C is symmetric (J. S. Przemieniecki, Theory of Matrix Structural Analysis, 1968).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg

from flexdesign.analytic import frame
from flexdesign.core.arrays import Array
from flexdesign.core.model import Linkage


class ForceMethod:
    """The forces that are in equilibrium with some loads on a frame.

    Parameters
    ----------
    linkage, held, loads, out_of_plane
        As for `frame.solve`.

    Raises
    ------
    frame.Mechanism
        If something can move although no member gives way.
    """

    def __init__(
        self,
        linkage: Linkage,
        held: Sequence[str],
        loads: Sequence[Mapping[str, Array]],
        *,
        out_of_plane: bool = False,
    ) -> None:
        parting, places = frame.parting(linkage, held, out_of_plane=out_of_plane)
        # Moments are counted over a length, so that they are comparable with forces.
        length = float(np.mean([member.length for member in linkage.members]))
        unit = np.array([1.0, length, length] if out_of_plane else [1.0, 1.0, length])
        count, size = parting.shape[0] // 3, parting.shape[1]
        rows, columns = np.tile(unit, count), np.tile(unit, size // 3)
        q, r, order = scipy.linalg.qr(rows[:, None] * parting / columns, pivoting=True)
        if parting.shape[0] < size or not _is_regular(np.abs(np.diag(r)), len(rows)):
            raise frame.Mechanism("the members leave something free to move")
        carried = frame.load_columns(loads, places, size) / columns[:, None]
        carrying = q[:, :size] @ scipy.linalg.solve_triangular(r[:size], carried[order], trans="T")
        self._loads = len(loads)
        self._forces = rows[:, None] * np.hstack([carrying, q[:, size:]])

    def compliance(self, compliances: Array) -> Array:
        """Return the compliance between the loads, row by the motion, column by the load.

        Parameters
        ----------
        compliances
            Of the members, in the order of the linkage, shape (m, 3, 3), as for `frame.solve`.

        Raises
        ------
        frame.Mechanism
            If members hold something twice without giving way.
        """
        forces, stresses = self._forces[:, : self._loads], self._forces[:, self._loads :]
        stretched = stresses.T @ _times(compliances, stresses)
        sizes = np.linalg.svd(stretched, compute_uv=False)
        if not _is_regular(sizes, len(stresses)):
            raise frame.Mechanism("the members hold something twice without giving way")
        for _ in range(2):  # the second time refines: what one member gives way may be a million times that of others
            forces = forces - stresses @ np.linalg.solve(stretched, stresses.T @ _times(compliances, forces))
        return np.asarray(forces.T @ _times(compliances, forces))


def _is_regular(sizes: Array, terms: int) -> bool:
    """Tell whether the last of descending sizes of a matrix exceeds the rounding of a sum of this number of terms."""
    return not len(sizes) or bool(sizes[-1] > terms * np.finfo(float).eps * sizes[0])


def _times(compliances: Array, forces: Array) -> Array:
    """Return the partings under forces, shape (3 m, k)."""
    return np.asarray(compliances @ forces.reshape(len(compliances), 3, -1)).reshape(forces.shape)
