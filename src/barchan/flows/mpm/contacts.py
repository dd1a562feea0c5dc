"""Frictional contacts of the matter with walls and rigid bodies: rows of the friction problem (seed B, 7.4.1).

A contact stands for a patch of boundary; its block of r is the traction on the matter in Pa, (normal; tangents), under
Coulomb's law. Tractions live on the nodes of the grid, as Lagrange multipliers; the seed's tensor form of the same coupling
(appendix C.2) sticks with another cone than it slides with, the vector form has one cone for both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.flows.mpm.velocity import VelocityField
from barchan.flows.mpm.walls import Walls

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Contacts:
    """k contacts; relative velocities are those of the matter to the boundary.

    keys : (k,) int64 lasting names.  areas : (k,) [m^(d-1)].  frames : (k, d, d) rows: normal into the matter, tangents.
    friction : (k,) physical coefficients.
    indptr, indices, weights : (k + 1,), (nnz,) velocity numbers and (nnz,) areas with which they count [m^(d-1)].
    bodies : (k,) number of the free body, -1 for a boundary whose motion is given.
    columns : (k, 2, d, d) area x velocity of the boundary as a function of the body's translation and rotation.
    driven : (k, d) area x velocity of a boundary whose motion is given [m^d/s].
    """

    keys: NDArray[np.int64]
    areas: Vector
    frames: Vector
    friction: Vector
    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    weights: Vector
    bodies: NDArray[np.int64]
    columns: Vector
    driven: Vector

    def __len__(self) -> int:
        return len(self.keys)

    @property
    def velocities_of_boundary(self) -> Vector:
        """(k, d) -area x given velocity in the frames (normal; tangents): what is added to H v."""
        return -np.asarray(np.einsum("kij,kj->ki", self.frames, self.driven))


def joined(parts: list[Contacts], d: int) -> Contacts:
    """All contacts one after the other."""
    indptr, start = [np.zeros(1, dtype=np.int32)], 0
    for part in parts:
        indptr.append(part.indptr[1:] + np.int32(start))
        start += int(part.indptr[-1])
    return Contacts(
        np.concatenate([np.zeros(0, dtype=np.int64)] + [part.keys for part in parts]),
        np.concatenate([np.zeros(0)] + [part.areas for part in parts]),
        np.concatenate([np.zeros((0, d, d))] + [part.frames for part in parts]),
        np.concatenate([np.zeros(0)] + [part.friction for part in parts]),
        np.concatenate(indptr).astype(np.int32),
        np.concatenate([np.zeros(0, dtype=np.int32)] + [part.indices for part in parts]),
        np.concatenate([np.zeros(0)] + [part.weights for part in parts]),
        np.concatenate([np.zeros(0, dtype=np.int64)] + [part.bodies for part in parts]),
        np.concatenate([np.zeros((0, 2, d, d))] + [part.columns for part in parts]),
        np.concatenate([np.zeros((0, d))] + [part.driven for part in parts]),
    )


def wall_contacts(field: VelocityField, walls: Walls, volumes: Vector) -> Contacts:
    """Contacts of velocity functions with the frictional faces; keys are `id * 2 d + face`.

    The area a function stands for is its volume of matter, `volumes` (n,) [m^d], over the integral of its shape across
    the face: half a cell's height for hat functions, a third for splines.
    """
    basis, d = field.basis, field.basis.dimension
    parts = []
    for face, wall in enumerate(walls.on(d)):
        if wall.kind != "friction":
            continue
        axis, upper = divmod(face, 2)
        found = np.flatnonzero(basis.on_face(field.ids, axis, bool(upper)))
        normal = np.zeros(d)
        normal[axis] = -1.0 if upper else 1.0
        frame = np.roll(np.eye(d), -axis, axis=0)
        frame[0] = normal
        areas = volumes[found] * (basis.order + 1) / basis.grid.spacing[axis]
        count = len(found)
        parts.append(
            Contacts(
                field.ids[found] * (2 * d) + face,
                areas,
                np.broadcast_to(frame, (count, d, d)),
                np.full(count, float(wall.friction)),
                np.arange(count + 1, dtype=np.int32),
                found.astype(np.int32),
                areas,
                np.full(count, -1),
                np.zeros((count, 2, d, d)),
                np.zeros((count, d)),
            )
        )
    return joined(parts, d)


def with_contact_rows(
    strain: sp.bsr_array, contacts: Contacts, free: NDArray[np.bool_], free_bodies: int
) -> sp.bsr_array:
    """The operator of the whole problem: strain rows, then one block (s, d) per contact; n + 2 free_bodies block columns.

    The relative velocity is scaled by the contact's area, so that the block of r is a traction in Pa. The s - d rows left
    over are zero and their stresses stay at zero. Columns of components that are not `free` (n, d) are zero.
    """
    size, d = strain.blocksize
    columns = strain.shape[1] // d
    shape_columns = (columns + 2 * free_bodies) * d
    if len(contacts) == 0:
        return sp.bsr_array(
            (strain.data, strain.indices, strain.indptr), shape=(strain.shape[0], shape_columns)
        )
    rows = np.repeat(np.arange(len(contacts)), np.diff(contacts.indptr))
    matter = contacts.weights[:, None, None] * contacts.frames[rows] * free[contacts.indices][:, None, :]
    coupled = np.flatnonzero(contacts.bodies >= 0)
    of_bodies = -np.einsum("kij,kbjl->kbil", contacts.frames[coupled], contacts.columns[coupled])
    all_rows = np.concatenate([rows, np.repeat(coupled, 2)])
    all_columns = np.concatenate(
        [contacts.indices, (columns + 2 * contacts.bodies[coupled][:, None] + np.arange(2)).reshape(-1)]
    )
    blocks = np.zeros((len(all_rows), size, d))
    blocks[:, :d, :] = np.concatenate([matter, of_bodies.reshape(-1, d, d)])
    order = np.lexsort((all_columns, all_rows))
    counts = np.bincount(all_rows, minlength=len(contacts))
    indptr = np.concatenate([strain.indptr, strain.indptr[-1] + np.cumsum(counts)]).astype(np.int32)
    indices = np.concatenate([strain.indices, all_columns[order]]).astype(np.int32)
    data = np.concatenate([strain.data, blocks[order]])
    return sp.bsr_array((data, indices, indptr), shape=((len(indptr) - 1) * size, shape_columns))
