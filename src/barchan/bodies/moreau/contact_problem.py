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
    """

    operator: sp.bsr_array
    offsets: Vector
    friction: Vector
    relative: Vector


def contact_rows(
    table: BodyTable, states: BodyStates, contacts: ContactSet, before: Vector, predicted: Vector, dt: float, options: Options,
) -> ContactRows:  # fmt: skip
    """Rows of the contacts.

    before, predicted : (k_b, 2, d) velocities at the start of the step, and at its end without contacts.
    """
    d, k = table.dimension, len(contacts.gaps)
    turn = contact_frames(contacts.normals)
    blocks, columns = np.empty((k, 4, d, d)), np.empty((k, 4), np.int64)
    for side, (number, sign) in enumerate(
        ((contacts.first.astype(np.int64), 1.0), (contacts.second.astype(np.int64), -1.0))
    ):
        own = table.columns(number, contacts.points, states)
        blocks[:, 2 * side : 2 * side + 2] = sign * np.einsum("kij,kbjl->kbil", turn, own)
        columns[:, 2 * side] = 2 * number
        columns[:, 2 * side + 1] = 2 * number + 1
    full = _operator(blocks, columns, len(table))
    relative = (full @ before.reshape(-1)).reshape(k, d)
    # Components that nothing moves have no columns: what they do goes to w.
    movable = table.movable(states)
    operator = _operator(blocks * movable.reshape(-1, d)[columns][:, :, None, :], columns, len(table))
    expected = (full @ predicted.reshape(-1)).reshape(k, d)
    driven = (full @ np.where(movable, 0.0, predicted).reshape(-1)).reshape(k, d)
    offsets = _offsets(contacts.gaps, relative, expected, dt, options) + driven
    return ContactRows(
        operator, offsets, pair_friction(table, contacts.first, contacts.second, options), relative
    )


def _operator(blocks: Vector, columns: NDArray[np.int64], bodies: int) -> sp.bsr_array:
    k, d = len(blocks), blocks.shape[2]
    order = np.argsort(columns, axis=1, kind="stable")
    rows = np.arange(k)[:, None]
    return sp.bsr_array(
        (
            np.ascontiguousarray(blocks[rows, order]).reshape(4 * k, d, d),
            np.ascontiguousarray(columns[rows, order], dtype=np.int32).reshape(-1),
            (4 * np.arange(k + 1)).astype(np.int32),
        ),
        shape=(k * d, 2 * bodies * d),
    )


def _offsets(gaps: Vector, relative: Vector, expected: Vector, dt: float, options: Options) -> Vector:
    theta = options.theta
    offsets = np.zeros_like(relative)
    open_share = np.where(gaps > 0.0, 1.0, options.recovery)
    offsets[:, 0] = (open_share * gaps / dt + (1.0 - theta) * relative[:, 0]) / theta
    if options.restitution > 0.0 or options.tangential_restitution > 0.0:
        closing = (relative[:, 0] < -options.rest_speed) & (gaps + dt * relative[:, 0] <= 0.0)
        approach = np.minimum(-relative[:, 0], expected[:, 0] - 2.0 * relative[:, 0])
        offsets[closing, 0] = -options.restitution * np.maximum(approach, 0.0)[closing]
        offsets[closing, 1:] = options.tangential_restitution * relative[closing, 1:]
    return offsets


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
