"""Cost of one Gauss-Seidel sweep over piles of 1e2 to 1e5 contacts, W stored and factored: linear in the stored blocks.

Blocks are those of W (explicit) or of H (matrix-free). Sweeps start from forces near rest, on one thread; the processor time
of the process counts, since others may share the machine. A slope above 1 shows data leaving the caches: ns per block tell.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path
from time import process_time

import numba
import numpy as np
import scipy.sparse as sp

from _table import print_table
from barchan.cones import Coulomb, chi
from barchan.friction import Problem, operators, solve
from barchan.friction.gradient_form import GradientDelassus
from barchan.friction.methods.gauss_seidel import prepare_sweeper
from barchan.friction.operators import LumpedDelassus, StoredDelassus, build_operator
from barchan.friction.samples import pile

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "sweep_cost.png"
OPERATORS = ("explicit", "matrix-free")
SETTLING, FEWEST = 20, 5


def sweep(
    problem: Problem, operator: str, sweeps: int, r0: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Processor seconds of a solve of exactly `sweeps` sweeps, and its forces."""
    began = process_time()
    solution = solve(
        problem, "gauss_seidel", tol=1e-300, r0=r0, max_iterations=sweeps, operator=operator, parallel=False,
        check_every=10**9,
    )  # fmt: skip
    return process_time() - began, solution.r


def sweep_seconds(problem: Problem, operator: str, repeats: int, work: int) -> float:
    """Shortest time of a sweep: many sweeps less a few, so that set-up and the certificate drop out."""
    more = FEWEST + max(10, work // problem.n)
    _, settled = sweep(problem, operator, SETTLING)
    few = min(sweep(problem, operator, FEWEST, settled)[0] for _ in range(repeats))
    many = min(sweep(problem, operator, more, settled)[0] for _ in range(repeats))
    return (many - few) / (more - FEWEST)


def stored_blocks(problem: Problem, operator: str) -> int:
    """Blocks that a sweep reads."""
    delassus = build_operator(problem, operator)
    assert isinstance(delassus, StoredDelassus | LumpedDelassus)
    return len((delassus.rows if isinstance(delassus, StoredDelassus) else delassus.g).indices)


def pile_of(contacts: float, dimension: int) -> Problem:
    """A pile at rest of about as many contacts (bodies at the walls have fewer, which tells in small piles)."""
    bodies = contacts / 5.0
    for _ in range(4):
        problem = pile(max(1, round(bodies)), 1, dimension=dimension, closed=True).problem
        bodies *= contacts / problem.n
    return problem


def measure(
    sizes: np.ndarray, dimension: int, repeats: int, work: int
) -> dict[str, list[tuple[int, int, float]]]:
    """(contacts, blocks, seconds a sweep) over piles of about `sizes` contacts, for each operator."""
    found: dict[str, list[tuple[int, int, float]]] = {operator: [] for operator in OPERATORS}
    for size in sizes:
        problem = pile_of(size, dimension)
        for operator in OPERATORS:
            seconds = sweep_seconds(problem, operator, repeats, work)
            found[operator].append((problem.n, stored_blocks(problem, operator), seconds))
    return found


def strain_problem(nodes: int) -> Problem:
    """A cube of about `nodes` nodes, each seeing its 27 neighbours through a random strain block (6, 3)."""
    rng = np.random.default_rng(1)
    side = max(3, round(nodes ** (1 / 3)))
    place = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 3)
    step = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), -1).reshape(-1, 3)
    near = place[:, None] + step
    inside = ((near >= 0) & (near < side)).all(axis=-1)
    indices = (near @ np.array([side * side, side, 1]))[inside]
    data = np.einsum("sck,ek->esc", chi(np.eye(6)), rng.standard_normal((len(indices), 3)))
    n = len(place)
    pointers = np.concatenate([[0], np.cumsum(inside.sum(axis=1))])
    H = sp.bsr_array((data, indices, pointers), shape=(6 * n, 3 * n))
    push = np.zeros((n, 6))
    push[:, 0] = rng.uniform(0.0, 1.0, n)
    return Problem(
        M=sp.eye_array(3 * n, format="csr"),
        f=-(H.T @ push.reshape(-1)),
        H=H,
        w=np.zeros(6 * n),
        law=Coulomb(np.full(n, 0.4)),
    )


def continuum_rows(sizes: tuple[int, ...], repeats: int, sweeps: int) -> list[tuple[object, ...]]:
    """(form, schedule, nodes, set-up ms, ms a sweep, ns a node) of a continuum: by gradients and as blocks, one thread."""
    rows: list[tuple[object, ...]] = []
    recognise = operators.gradient_form
    for form, nodes, parallel in itertools.product((GradientDelassus, LumpedDelassus), sizes, (False, True)):
        operators.gradient_form = recognise if form is GradientDelassus else lambda *_: None
        setup, shortest = np.inf, np.inf
        given = strain_problem(nodes)
        for _ in range(repeats):
            problem = Problem(M=given.M, f=given.f, H=given.H, w=given.w, law=given.law)
            began = process_time()
            sweeper = prepare_sweeper(problem, "matrix-free", "secular", parallel)
            setup = min(setup, process_time() - began)
            assert isinstance(sweeper.delassus, form)
            sweeper.start(np.zeros((problem.n, 6)))
            sweeper.run(3, 0, -1.0)
            began = process_time()
            sweeper.run(sweeps, 0, -1.0)
            shortest = min(shortest, (process_time() - began) / sweeps)
        name = "gradients" if form is GradientDelassus else "blocks"
        order = "coloured" if parallel else "natural"
        rows.append((name, order, problem.n, 1e3 * setup, 1e3 * shortest, 1e9 * shortest / problem.n))
    operators.gradient_form = recognise
    return rows


def slope(points: list[tuple[int, int, float]]) -> float:
    """Exponent of seconds against blocks, by least squares on logarithms."""
    _, blocks, seconds = np.log(np.array(points)).T
    return float(np.polyfit(blocks, seconds, 1)[0])


def draw(found: dict[str, list[tuple[int, int, float]]], path: Path) -> None:
    """Log-log picture of seconds against blocks with the line of slope 1."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.0, 4.2), constrained_layout=True)
    for (operator, points), marker, colour in zip(
        found.items(), "os", ("tab:blue", "tab:orange"), strict=True
    ):
        _, blocks, seconds = np.array(points).T
        kind = "blocks of W" if operator == "explicit" else "blocks of H"
        axes.loglog(
            blocks, seconds, marker, color=colour, label=f"{operator}, {kind}: slope {slope(points):.2f}"
        )
        middle = np.exp(np.mean(np.log(seconds / blocks)))
        axes.loglog(blocks, middle * blocks, "-", color=colour, lw=0.8)
    axes.set(
        xlabel="stored blocks",
        ylabel="seconds a sweep, one thread",
        title="One Gauss-Seidel sweep over a pile of spheres",
    )
    axes.grid(True, which="both", lw=0.3)
    axes.legend(title="lines: slope 1")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=140)


def main() -> None:
    """Print the table, and draw the picture where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dimension", type=int, choices=(2, 3), default=3)
    parser.add_argument("--sizes", type=int, default=10, help="number of piles from 1e2 to 1e5 contacts")
    parser.add_argument("--largest", type=float, default=1e5, help="contacts of the largest pile")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--work", type=int, default=2_000_000, help="block solves timed at least")
    parser.add_argument("--picture", type=Path, default=PICTURE)
    parser.add_argument(
        "--continuum", action="store_true", help="a continuum by gradients and as blocks, and nothing else"
    )
    choice = parser.parse_args()
    numba.set_num_threads(1)
    if choice.continuum:
        rows = continuum_rows((1_000, 8_000, 32_000), choice.repeats, 20)
        heads = ("form", "order", "nodes", "ms set-up", "ms a sweep", "ns a node")
        print_table("One Gauss-Seidel sweep over a continuum in 3D, one thread", heads, rows)
        return
    sizes = np.geomspace(100, choice.largest, choice.sizes)
    sweep(pile(20, 1, dimension=choice.dimension).problem, "explicit", FEWEST)  # compiles
    sweep(pile(20, 1, dimension=choice.dimension).problem, "matrix-free", FEWEST)
    found = measure(sizes, choice.dimension, choice.repeats, choice.work)
    rows = [
        (operator, contacts, blocks, 1e3 * seconds, 1e9 * seconds / blocks, 1e9 * seconds / contacts)
        for operator, points in found.items()
        for contacts, blocks, seconds in points
    ]
    heads = ("operator", "contacts", "stored blocks", "ms a sweep", "ns a block", "ns a contact")
    print_table(f"One Gauss-Seidel sweep over piles in {choice.dimension}D, one thread", heads, rows)
    print()
    for operator, points in found.items():
        print(f"{operator}: seconds ~ blocks^{slope(points):.3f}")
    draw(found, choice.picture)


if __name__ == "__main__":
    main()
