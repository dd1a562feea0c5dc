"""The scalar form of Coulomb's one-block problem obeys the law and agrees with the general secular solver."""

import numpy as np
import pytest
from numba import njit

from barchan.cones import Coulomb
from barchan.friction.local._coulomb import solve_exact
from barchan.friction.local._decompose import local_blocks
from barchan.friction.local._secular import solve_secular


@njit
def _exact(s, rows, rhs, laws, out, c, t):
    multipliers = np.empty(len(rhs))
    for i in range(len(rhs)):
        if s == 2:
            multipliers[i] = solve_exact(2, i, rows, rhs[i], laws, 0.0, out[i], c, t)
        else:
            multipliers[i] = solve_exact(3, i, rows, rhs[i], laws, 0.0, out[i], c, t)
    return multipliers


def _blocks(s: int, condition: float, seed: int = 5, n: int = 3000):
    rng = np.random.default_rng(seed)
    frames = np.linalg.qr(rng.normal(size=(n, s, s)))[0]
    values = condition ** -rng.uniform(0.0, 1.0, (n, s))
    W, _ = local_blocks(np.einsum("iab,ib,icb->iac", frames, values, frames))
    return W, rng.normal(size=(n, s))


@pytest.mark.parametrize("mu", [0.0, 0.04, 0.7, 1.5])
@pytest.mark.parametrize("condition", [1.0, 1e4])
@pytest.mark.parametrize("s", [2, 3])
def test_blocks_obey_coulombs_law(s, condition, mu):
    W, b = _blocks(s, condition)
    _, rows = local_blocks(W)
    law = Coulomb(mu)
    r = np.zeros_like(b)
    _exact(s, rows, b, law.parameters(len(b)), r, np.empty(s), np.empty(s))
    u = np.einsum("iab,ib->ia", W, r) + b
    rho = s / np.einsum("iaa->i", W)
    miss = np.linalg.norm(law.natural_map(u, r, rho), axis=1)
    size = np.maximum(np.linalg.norm(r, axis=1), rho * np.linalg.norm(b, axis=1))
    assert (miss / size).max() < 1e-9
    contact = r[:, 0] > 0.0
    assert contact.any() and not contact.all()


@pytest.mark.parametrize("s", [2, 3])
def test_agrees_with_the_general_solver(s):
    W, b = _blocks(s, 100.0)
    _, rows = local_blocks(W)
    laws = Coulomb(0.6).parameters(len(b))
    r, general = np.zeros_like(b), np.zeros_like(b)
    multipliers = _exact(s, rows, b, laws, r, np.empty(s), np.empty(s))
    for i in range(len(b)):
        a = solve_secular(s, rows[i], b[i], 0.6, 0.0, 0.0, 0.0, 0.0, general[i], np.empty(s), np.empty(s))
        if s == 3:
            assert multipliers[i] == pytest.approx(a, rel=1e-6, abs=1e-9)
    np.testing.assert_allclose(r, general, rtol=1e-9, atol=1e-10)
