"""The friction problem of a Moreau-Jean step (seed B, 2.2.2, Eq. 2.14-2.16): contacts, bodies, joints.

    M v = M v* + H^T r + C^T l,   C v = k,   u = H v + w,   r [N] being mean forces over the step, M the inertia over dt.

w is the gap over the step: with w_N = (h / dt + (1 - theta) u_N^k) / theta the predicted gap h + dt (theta u^(k+1) +
(1 - theta) u^k) is never negative (2.14). Overlaps are pushed out by a share a step.

With Newton's restitution an approaching contact that would close within the step has u_N^(k+1) >= e a in place of that, with
the approach a = -u_N^k less what the loads of the step bring in, a = -2 u_N^k + u*_N if that is slower, u* being the velocity
without contacts: a body that falls rebounds with e (|u| - g dt), since it has its weight against it for the whole step after.
With e = 1 and a = |u| every impact would gain m g dt |u|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from barchan.bodies.contact import ContactSet
from barchan.bodies.moreau._rows import write_rows
from barchan.bodies.moreau.options import Options
from barchan.bodies.moreau.table import BodyTable
from barchan.bodies.rigid import BodyStates
from barchan.cones import Coulomb
from barchan.friction import Problem
from barchan.linalg.frames import contact_frames

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ContactRows:
    """H (k d, 2 k_b d) and what its rows say.

    operator : in blocks (d, d): normal and tangents of the velocity of `first` relative to `second`.
    offsets : (k, d) w [m/s].  friction : (k,).  relative : (k, d) u at the start of the step.
    driven : (k, d) what given motions add to u.  rebound : (k, d) the part of w that is restitution.
    """

    operator: sp.bsr_array
    offsets: Vector
    friction: Vector
    relative: Vector
    driven: Vector
    rebound: Vector


def contact_rows(
    table: BodyTable, states: BodyStates, contacts: ContactSet, before: Vector, predicted: Vector, dt: float, options: Options,
) -> ContactRows:  # fmt: skip
    """Rows of the contacts.

    before, predicted : (k_b, 2, d) velocities at the start of the step, and at its end without contacts.
    """
    d, k = table.dimension, len(contacts.gaps)
    movable = table.movable(states)
    bodies = np.stack([contacts.first, contacts.second], axis=1)
    # Bodies that nothing moves have no columns: what they do goes to w, and they join no contacts together.
    counts = 2 * np.any(movable, axis=(1, 2))[bodies].sum(axis=1)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    data, indices = np.empty((int(starts[-1]), d, d)), np.empty(int(starts[-1]), np.int32)
    given, rates = np.stack([before, predicted, np.where(movable, 0.0, predicted)]), np.empty((3, k, d))
    write_rows(
        contact_frames(contacts.normals), contacts.points, bodies, table.centres_of(states),
        table.spin_axes(states) if d == 3 else np.zeros((0, 3, 3)), movable.astype(np.float64), starts, given,
        data, indices, rates,
    )  # fmt: skip
    relative, expected, driven = rates
    operator = sp.bsr_array((data, indices, starts), shape=(k * d, 2 * len(table) * d))
    offsets, rebound = _offsets(contacts.gaps, relative, expected, dt, options)
    friction = pair_friction(table, contacts.first, contacts.second, options)
    return ContactRows(operator, offsets + driven, friction, relative, driven, rebound)


def _offsets(
    gaps: Vector, relative: Vector, expected: Vector, dt: float, options: Options
) -> tuple[Vector, Vector]:
    """w (k, d) without given motions, and the part of it that is restitution."""
    theta = options.theta
    offsets, rebound = np.zeros_like(relative), np.zeros_like(relative)
    open_share = np.where(gaps > 0.0, 1.0, options.recovery)
    offsets[:, 0] = (open_share * gaps / dt + (1.0 - theta) * relative[:, 0]) / theta
    if options.restitution > 0.0 or options.tangential_restitution > 0.0:
        closing = (relative[:, 0] < -options.rest_speed) & (gaps + dt * relative[:, 0] <= 0.0)
        approach = np.minimum(-relative[:, 0], expected[:, 0] - 2.0 * relative[:, 0])
        rebound[closing, 0] = -options.restitution * np.maximum(approach, 0.0)[closing]
        rebound[closing, 1:] = options.tangential_restitution * relative[closing, 1:]
        offsets[closing] = rebound[closing]
    return offsets, rebound


def pair_friction(
    table: BodyTable, first: NDArray[np.int32], second: NDArray[np.int32], options: Options
) -> Vector:
    """(k,) coefficients of pairs of bodies: those given by names, else mixed from the bodies' own."""
    one, two = table.friction[first], table.friction[second]
    rule = {"geometric": lambda: np.sqrt(one * two), "mean": lambda: 0.5 * (one + two)}
    rule |= {"min": lambda: np.minimum(one, two), "max": lambda: np.maximum(one, two)}
    found = np.array(rule[options.mixing]())
    if options.pairs:
        names = np.array([body.name for body in table.bodies])
        for (a, b), value in options.pairs.items():
            found[
                ((names[first] == a) & (names[second] == b)) | ((names[first] == b) & (names[second] == a))
            ] = value
    return found


def step_problem(
    masses: Vector, predicted: Vector, rows: ContactRows, dt: float, joints: tuple[sp.csr_array, Vector] | None,
    movable: NDArray[np.bool_], reference: float,
) -> Problem:  # fmt: skip
    """The problem with `masses` and `predicted` (k_b, 2, d), of which `movable` (k_b, 2, d) forces can change.

    joints : C (c, 2 k_b d) and k (c,) of bilateral rows.  reference : force of the certificate [N].
    """
    d = masses.shape[2]
    inertia = masses.reshape(-1) / dt
    C, k = (None, None) if joints is None else joints
    if C is not None and k is not None:
        k = k - C @ np.where(movable, 0.0, predicted).reshape(-1)
        C = sp.csr_array(C @ sp.diags_array(movable.reshape(-1).astype(float)))
    return Problem(
        M=sp.dia_array((inertia[None, :], [0]), shape=(len(inertia), len(inertia))),
        f=inertia * predicted.reshape(-1), H=rows.operator, w=rows.offsets.reshape(-1), law=Coulomb(rows.friction), C=C, k=k,
        block_size=d, reference_force=reference,
    )  # fmt: skip
