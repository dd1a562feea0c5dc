"""The nodal method: the same answers as through W, contacts of several vertices, what it refuses (seed B 4.3.1, 4.3.3)."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from barchan.cones import Coulomb, DruckerPrager, Law, SecondOrderCone
from barchan.errors import InputError
from barchan.friction import Problem, certify, solve
from barchan.friction.methods.nodal import applicable, nodal_form
from barchan.friction.methods.nodal.method import VARIANTS
from barchan.linalg.frames import contact_frames

SIDE = 9
Weights = list[tuple[list[int], list[float]]]


def mesh_mass(side: int, stiffness: float, seed: int = 0) -> sp.csr_array:
    """Unit masses joined by springs of random directions along the edges of a square mesh, and a little bending."""
    random = np.random.default_rng(seed)
    place = np.arange(side * side).reshape(side, side)
    edges = np.concatenate(
        [
            np.stack([place[:-1].ravel(), place[1:].ravel()], 1),
            np.stack([place[:, :-1].ravel(), place[:, 1:].ravel()], 1),
        ]
    )
    normals = random.standard_normal((len(edges), 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    rows = np.repeat(np.arange(len(edges)), 6)
    columns = (3 * edges[:, :, None] + np.arange(3)).ravel()
    pull = sp.csr_array(
        (np.concatenate([normals, -normals], 1).ravel(), (rows, columns)), shape=(len(edges), 3 * place.size)
    )
    slow = sp.csr_array(
        (
            np.repeat([[1.0, -1.0]], len(edges), 0).ravel(),
            (np.repeat(np.arange(len(edges)), 2), edges.ravel()),
        )
    )
    laplacian = sp.kron(slow.T @ slow, sp.eye_array(3))
    return sp.csr_array(sp.eye_array(3 * place.size) + stiffness * (pull.T @ pull + 0.05 * laplacian))


def contacts(weights: Weights, vertices: int, seed: int = 0) -> sp.bsr_array:
    """H of contacts in random frames, each of some vertices with weights."""
    normals = np.random.default_rng(seed).standard_normal((len(weights), 3))
    frames = contact_frames(normals / np.linalg.norm(normals, axis=1)[:, None])
    H = sp.lil_array((3 * len(weights), 3 * vertices))
    for i, (members, factors) in enumerate(weights):
        for vertex, factor in zip(members, factors, strict=True):
            H[3 * i : 3 * i + 3, 3 * vertex : 3 * vertex + 3] = factor * frames[i]
    return sp.bsr_array(H, blocksize=(3, 3))


def sheet(
    law: Law, weights: Weights | None = None, stiffness: float = 30.0, seed: int = 0, side: int = SIDE
) -> Problem:
    """A mesh pushed against contacts of every third vertex (or of `weights`), all regimes among them."""
    random = np.random.default_rng(seed)
    count = side * side
    chosen = weights if weights is not None else [([i], [1.0]) for i in range(0, count, 3)]
    H = contacts(chosen, count, seed)
    n = len(chosen)
    f = -sp.csr_array(H)[::3].T @ random.uniform(0.0, 2.0, n) + 0.6 * random.standard_normal(3 * count)
    w = 0.05 * random.standard_normal(3 * n)
    return Problem(M=mesh_mass(side, stiffness, seed), f=f, H=H, w=w, law=law, block_size=3)


# A vertex, two vertices, a vertex and a face, two edges, and weights that are not of unit length.
CLUSTERS: Weights = [
    ([0], [1.0]),
    ([4, 30], [1.0, -1.0]),
    ([12, 40, 41, 50], [1.0, -0.2, -0.3, -0.5]),
    ([20, 21, 60, 61], [0.3, 0.7, -0.6, -0.4]),
    ([70, 25], [2.0, -0.5]),
    ([80], [-1.0]),
]
SOME = np.linspace(0.0, 0.9, SIDE * SIDE // 3)


@pytest.mark.parametrize(
    "law", [Coulomb(SOME), SecondOrderCone(SOME), Coulomb(0.0)], ids=["coulomb", "convex", "smooth"]
)
@pytest.mark.parametrize("variant", VARIANTS)
def test_the_answer_is_that_of_the_dual_problem(variant: str, law: Law) -> None:
    problem = sheet(law)
    dual = solve(problem, "gauss_seidel", tol=1e-11, operator="explicit")
    nodal = solve(problem, "nodal", tol=1e-9, variant=variant)
    assert nodal.converged and certify(problem, nodal.r, nodal.v).residual <= 1e-9
    np.testing.assert_allclose(nodal.r, dual.r, atol=1e-6 * np.abs(dual.r).max())
    regimes = dual.r.reshape(-1, 3)
    assert (regimes[:, 0] == 0.0).any() and (regimes[:, 0] > 0.0).any()


def test_yield_stresses_are_served_by_sweeps_and_refused_by_the_gradient() -> None:
    problem = sheet(DruckerPrager(0.4, shear_yield=0.05, tensile_yield=0.02, dilatancy=0.2), CLUSTERS)
    for variant in ("inversion", "cadoux"):
        assert solve(problem, "nodal", tol=1e-8, variant=variant).converged
    with pytest.raises(InputError, match="law = with a yield stress"):
        solve(problem, "nodal", variant="projected_gradient")


@pytest.mark.parametrize("variant", VARIANTS)
def test_contacts_of_several_vertices_are_scaled_to_an_orthonormal_basis(variant: str) -> None:
    problem = sheet(Coulomb(0.4), CLUSTERS, seed=3)
    form = nodal_form(problem)
    turn = form.turn.toarray()
    np.testing.assert_allclose(turn @ turn.T, np.eye(len(turn)), atol=1e-13)
    for i, node in enumerate(form.nodes):
        row = problem.H.toarray()[3 * i : 3 * i + 3]
        np.testing.assert_allclose(form.scale[i] * turn[3 * node : 3 * node + 3], row, atol=1e-13)
    dual = solve(problem, "gauss_seidel", tol=1e-11, operator="explicit")
    nodal = solve(problem, "nodal", tol=1e-9, variant=variant)
    assert nodal.converged
    np.testing.assert_allclose(nodal.u, dual.u, atol=1e-6 * np.abs(dual.u).max())


def test_the_matrix_is_that_of_the_basis_and_as_sparse_as_the_mass() -> None:
    for weights in (None, CLUSTERS):
        problem = sheet(Coulomb(0.4), weights)
        form = nodal_form(problem)
        indptr, indices, data, middle = form.matrix
        stored = sp.bsr_array((data, indices, indptr), shape=problem.M.shape)
        expected = form.turn @ problem.M @ form.turn.T
        np.testing.assert_allclose(stored.toarray(), expected.toarray(), atol=1e-12)
        assert np.array_equal(indices[middle], np.arange(SIDE * SIDE))
        assert weights is not None or len(indices) == len(sp.bsr_array(problem.M, blocksize=(3, 3)).indices)


def test_the_metric_bounds_that_of_the_certificate() -> None:
    for weights in (None, CLUSTERS):
        problem = sheet(Coulomb(0.4), weights)
        assert (nodal_form(problem).rho >= (1.0 - 1e-12) * problem.rho).all()


@given(st.integers(0, 10_000), st.floats(0.0, 1.2), st.floats(0.1, 300.0))
@settings(max_examples=25, deadline=None)
def test_random_sheets_are_solved(seed: int, mu: float, stiffness: float) -> None:
    problem = sheet(Coulomb(mu), stiffness=stiffness, seed=seed, side=6)
    assert solve(problem, "nodal", tol=1e-8).converged


def test_corrections_spare_sweeps_and_change_nothing_else() -> None:
    problem = sheet(Coulomb(0.3), stiffness=3000.0, side=20)
    with_them = solve(problem, "nodal", tol=1e-7)
    for variant in ("inversion", "cadoux"):
        without = solve(problem, "nodal", tol=1e-7, corrections=False, variant=variant)
        assert with_them.converged and without.converged
        assert with_them.iterations < 0.5 * without.iterations
        np.testing.assert_allclose(with_them.r, without.r, atol=1e-4 * np.abs(without.r).max())


def test_a_warm_start_is_used() -> None:
    problem = sheet(Coulomb(0.3), stiffness=300.0)
    for variant in VARIANTS:
        cold = solve(problem, "nodal", tol=1e-7, variant=variant)
        near = solve(problem, "nodal", tol=1e-7, variant=variant, r0=cold.r * 1.001)
        assert near.converged and near.iterations < cold.iterations


def test_what_has_no_nodal_form_is_named() -> None:
    shared: Weights = [([3], [1.0]), ([5, 3], [1.0, -1.0])]
    with pytest.raises(InputError, match="contacts 0 and 1 that share vertex 3"):
        solve(sheet(Coulomb(0.3), shared), "nodal")
    good = sheet(Coulomb(0.3), CLUSTERS)
    assert applicable(good) and not applicable(sheet(Coulomb(0.3), shared))
    bent = good.H.toarray()
    bent[3, 13] += 0.1
    cases = {
        "contact 1, whose blocks are not weights times one rotation": {"H": bent},
        "contact 0 without a vertex": {"H": np.concatenate([np.zeros((3, good.size)), bent[3:]])},
        "bilateral constraints": {"C": np.eye(1, good.size), "k": np.zeros(1)},
    }
    for says, change in cases.items():
        given_data = {
            "M": good.M,
            "f": good.f,
            "H": good.H,
            "w": good.w,
            "law": good.law,
            "block_size": 3,
            **change,
        }
        with pytest.raises(InputError, match=says):
            solve(Problem(**given_data), "nodal")
    reduced = Problem.reduced(np.eye(3), np.ones(3), Coulomb(0.3), block_size=3)
    with pytest.raises(InputError, match="reduced problem"):
        solve(reduced, "nodal")
    flat = Problem(M=np.eye(2), f=np.ones(2), H=np.eye(2), w=np.zeros(2), law=Coulomb(0.3), block_size=2)
    with pytest.raises(InputError, match="blocks of size 2"):
        solve(flat, "nodal")


@pytest.mark.parametrize(
    ("options", "says"), [({"variant": "magic"}, "variant"), ({"reduction": 0.0}, "reduction")]
)
def test_unusable_options_are_refused(options: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        solve(sheet(Coulomb(0.4)), "nodal", **options)
