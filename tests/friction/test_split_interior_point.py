"""The split central path: its scaling and directions obey what defines them, and its end obeys the certificate."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.cones import Coulomb, DruckerPrager, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, _split_barrier, certify, solve
from barchan.friction.methods._flow import is_flow

CELLS = 12
flow_module = importlib.import_module("barchan.friction.methods._flow")


def interior(seed: int, n: int, s: int) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Laws (n, 4) and a state inside all cones."""
    rng = np.random.default_rng(seed)
    laws = np.stack(
        [rng.uniform(0.1, 1.0, n), rng.uniform(0.0, 0.3, n), rng.uniform(0.0, 0.2, n), np.zeros(n)], axis=1
    )
    laws[:, 3] = rng.uniform(0.0, 1.0, n) * laws[:, 0]
    x, y = rng.standard_normal((n, s)), rng.standard_normal((n, s))
    x[:, 0] = rng.uniform(0.1, 2.0, n)
    z0 = laws[:, 0] * (x[:, 0] + laws[:, 2]) + laws[:, 1]
    x[:, 1:] *= (rng.uniform(0.0, 0.99, n) * z0 / np.linalg.norm(x[:, 1:], axis=1))[:, None]
    y[:, 0] = np.linalg.norm(y[:, 1:], axis=1) * rng.uniform(1.01, 3.0, n)
    return laws, (x, y, rng.uniform(0.01, 2.0, n))


def own_rates(laws: np.ndarray, state: tuple[np.ndarray, ...]) -> np.ndarray:
    """(w + zeta t, u_T), what the blocks take for their rates."""
    _, y, w = state
    return np.concatenate([(w + laws[:, 3] * y[:, 0])[:, None], y[:, 1:]], axis=1)


def complementarity(laws: np.ndarray, state: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray]:
    """z o y (n, s) and (x_N + tau_t) w (n,)."""
    x, y, w = state
    z = np.concatenate([(laws[:, 0] * (x[:, 0] + laws[:, 2]) + laws[:, 1])[:, None], x[:, 1:]], axis=1)
    product = z[:, :1] * y + y[:, :1] * z
    product[:, 0] = (z * y).sum(axis=1)
    return product, (x[:, 0] + laws[:, 2]) * w


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), s=st.sampled_from([2, 3, 6]), step=st.sampled_from([1e-4, 1e-5]))
def test_a_direction_without_corrections_obeys_the_linearised_equations(
    seed: int, s: int, step: float
) -> None:
    """With c, e for gap `center`: moving by dx changes complementarities to first order as asked, and own rates by c - K dx."""
    n = 7
    laws, state = interior(seed, n, s)
    scaling = (np.zeros((n, s)), np.zeros(n), np.zeros((n, s)))
    gap = _split_barrier.scale_blocks(1, laws, state, scaling)
    cone, line = complementarity(laws, state)
    assert gap == pytest.approx(cone[:, 0].sum() + line.sum(), rel=1e-12)
    D = np.empty((n, s, s))
    _split_barrier.stiffness(laws, state, scaling, np.ascontiguousarray(laws[:, 3]), 0.0, D)
    weights, still = np.ones(n), (np.zeros((n, s)), np.zeros((n, s)), np.zeros(n), np.zeros(n))
    target, right = (np.empty((n, s)), np.empty(n)), (np.empty((n, s)), np.empty(n))
    _split_barrier.target(1, laws, state, scaling, 0.3, weights, still, 0.0, target, right)
    dx = np.random.default_rng(seed).standard_normal((n, s))
    moved = tuple(np.zeros_like(part) for part in still)
    longest = _split_barrier.expand(1, laws, state, scaling, target, dx, moved)
    assert longest > 0.0
    # u = c' - K dx with c'_N = e + zeta c_0: D turns rates back into the forces they come from.
    change = np.concatenate([(moved[3] + laws[:, 3] * moved[1][:, 0])[:, None], moved[1][:, 1:]], axis=1)
    free = target[0].copy()
    free[:, 0] = target[1] + laws[:, 3] * target[0][:, 0]
    assert np.einsum("iab,ib->ia", D, free - change) == pytest.approx(dx, rel=1e-7, abs=1e-7)
    # The scalar pair to first order, by finite differences; the cone's pair at the scaling point, where it is symmetric.
    after = (state[0] + step * dx, state[1] + step * moved[1], state[2] + step * moved[3])
    slope = (complementarity(laws, after)[1] - line) / step
    assert slope == pytest.approx(
        0.3 - line, rel=1e-2, abs=20.0 * step * (1.0 + np.abs(dx[:, 0] * moved[3]).max())
    )


def test_at_the_centre_nothing_moves() -> None:
    """On the path y = tau z^-1, w = tau / l: the direction towards the same tau is zero."""
    n, s, tau = 5, 3, 0.7
    laws, (x, _, _) = interior(3, n, s)
    laws[:, 1] = 0.05
    z = np.concatenate([(laws[:, 0] * (x[:, 0] + laws[:, 2]) + laws[:, 1])[:, None], x[:, 1:]], axis=1)
    det = z[:, 0] ** 2 - (z[:, 1:] ** 2).sum(axis=1)
    y = tau * np.concatenate([z[:, :1], -z[:, 1:]], axis=1) / det[:, None]
    state = (x, y, tau / (x[:, 0] + laws[:, 2]))
    scaling = (np.zeros((n, s)), np.zeros(n), np.zeros((n, s)))
    _split_barrier.scale_blocks(1, laws, state, scaling)
    target, right = (np.empty((n, s)), np.empty(n)), (np.empty((n, s)), np.empty(n))
    still = (np.zeros((n, s)), np.zeros((n, s)), np.zeros(n), np.zeros(n))
    _split_barrier.target(1, laws, state, scaling, tau, np.ones(n), still, 0.0, target, right)
    moved = tuple(np.zeros_like(part) for part in still)
    _split_barrier.expand(1, laws, state, scaling, target, np.zeros((n, s)), moved)
    assert np.abs(moved[1]).max() < 1e-12 and np.abs(moved[3]).max() < 1e-12


def layered(law: object, s: int = 3, cells: int = CELLS) -> Problem:
    """A chain of layers sheared by a body force, M a stiffness matrix with a dense inverse: the smallest of flows."""
    line = sp.diags_array(
        [np.full(cells - 1, -1.0), np.full(cells, 2.0), np.full(cells - 1, -1.0)], offsets=[-1, 0, 1]
    )
    M = sp.csr_array(sp.kron(line, np.eye(s)) * cells)
    difference = sp.diags_array(
        [np.ones(cells), np.full(cells - 1, -1.0)], offsets=[0, -1], shape=(cells, cells)
    )
    H = sp.csr_array(sp.kron(difference, np.eye(s)))
    f = np.zeros((cells, s))
    f[:, 0], f[:, 1] = -1.0, 0.7
    return Problem(M=M, f=f.ravel(), H=H, w=np.zeros(cells * s), law=law, block_size=s)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "law",
    [
        SecondOrderCone(0.5),
        Coulomb(0.5),
        DruckerPrager(0.5, shear_yield=0.1),
        DruckerPrager(0.3, shear_yield=0.1, tensile_yield=0.2, dilatancy=0.1),
        DruckerPrager(0.0, shear_yield=0.3),
        Coulomb(0.0),
    ],
    ids=["associated", "Coulomb", "cohesive", "dilatant", "Bingham", "frictionless"],
)
@pytest.mark.parametrize("s", [2, 3, 6])
def test_every_law_is_solved_in_few_factorisations(law: object, s: int) -> None:
    problem = layered(law, s)
    solution = solve(problem, "split_interior_point", tol=1e-6)
    assert certify(problem, solution.r, solution.v).residual <= 1e-6
    assert solution.iterations <= 20


def test_variants_share_the_pattern_and_do_not_disturb_each_other() -> None:
    problem = layered(Coulomb(0.5))
    first = solve(problem, "split_interior_point", tol=1e-6)
    drift = np.full(problem.n * problem.s, 0.01)
    other = solve(problem.variant(Coulomb(0.3), drift), "split_interior_point", tol=1e-6)
    again = solve(problem, "split_interior_point", tol=1e-6)
    assert other.converged and not np.allclose(other.r, first.r)
    assert again.r.tobytes() == first.r.tobytes()
    fresh = solve(layered(Coulomb(0.5)), "split_interior_point", tol=1e-6)
    assert fresh.r.tobytes() == first.r.tobytes()


def test_what_it_cannot_do_is_said() -> None:
    problem = layered(Coulomb(0.5))
    with pytest.raises(InputError, match="corrections"):
        solve(problem, "split_interior_point", corrections=-1)
    C = sp.csr_array(np.eye(1, problem.size))
    bound = Problem(
        M=problem.M, f=problem.f, H=problem.H, w=problem.w, law=problem.law, C=C, k=np.zeros(1), block_size=3
    )
    with pytest.raises(InputError, match="needs M and H"):
        solve(bound, "split_interior_point")


def test_a_flow_is_told_from_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    small = layered(Coulomb(0.5), cells=80)
    assert not is_flow(small)  # W of so few rows is stored
    monkeypatch.setattr(flow_module, "SMALLEST_FLOW", 0)
    assert is_flow(small)
    bodies = Problem(M=sp.eye_array(small.size), f=small.f, H=small.H, w=small.w, law=small.law, block_size=3)
    assert not is_flow(bodies)
    few = Problem(M=small.M, f=small.f, H=small.H[:6], w=small.w[:6], law=small.law, block_size=3)
    assert not is_flow(few)


def test_auto_takes_flows_from_any_start_and_keeps_to_its_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow_module, "SMALLEST_FLOW", 0)
    problem = layered(Coulomb(0.5), cells=80)
    cold = solve(problem, "auto", tol=1e-6)
    warm = solve(problem, "auto", tol=1e-6, r0=0.999 * cold.r)
    assert cold.converged and warm.converged
    assert warm.history[0].residual < cold.history[0].residual
    assert solve(problem, "auto", tol=1e-13, max_iterations=250).iterations <= 250
