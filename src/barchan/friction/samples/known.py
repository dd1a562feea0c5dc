"""Random frictional problems whose answer is known beforehand: a solution, and proof that one exists or that none does.

A solution (v, r) of seed B Eq. (2.17) is drawn first and f, w follow from it. Contact frames are turned towards one motion
that opens every contact, which makes criterion H(0) of Theorem 2.1 hold; unsolvable problems carry a Farkas multiplier.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from barchan.cones import Coulomb
from barchan.errors import InputError
from barchan.friction.problem import Problem

DETACHED, STICKING, SLIDING = 0, 1, 2
LARGEST_TILT = 0.7  # of the half-angle of the dual cone, for the opening motion
TO_GROUND = 0.25
FARTHEST_NEIGHBOUR = 4
JAMMED = 3  # contacts of one pair of bodies that no velocity can satisfy together


@dataclass(frozen=True, eq=False)
class Sample:
    """A problem and what is known about it.

    velocity : (m,) and forces : (n, s) of a solution; None where there is no solution.
    status : (n,) DETACHED, STICKING or SLIDING, of that solution; None likewise.
    interior : (m,) velocity with C v = k and H v + w inside the dual cones, the proof of H(0); None likewise.
    refutation : (n,) multipliers y >= 0 with sum y_i (H^T e_N)_i = 0 and y . w_N < 0, the proof that no velocity has
        u_N >= 0; None where there is a solution.
    """

    problem: Problem
    velocity: np.ndarray | None = None
    forces: np.ndarray | None = None
    status: np.ndarray | None = None
    interior: np.ndarray | None = None
    refutation: np.ndarray | None = None


@dataclass
class _Contacts:
    """Contacts between bodies: `first`, `second` (n,) bodies (second -1: the ground), `near`, `far` (n, s, q) Jacobians."""

    first: np.ndarray
    second: np.ndarray
    near: np.ndarray
    far: np.ndarray

    def opening(self, motion: np.ndarray) -> np.ndarray:
        """(n, s) relative velocities of a motion (bodies, q)."""
        grounded = (self.second < 0)[:, None]
        far = np.einsum("isq,iq->is", self.far, motion[self.second])
        return np.asarray(
            np.einsum("isq,iq->is", self.near, motion[self.first]) + np.where(grounded, 0.0, far)
        )

    def matrix(self, bodies: int) -> sp.bsr_array:
        """H (n s, bodies q) in s x q blocks."""
        return block_jacobian(self.first, self.second, self.near, self.far, bodies)


def block_jacobian(
    first: np.ndarray, second: np.ndarray, near: np.ndarray, far: np.ndarray, bodies: int
) -> sp.bsr_array:
    """H (n s, bodies q) from the blocks (n, s, q) of two bodies (n,) per contact; `second` is -1 at the ground."""
    n, s, q = near.shape
    paired = second >= 0
    columns = np.stack([first, second], axis=1)
    blocks = np.stack([near, far], axis=1)
    swap = paired & (second < first)
    columns[swap] = columns[swap][:, ::-1]
    blocks[swap] = blocks[swap][:, ::-1]
    stored = np.stack([np.ones(n, dtype=bool), paired], axis=1)
    indptr = np.concatenate([[0], np.cumsum(1 + paired)]).astype(np.int32)
    return sp.bsr_array((blocks[stored], columns[stored].astype(np.int32), indptr), shape=(n * s, bodies * q))


def sample(
    n: int,
    s: int = 3,
    ratio: float = 1.0,
    mu: float | tuple[float, float] = 0.5,
    seed: int = 0,
    constraints: int = 0,
    condition: float = 100.0,
    solvable: bool = True,
) -> Sample:
    """A random problem of n blocks of size s between bodies that a contact couples in twos, or to the ground.

    A third of the contacts each is detached, sticking and sliding in the known solution.

    Parameters
    ----------
    ratio : conditioning ratio n s / m, 0.1 to 10 in seed B 4.1; above 1 several contacts share a body of s unknowns, below 1
        each body has s / ratio. Exact when n / ratio (or s / ratio, below 1) is a whole number, else rounded.
    mu : friction coefficient, or the bounds of a uniform draw.
    constraints : rows of C, each coupling two bodies; at most half of the velocity unknowns.
    condition : condition number of the mass matrix of one body; 1 makes M diagonal.
    solvable : False makes JAMMED contacts close on one pair of bodies whatever the velocity (needs n >= 3).

    Raises
    ------
    InputError : n, s, ratio, mu, constraints or condition out of range.
    """
    _check(n, s, ratio, mu, constraints, condition, solvable)
    rng = np.random.default_rng(seed)
    bodies, q = (max(1, round(n / ratio)), s) if ratio >= 1.0 else (n, round(s / ratio))
    friction = np.full(n, float(mu)) if not isinstance(mu, tuple) else rng.uniform(*mu, size=n)
    mass = _mass(rng, bodies, q, condition)
    motion = rng.standard_normal((bodies, q))
    contacts = _contacts(rng, n, s, bodies, q)
    _turn_towards(rng, contacts, motion, friction)
    if constraints > bodies * q // 2:
        raise InputError("constraints", constraints, f"at most {bodies * q // 2}, half of the unknowns")
    C = _constraints(rng, constraints, motion)
    velocity = rng.standard_normal(bodies * q)
    status, u, r = _lawful(rng, n, s, friction)
    refutation = None if solvable else _jam(rng, contacts)
    H = contacts.matrix(bodies)
    f = mass @ velocity - H.T @ r.ravel() - C.T @ rng.standard_normal(constraints)
    w = u.ravel() - H @ velocity
    if refutation is not None:
        w[: JAMMED * s : s] -= (refutation @ w[::s] + rng.uniform(0.5, 1.0)) / refutation.sum()
    bilateral = {"C": C, "k": C @ velocity} if constraints else {}
    problem = Problem(M=mass, f=f, H=H, w=w, law=Coulomb(friction), block_size=s, **bilateral)
    if refutation is not None:
        return Sample(problem, refutation=refutation)
    interior = velocity + _far_enough(contacts.opening(motion), u, friction) * motion.ravel()
    return Sample(problem, velocity, r, status, interior)


def _check(
    n: int, s: int, ratio: float, mu: object, constraints: int, condition: float, solvable: bool
) -> None:
    fewest = 1 if solvable else JAMMED
    if n < fewest:
        raise InputError("n", n, f"at least {fewest}")
    if s < 2:
        raise InputError("s", s, "at least 2")
    if not 0.0 < ratio <= n:
        raise InputError("ratio", ratio, f"above 0 and at most n = {n}, which leaves one body")
    bounds = mu if isinstance(mu, tuple) else (mu, mu)
    if len(bounds) != 2 or not 0.0 <= bounds[0] <= bounds[1] < np.inf:
        raise InputError("mu", mu, "a finite number >= 0, or (least, largest)")
    if constraints < 0:
        raise InputError("constraints", constraints, "at least 0")
    if not 1.0 <= condition < np.inf:
        raise InputError("condition", condition, "finite and at least 1")


def _rotations(rng: np.random.Generator, count: int, q: int) -> np.ndarray:
    """(count, q, q) random orthogonal matrices."""
    return np.asarray(np.linalg.qr(rng.standard_normal((count, q, q)))[0])


def _mass(rng: np.random.Generator, bodies: int, q: int, condition: float) -> sp.csr_array:
    """Block-diagonal (bodies q, bodies q), each block of the given condition number; masses spread over a decade."""
    spread = rng.uniform(-0.5, 0.5, (bodies, q))
    spread[:, 0], spread[:, -1] = -0.5, 0.5
    eigenvalues = condition**spread * 10.0 ** rng.uniform(-0.5, 0.5, (bodies, 1))
    if condition == 1.0:
        return sp.csr_array(sp.diags_array(eigenvalues.ravel()))
    axes = _rotations(rng, bodies, q)
    blocks = np.einsum("iab,ib,icb->iac", axes, eigenvalues, axes)
    blocks = 0.5 * (blocks + blocks.transpose(0, 2, 1))
    places = np.arange(bodies + 1, dtype=np.int32)
    return sp.csr_array(sp.bsr_array((blocks, places[:-1], places), shape=(bodies * q, bodies * q)))


def _contacts(rng: np.random.Generator, n: int, s: int, bodies: int, q: int) -> _Contacts:
    """Every body is touched when there are as many contacts; the other body is a near one, or the ground."""
    first = rng.permutation(np.arange(n) % bodies)
    offset = (
        rng.integers(1, min(FARTHEST_NEIGHBOUR, bodies - 1) + 1, size=n) if bodies > 1 else np.zeros(n, int)
    )
    second = (first + offset) % bodies
    second[(rng.random(n) < TO_GROUND) | (bodies == 1)] = -1
    near = _rotations(rng, n, q)[:, :s]
    far = -rng.uniform(0.5, 1.5, (n, 1, 1)) * _rotations(rng, n, q)[:, :s]
    return _Contacts(first, second, near, far)


def _turn_towards(
    rng: np.random.Generator, contacts: _Contacts, motion: np.ndarray, friction: np.ndarray
) -> None:
    """Reflect the contact frames so that `motion` (bodies, q) opens every contact, inside the dual cone."""
    u = contacts.opening(motion)
    n, s = u.shape
    angle = rng.uniform(0.0, LARGEST_TILT, n) * np.arctan2(1.0, friction)
    goal = np.column_stack([np.cos(angle), np.sin(angle)[:, None] * _directions(rng, n, s - 1)])
    mirror = u / np.linalg.norm(u, axis=1, keepdims=True) - goal
    scale = 2.0 / np.maximum((mirror**2).sum(axis=1), 1e-30)
    turn = np.eye(s) - scale[:, None, None] * mirror[:, :, None] * mirror[:, None, :]
    contacts.near = turn @ contacts.near
    contacts.far = turn @ contacts.far


def _directions(rng: np.random.Generator, n: int, size: int) -> np.ndarray:
    """(n, size) unit vectors."""
    x = rng.standard_normal((n, size))
    return np.asarray(x / np.linalg.norm(x, axis=1, keepdims=True))


def _constraints(rng: np.random.Generator, count: int, motion: np.ndarray) -> sp.csr_array:
    """C (count, bodies q): each row couples two successive bodies and leaves `motion` free."""
    bodies, q = motion.shape
    first = np.arange(count) % bodies
    index = np.stack([first, (first + 1) % bodies], axis=1)[:, : min(2, bodies)]
    local = motion[index].reshape(count, index.shape[1] * q)
    rows = rng.standard_normal(local.shape)
    rows -= ((rows * local).sum(axis=1) / (local**2).sum(axis=1))[:, None] * local
    columns = (index[:, :, None] * q + np.arange(q)).reshape(local.shape)
    row = np.repeat(np.arange(count), local.shape[1])
    return sp.csr_array((rows.ravel(), (row, columns.ravel())), shape=(count, bodies * q))


def _lawful(
    rng: np.random.Generator, n: int, s: int, friction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Status (n,), relative velocities and forces (n, s) that obey the Coulomb law, Eq. (1.1) of seed B."""
    status = rng.permutation(np.arange(n) % 3)
    size, speed = np.exp(rng.standard_normal((2, n)))
    direction = _directions(rng, n, s - 1)
    share = np.where(status == SLIDING, 1.0, rng.uniform(0.0, 0.9, n))
    r = size[:, None] * np.column_stack([np.ones(n), -(friction * share)[:, None] * direction])
    u = speed[:, None] * np.column_stack([status == DETACHED, direction])
    r[status == DETACHED] = 0.0
    u[status == STICKING] = 0.0
    return status, u, r


def _jam(rng: np.random.Generator, contacts: _Contacts) -> np.ndarray:
    """Put the first JAMMED contacts on one pair of bodies, their normals positively dependent; the multipliers (n,)."""
    contacts.first[:JAMMED] = contacts.first[0]
    contacts.second[:JAMMED] = contacts.second[0]
    y = np.zeros(len(contacts.first))
    y[:JAMMED] = rng.uniform(0.5, 1.5, JAMMED)
    for blocks in (contacts.near, contacts.far):
        others = np.einsum("i,iq->q", y[: JAMMED - 1], blocks[: JAMMED - 1, 0])
        blocks[JAMMED - 1, 0] = -others / y[JAMMED - 1]
    return y


def _far_enough(opening: np.ndarray, u: np.ndarray, friction: np.ndarray) -> float:
    """A multiple t of the opening motion for which u + t opening is inside every dual cone."""
    gain = opening[:, 0] - friction * np.linalg.norm(opening[:, 1:], axis=1)
    need = friction * np.linalg.norm(u[:, 1:], axis=1) - u[:, 0]
    return max(1.0, 2.0 * float((need / gain).max()))
