"""Seconds and memory of what an interior point repeats on M + H^T D H: entries, factorisation, solve; direct and iterative.

Quadratic triangles with three stress points, quadratic tetrahedra with four, on a square or cube clamped at its boundary. D
varies over twelve orders of magnitude between plugs and the rest. Needs scikit-fem. `wall` suffers from other processes; `cpu`
is the processor time of all threads.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import numpy as np
import scipy.sparse as sp
import skfem as fem
from skfem.helpers import ddot, div, sym_grad

from _table import print_table
from barchan.linalg import GramPattern, KrylovSolver, PatternSolver

SIZES = {2: (65, 129, 205), 3: (9, 13, 17)}


def body(
    dimension: int, vertices: int
) -> tuple[sp.csr_array, sp.csr_array, np.ndarray, np.ndarray, np.ndarray]:
    """M, H, places and components of the unknowns, places of the stress points."""
    line = np.linspace(0.0, 1.0, vertices)
    mesh = (fem.MeshTri if dimension == 2 else fem.MeshTet).init_tensor(*(line,) * dimension)
    element = fem.ElementVector(fem.ElementTriP2() if dimension == 2 else fem.ElementTetP2())
    basis = fem.CellBasis(mesh, element, intorder=2)

    @fem.BilinearForm
    def viscous(u: Any, v: Any, w: Any) -> Any:
        return 2.0 * ddot(sym_grad(u), sym_grad(v)) + div(u) * div(v)

    free = basis.complement_dofs(basis.get_dofs())
    M = sp.csr_array(viscous.assemble(basis))[free][:, free]
    pairs = [(i, j) for i in range(dimension) for j in range(i, dimension)]
    strains = np.empty((mesh.nelements, basis.dx.shape[1], len(pairs), basis.Nbfun))
    for b in range(basis.Nbfun):
        gradient = basis.basis[b][0].grad
        for row, (i, j) in enumerate(pairs):
            strains[:, :, row, b] = 0.5 * (gradient[i, j] + gradient[j, i]) * basis.dx
    columns = np.broadcast_to(basis.element_dofs.T[:, None, None, :], strains.shape)
    pointers = np.arange(0, strains.size + 1, basis.Nbfun)
    H = sp.csr_array((strains.ravel(), columns.ravel(), pointers), shape=(len(pointers) - 1, basis.N))[
        :, free
    ]
    components = np.empty(basis.N, int)
    for i in range(dimension):
        components[basis.get_dofs(elements=True).all([f"u^{i + 1}"])] = i
    points = np.asarray(basis.global_coordinates().value).reshape(dimension, -1).T
    return sp.csr_array(M), sp.csr_array(H), basis.doflocs[:, free].T.copy(), components[free], points


def plugs(points: np.ndarray, s: int, weight: float, contrast: float) -> np.ndarray:
    """Blocks (n, s, s) of random shape, `contrast` in plugs and its inverse elsewhere."""
    rng = np.random.default_rng(0)
    full = rng.standard_normal((len(points), s, s))
    full = full @ full.transpose(0, 2, 1) / s + np.eye(s)
    plug = np.sin(7.0 * points[:, 0]) * np.cos(9.0 * points[:, 1] + 4.0 * points[:, -1]) > 0.2
    return full * np.where(plug, contrast, 1.0 / contrast)[:, None, None] / weight


def timed(work: Callable[[], Any], repeats: int = 1) -> tuple[Any, float, float]:
    """Result of the work, and its shortest seconds of wall and processor."""
    best = [np.inf, np.inf]
    for _ in range(repeats):
        began = perf_counter(), process_time()
        result = work()
        best = [min(best[0], perf_counter() - began[0]), min(best[1], process_time() - began[1])]
    return result, best[0], best[1]


def measure(
    dimension: int, vertices: int, kind: str, contrast: float, krylov: bool
) -> list[tuple[object, ...]]:
    """Rows (unknowns, blocks, what, wall seconds, cpu seconds, MB or iterations)."""
    M, H, places, components, points = body(dimension, vertices)
    s = dimension * (dimension + 1) // 2
    D = plugs(points, s, 1.0 / len(points), contrast)
    pattern, *found = timed(lambda: GramPattern(M, H, s, upper=kind == "positive"))
    head = (pattern.m, pattern.n)
    rows: list[tuple[object, ...]] = [(*head, "pattern", *found, None)]
    data, *found = timed(lambda: pattern.data(D), 3)
    rows.append((*head, "entries", *found, None))
    right = np.random.default_rng(1).standard_normal(pattern.m)
    solver: PatternSolver | KrylovSolver
    solver, *found = timed(lambda: PatternSolver(pattern.matrix(D), kind))
    rows.append((*head, "direct: analysis", *found, None))
    good, *found = timed(lambda: solver.factorise(data), 2 if dimension == 2 else 1)
    assert good
    rows.append((*head, "direct: factorisation", *found, f"{solver.megabytes or 0:.0f} MB"))
    _, *found = timed(lambda: solver.solve(right), 2)
    rows.append((*head, "direct: solve", *found, None))
    if krylov:
        solver, *found = timed(lambda: KrylovSolver(pattern.matrix(), kind, places, components))
        rows.append((*head, "iterative: analysis", *found, None))
        good, *found = timed(lambda: solver.factorise(data))
        assert good
        rows.append((*head, "iterative: factorisation", *found, f"{solver.megabytes or 0:.0f} MB"))
        _, *found = timed(lambda: solver.solve(right))
        rows.append((*head, "iterative: solve", *found, f"{solver.iterations[0]} iterations"))
    return rows


def main() -> None:
    """Print one table per dimension."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dimension", type=int, choices=(2, 3), action="append")
    parser.add_argument("--vertices", type=int, action="append", help="along a side")
    parser.add_argument("--kind", choices=("positive", "structural"), default="positive")
    parser.add_argument("--contrast", type=float, default=1e6, help="of D in plugs; its inverse elsewhere")
    choice = parser.parse_args()
    for dimension in choice.dimension or (2, 3):
        measure(dimension, 5, choice.kind, 1.0, False)  # compiles
        rows = []
        for vertices in choice.vertices or SIZES[dimension]:
            rows += measure(dimension, vertices, choice.kind, choice.contrast, dimension == 3)
        heads = ("unknowns", "blocks", "step", "wall s", "cpu s", "")
        print_table(f"M + H^T D H in {dimension}D, {choice.kind}", heads, rows)


if __name__ == "__main__":
    main()
