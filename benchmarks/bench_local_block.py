"""Nanoseconds of one block solve within a Gauss-Seidel sweep, on one thread, for each local solver in the same run.

A sweep from zero forces gathers the right-hand side, solves the block and spreads the change; checks of the residual are
included. s = 3 on a stored W, s = 6 on the factored operator with 27 velocity nodes a block (the inner stencil of a 3D flow).
"""

from __future__ import annotations

import argparse
from itertools import product
from time import perf_counter

import numba
import numpy as np
import scipy.sparse as sp

from _table import print_table
from barchan.cones import Coulomb
from barchan.friction import Problem, solve


def pile(n: int, rng: np.random.Generator) -> Problem:
    """n contacts in space between n / 3 spheres, in reduced form: some 11 neighbours a block."""
    bodies, rows = max(2, n // 3), np.arange(3)
    blocks, owners, columns = [], [], []
    for contact in range(n):
        pair = rng.choice(bodies, size=2, replace=False)
        frame = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        for sign, body in zip((1.0, -1.0), pair, strict=True):
            blocks.append(sign * frame)
            owners.append(contact)
            columns.append(body)
    data, index = np.array(blocks), np.array(owners)
    row = np.repeat(3 * index[:, None] + rows, 3, axis=1).ravel()
    column = np.tile(3 * np.array(columns)[:, None] + rows, (1, 3)).ravel()
    H = sp.csr_array((data.ravel(), (row, column)), shape=(3 * n, 3 * bodies))
    mass = np.repeat(rng.uniform(0.5, 2.0, bodies), 3)
    push = -H[::3].T @ rng.uniform(0.5, 1.0, n) + 0.3 * rng.standard_normal(3 * bodies)
    W = sp.bsr_array(H @ sp.diags_array(1.0 / mass) @ H.T, blocksize=(3, 3))
    return Problem.reduced(W=W, b=H @ (push / mass), law=Coulomb(np.full(n, 0.5)), block_size=3)


def flow(edge: int, rng: np.random.Generator) -> Problem:
    """edge^3 stress blocks of size 6, each meeting the 27 nodes around its own, on a periodic grid."""
    n = edge**3
    place = np.stack(np.unravel_index(np.arange(n), (edge,) * 3), axis=-1)
    offsets = np.array(list(product((-1, 0, 1), repeat=3)))
    around = (place[:, None, :] + offsets) % edge
    indices = np.sort(np.ravel_multi_index(tuple(np.moveaxis(around, -1, 0)), (edge,) * 3), axis=1)
    data = rng.standard_normal((27 * n, 6, 3))
    indptr = 27 * np.arange(n + 1, dtype=np.int32)
    H = sp.bsr_array((data, indices.ravel().astype(np.int32), indptr), shape=(6 * n, 3 * n))
    f = -sp.csr_array(H)[::6].T @ rng.uniform(0.5, 1.0, n) + 0.3 * rng.standard_normal(3 * n)
    mass = sp.dia_array((np.ones((1, 3 * n)), [0]), shape=(3 * n, 3 * n))
    return Problem(M=mass, f=f, H=H, w=np.zeros(6 * n), law=Coulomb(np.full(n, 0.4)))


def nanoseconds(
    problem: Problem, local_solver: str, operator: str, sweeps: int, repeats: int
) -> tuple[float, str]:
    """Shortest time of `sweeps` sweeps over the number of block solves, set-up and certificate taken off.

    Also the percentage of blocks that carry a force in the end: a block that takes off costs less.
    """
    loaded = 0.0

    def seconds(count: int) -> float:
        nonlocal loaded
        began = perf_counter()
        solution = solve(
            problem, "gauss_seidel", tol=1e-300, max_iterations=count, local_solver=local_solver,
            operator=operator, parallel=False, check_every=max(sweeps, 1),
        )  # fmt: skip
        spent = perf_counter() - began
        loaded = float(np.mean(solution.r.reshape(problem.n, problem.s)[:, 0] > 0.0))
        return spent

    seconds(6)  # compiles, and decomposes the blocks, which is kept with the problem
    without = min(seconds(0) for _ in range(repeats))
    with_sweeps = min(seconds(sweeps) for _ in range(repeats))
    return 1e9 * (with_sweeps - without) / (sweeps * problem.n), f"{100 * loaded:.0f} %"


def main() -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--contacts", type=int, default=3000, help="blocks of size 3")
    parser.add_argument("--edge", type=int, default=12, help="edge of the periodic grid of blocks of size 6")
    parser.add_argument("--sweeps", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5)
    choice = parser.parse_args()
    numba.set_num_threads(1)
    rng = np.random.default_rng(0)
    cases = (
        (
            "s = 3, stored W",
            pile(choice.contacts, rng),
            "explicit",
            ("enumerative", "fischer-burmeister", "fischer-burmeister+enumerative"),
        ),
        ("s = 6, factored, 27 nodes", flow(choice.edge, rng), "matrix-free", ("fischer-burmeister",)),
    )
    rows = []
    for name, problem, operator, peers in cases:
        ours, loaded = nanoseconds(problem, "secular", operator, choice.sweeps, choice.repeats)
        rows.append((name, problem.n, loaded, "secular", ours, 1.0))
        for peer in peers:
            theirs, loaded = nanoseconds(problem, peer, operator, choice.sweeps, choice.repeats)
            rows.append((name, problem.n, loaded, peer, theirs, theirs / ours))
    heads = ("case", "blocks", "loaded", "local solver", "ns a block solve", "over secular")
    print_table(f"One block solve in a sweep, one thread, {choice.sweeps} sweeps from zero", heads, rows)


if __name__ == "__main__":
    main()
