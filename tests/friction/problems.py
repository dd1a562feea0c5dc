"""Seeded random frictional problems with known structure, shared by the tests of the friction room."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from barchan.cones import Coulomb, Law
from barchan.friction import Problem


def random_problem(
    seed: int, n: int, s: int, bodies: int, dofs: int | None = None, law: Law | None = None, mu: float = 0.5
) -> Problem:
    """n random contacts between `bodies` bodies (or one body and the ground) with lumped masses.

    Normals push bodies together (f has a component along -H_N^T 1), so that many contacts are active.
    """
    rng = np.random.default_rng(seed)
    q = s if dofs is None else dofs
    rows, columns, values = [], [], []
    for i in range(n):
        pair = rng.choice(bodies, size=2, replace=False)
        for sign, body in zip((1.0, -1.0), pair[: 1 + (i % 3 > 0)], strict=False):
            block = sign * np.linalg.qr(rng.standard_normal((max(s, q), max(s, q))))[0][:s, :q]
            rows.append(np.repeat(i * s + np.arange(s), q))
            columns.append(np.tile(body * q + np.arange(q), s))
            values.append(block.ravel())
    triplets = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    H = sp.csr_array(triplets, shape=(n * s, bodies * q))
    mass = np.repeat(rng.uniform(0.5, 2.0, bodies), q)
    push = -H[::s].T @ rng.uniform(0.0, 1.0, n)
    f = push + 0.3 * rng.standard_normal(bodies * q)
    w = np.zeros(n * s)
    return Problem(
        M=sp.diags_array(mass),
        f=f,
        H=sp.bsr_array(H, blocksize=(s, q)),
        w=w,
        law=law or Coulomb(np.full(n, mu)),
    )


def stacked_blocks(levels: int, mu: float = 0.6) -> Problem:
    """A vertical pile of `levels` point masses, each resting on the one below by one 3D contact: the weights are known."""
    n, s = levels, 3
    H = sp.lil_array((n * s, levels * 3))
    for i in range(n):
        for k, axis in enumerate((2, 0, 1)):
            H[i * s + k, i * 3 + axis] = 1.0
            if i > 0:
                H[i * s + k, (i - 1) * 3 + axis] = -1.0
    f = np.tile([0.0, 0.0, -9.81], levels)
    return Problem(
        M=sp.eye_array(levels * 3, format="csr"),
        f=f,
        H=sp.csr_array(H),
        w=np.zeros(n * s),
        law=Coulomb(np.full(n, mu)),
    )


def lone_vertices(seed: int, n: int, law: Law) -> Problem:
    """n masses in space, each pushed against a contact of its own, in random frames: what the nodal method is for."""
    rng = np.random.default_rng(seed)
    frames = np.linalg.qr(rng.standard_normal((n, 3, 3)))[0]
    H = sp.bsr_array((frames, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n))
    f = -frames[:, 0] * rng.uniform(0.0, 1.0, (n, 1)) + 0.3 * rng.standard_normal((n, 3))
    mass = np.repeat(rng.uniform(0.5, 2.0, n), 3)
    return Problem(M=sp.diags_array(mass), f=f.ravel(), H=H, w=np.zeros(3 * n), law=law)
