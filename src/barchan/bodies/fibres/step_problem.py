"""The friction problem of a step of fibres (seed B, Eq. 2.14-2.16): the model's blocks, and the rows of the contacts.

    A v = f + H^T r,   u = H v + w,   r [N] being mean forces over the step, A the linearised inertia over dt,

v the velocities of the fibres at the end of the step; w holds what given motions do and the gap over dt, so that the predicted
gap is never negative; of an overlap a share is pushed out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.bodies.fibres import _contact_kernels as kernels
from barchan.bodies.fibres.contact import FibreContacts
from barchan.bodies.fibres.model import FibreModel, FibreSystem, Shape
from barchan.bodies.fibres.obstacles import point_velocities
from barchan.bodies.rigid import Body, BodyStates
from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FibreRows:
    """Rows of k contacts in their frames: H (3 k, m) and w (k, 3) [m/s]."""

    operator: sp.csr_array
    offsets: Vector


def contact_rows(
    model: FibreModel[Shape], shape: Shape, contacts: FibreContacts, bodies: Sequence[Body], states: BodyStates, blocks: Vector,
    dt: float, recovery: float,
) -> FibreRows:  # fmt: skip
    """The rows of contacts with bodies that move at `blocks` (b, 2, 3); `recovery` is the share of an overlap pushed out."""
    k = len(contacts)
    two_fibres = contacts.fibres[:, 1] >= 0
    # a point of its own for either side; against a body the second is the first again, and not looked at
    sides = np.where(two_fibres, 1, 0)
    either = np.arange(k)
    fibre = np.concatenate([contacts.fibres[:, 0], contacts.fibres[either, sides]])
    segment = np.concatenate([contacts.segments[:, 0], contacts.segments[either, sides]])
    share = np.concatenate([contacts.shares[:, 0], contacts.shares[either, sides]])
    points = model.rows(shape, dt, fibre, segment, share)
    turns = contact_frames(contacts.normals)
    driven = points.drift[:k] - np.where(two_fibres[:, None], points.drift[k:], 0.0)
    for number, body in enumerate(bodies):
        here = np.flatnonzero(contacts.bodies == number)
        if len(here):
            driven[here] -= point_velocities(body, states.row(number), blocks[number], contacts.points[here])
    offsets = np.einsum("kij,kj->ki", turns, driven)
    offsets[:, 0] += np.where(contacts.gaps > 0.0, 1.0, recovery) * contacts.gaps / dt
    return FibreRows(_operator(model.offsets, contacts.fibres, points.values, points.starts, turns), offsets)


def _operator(offsets: Whole, fibres: Whole, values: Vector, starts: Whole, turns: Vector) -> sp.csr_array:
    k = len(fibres)
    counts = np.zeros(k, dtype=np.int64)
    kernels.count_columns(fibres, offsets, values, starts, counts)
    indptr = np.concatenate([[0], np.cumsum(np.repeat(counts, 3))]).astype(np.int32)
    indices, data = np.empty(int(indptr[-1]), dtype=np.int32), np.empty(int(indptr[-1]))
    kernels.write_rows(fibres, offsets, values, starts, turns, indptr, indices, data)
    matrix = sp.csr_array((data, indices, indptr), shape=(3 * k, int(offsets[-1])))
    matrix.has_sorted_indices = matrix.has_canonical_format = True
    return matrix


def without_fixed(contacts: FibreContacts, rows: FibreRows) -> tuple[FibreContacts, FibreRows]:
    """Without contacts between points that nothing can move, such as held roots."""
    moving = np.flatnonzero(np.diff(rows.operator.indptr)[::3] > 0)
    if len(moving) == len(contacts):
        return contacts, rows
    kept = (3 * moving[:, None] + np.arange(3)).ravel()
    return contacts.take(moving), FibreRows(sp.csr_array(rows.operator[kept]), rows.offsets[moving])


class BlockPattern:
    """Where the entries of block-diagonal matrices with blocks of the orders offsets[i + 1] - offsets[i] are: found once."""

    def __init__(self, offsets: Whole) -> None:
        sizes = np.diff(offsets)
        width = np.repeat(sizes, sizes)
        self.size = int(offsets[-1])
        self.indptr = np.concatenate([[0], np.cumsum(width)]).astype(np.int32)
        within = np.arange(self.indptr[-1]) - np.repeat(self.indptr[:-1], width)
        self.indices = (np.repeat(np.repeat(offsets[:-1], sizes), width) + within).astype(np.int32)

    def matrix(self, system: FibreSystem) -> sp.csr_array:
        """A (m, m) of a system whose blocks follow one another."""
        found = sp.csr_array((system.blocks, self.indices, self.indptr), shape=(self.size, self.size))
        found.has_sorted_indices = found.has_canonical_format = True
        return found
