"""Stored problems of other people and made-up ones, and what it means that two are the same; shared by the tests of files."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import scipy.sparse as sp

from barchan.friction.files import ProblemArrays, SolutionArrays

# name: (full or reduced, number of blocks, block size, largest |W - W^T| / |W| in the file)
STORED = {
    "Box_Stacks-i0122-82-5.hdf5": (True, 82, 3, 1e-14),
    "BoxesStack1-i100000-32.hdf5.dat": (False, 52, 3, 1e-14),
    "Capsules-i100-889.dat": (False, 276, 3, 3e-4),
    "Capsules-i101-404.dat": (False, 225, 3, 3e-4),
    "Capsules-i122-1617.dat": (False, 296, 3, 5e-4),
    "Confeti-ex03-Fc3D-SBM.dat": (False, 54, 3, 1e-14),
    "Confeti-ex13-Fc3D-SBM.dat": (False, 107, 3, 1e-14),
    "FrictionContactProblem00031.dat": (False, 11, 2, 1e-14),
    "FrictionContactProblem00237.dat": (False, 376, 2, 1e-14),
    "GFC3D_OneContact.dat": (True, 1, 3, 1e-14),
    "LMGC_100_PR_PerioBox-i00361-60-03000.hdf5": (False, 60, 3, 1e-14),
    "OneObject-i100000-316.hdf5.dat": (False, 25, 3, 5e-5),
    "RockPile_tob1.dat": (False, 463, 3, 2e-3),
    "plasticity_2d_footing_10.dat": (False, 10, 3, 1e-14),
}


def assert_same(first: ProblemArrays | SolutionArrays, second: ProblemArrays | SolutionArrays) -> None:
    """Equal in every field and every bit."""
    for field in fields(first):
        a, b = getattr(first, field.name), getattr(second, field.name)
        if field.name in ("solution", "guesses"):
            pairs = [(a, b)] if field.name == "solution" else list(zip(a, b, strict=True))
            for one, other in pairs:
                assert (one is None) == (other is None)
                if one is not None:
                    assert_same(one, other)
        elif sp.issparse(a):
            assert a.shape == b.shape
            for part in ("data", "indices", "indptr"):
                np.testing.assert_array_equal(getattr(a, part), getattr(b, part), field.name)
        else:
            np.testing.assert_array_equal(a, b, field.name)


def made_up(n: int = 4, s: int = 3, seed: int = 0) -> ProblemArrays:
    """A reduced problem with numbers of all magnitudes and some empty blocks in W."""
    random = np.random.default_rng(seed)
    H = random.standard_normal((n, s, 5)) * 10.0 ** random.integers(-8, 8, (n, s, 1))
    H[1] = 0.0
    H = H.reshape(n * s, 5)
    return ProblemArrays(
        s, s, random.uniform(0.0, 1.5, n), W=sp.csr_array(H @ H.T), b=random.standard_normal(n * s) / 3.0
    )


def made_up_full(n: int = 3, s: int = 3, m: int = 7, bilateral: int = 2) -> ProblemArrays:
    """A full problem with bilateral rows, a solution and two guesses that have nothing to do with it."""
    random = np.random.default_rng(1)

    def state() -> SolutionArrays:
        sizes = {"r": n * s, "u": n * s, "v": m, "l": bilateral}
        return SolutionArrays(**{name: random.standard_normal(size) for name, size in sizes.items()})

    return ProblemArrays(
        s,
        s,
        random.uniform(0.0, 1.0, n),
        M=sp.csr_array(np.diag(random.uniform(1.0, 2.0, m))),
        f=random.standard_normal(m),
        H=sp.random_array((n * s, m), density=0.4, rng=random, format="csr"),
        w=random.standard_normal(n * s),
        C=sp.random_array((bilateral, m), density=0.5, rng=random, format="csr"),
        k=np.array([0.0, -1.5]),
        solution=state(),
        guesses=(state(), state()),
        title="three blocks",
        description="made up, with an é",
        math_info="",
    )


def delassus(arrays: ProblemArrays) -> tuple[np.ndarray, np.ndarray]:
    """Dense W and b of a reduced or full problem without bilateral rows."""
    if arrays.reduced:
        return arrays.W.toarray(), arrays.b
    H = arrays.H.toarray()
    inverse = np.linalg.inv(arrays.M.toarray())
    return H @ inverse @ H.T, H @ (inverse @ arrays.f) + arrays.w
