"""Islands, the groups of blocks that W couples, and Gauss-Seidel sweeps that stay on each one until it is solved.

A problem falls apart into its islands (seed B 3.4.3: disjoint subgraphs of the contact graph): one that converges slowly
must not keep the others busy, and a Newton step costs the cube of an island, not of the whole.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit

from barchan.cones._kernels import natural_map_residual_squared
from barchan.friction._kernels import gather_stored
from barchan.friction.local._coulomb import solve_exact
from barchan.linalg.borrowed import borrowed


@njit(cache=True)
def _root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True)
def find_islands(indptr, indices):
    """Pointers (k+1,) and block numbers (n,) of the k islands of a block pattern, blocks in increasing order. Cost O(nnz)."""
    n = len(indptr) - 1
    parent = np.arange(n)
    for i in range(n):
        for entry in range(indptr[i], indptr[i + 1]):
            a, b = _root(parent, i), _root(parent, indices[entry])
            if a < b:
                parent[b] = a
            else:
                parent[a] = b
    label = np.empty(n, np.int64)
    count = 0
    for i in range(n):
        a = _root(parent, i)
        if a == i:
            label[i] = count
            count += 1
        else:
            label[i] = label[a]
    pointers = np.zeros(count + 1, np.int64)
    for i in range(n):
        pointers[label[i] + 1] += 1
    for k in range(count):
        pointers[k + 1] += pointers[k]
    place = pointers[:-1].copy()
    members = np.empty(n, np.int64)
    for i in range(n):
        members[place[label[i]]] = i
        place[label[i]] += 1
    return pointers, members


@njit(cache=True, error_model="numpy")
def block_rate(S, i, w, b, r, u):
    """u (S,) = row i of W r + b."""
    for k in range(S):
        u[k] = b[i, k]
    gather_stored(S, i, w, r, u)


@cache
def island_sweeps(S: int) -> Callable[..., float]:
    """Kernel sweeping the islands `chosen` until each has a squared law residual <= goal * (its share of blocks).

    It makes `limit` sweeps of an island at most, checks after `first` sweeps and then at growing intervals, and gives up
    where the pace says that more than `worth` (k,) further sweeps are needed. Residuals go to `residual` (k,), sweeps made
    to `spent` (k,); it returns the work done in block solves.
    """

    @njit(cache=True, error_model="numpy")
    def kernel(
        chosen,
        islands,
        w,
        diagonal,
        b,
        local,
        laws,
        rho,
        goal,
        first,
        limit,
        worth,
        r,
        multiplier,
        out,
        scratch,
    ):
        pointers, members = islands
        residual, spent = out
        rhs, c, t = borrowed(scratch[0]), borrowed(scratch[1]), borrowed(scratch[2])
        w = (borrowed(w[0]), borrowed(w[1]), borrowed(w[2]))
        diagonal, b, local, laws = borrowed(diagonal), borrowed(b), borrowed(local), borrowed(laws)
        r, multiplier = borrowed(r), borrowed(multiplier)
        work = 0.0
        for island in chosen:
            start, stop = pointers[island], pointers[island + 1]
            allowed = goal * (stop - start) / len(members)
            done = 0
            pause = first
            while True:
                pause = min(pause, limit - done)
                for _ in range(pause):
                    for place in range(start, stop):
                        i = members[place]
                        for k in range(S):
                            total = b[i, k]
                            for m in range(S):
                                total -= diagonal[i, k, m] * r[i, m]
                            rhs[k] = total
                        gather_stored(S, i, w, r, rhs)
                        multiplier[i] = solve_exact(S, i, local, rhs, laws, multiplier[i], r[i], c, t)
                    spent[island] += 1
                    done += 1
                work += pause * (stop - start)
                made = pause
                pause = max(first, done // 2)
                violation = 0.0
                for place in range(start, stop):
                    i = members[place]
                    block_rate(S, i, w, b, r, rhs)
                    violation += natural_map_residual_squared(
                        r[i], rhs, laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3], rho[i]
                    )
                hopeless = False
                if done > first:
                    # Squares: twice the logarithm of the residual.
                    gain = math.log(residual[island] / violation) / made if violation > 0.0 else math.inf
                    hopeless = (
                        gain * worth[island] < math.log(violation / allowed) if allowed > 0.0 else False
                    )
                residual[island] = violation
                if violation <= allowed or done >= limit or hopeless:
                    break
        return work

    return kernel
