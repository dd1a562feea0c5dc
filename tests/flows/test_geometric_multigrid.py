"""Transfers, Galerkin products and multigrid cycles of Q2/P1 flows against their definitions and the direct solver."""

from __future__ import annotations

import numba
import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
import skfem

from barchan.errors import InputError
from barchan.flows.quasi_newtonian._galerkin_kernels import coarse_elements
from barchan.flows.quasi_newtonian.conditions import FreeSlip, NoSlip, Velocity
from barchan.flows.quasi_newtonian.flow import QuasiNewtonianFlow
from barchan.flows.quasi_newtonian.models import ModifiedPoliquen, Newtonian, Poliquen
from barchan.flows.quasi_newtonian.multigrid import GeometricMultigrid, LevelConstraints, MultigridSolver
from barchan.linalg import vanka
from barchan.linalg.cell_pattern import CellPattern
from barchan.linalg.multigrid import CycleOptions
from barchan.spaces.quadratic import QuadraticMesh, QuadraticSpace
from barchan.spaces.quadratic.transfers import pressure_transfer, prolongation, velocity_transfer

INNER, OUTER, SPEED = 0.019, 0.024, 0.019886667
PRESSURES = ("P1d", "P1d_mapped")


def ring(around: int = 16, across: int = 2) -> QuadraticMesh:
    """The gap between two cylinders (seed C, Fig. 17)."""
    angles, radii = 2.0 * np.pi * np.arange(around) / around, np.linspace(INNER, OUTER, across + 1)
    points = np.stack([np.outer(radii, np.cos(angles)).ravel(), np.outer(radii, np.sin(angles)).ravel()])
    i = np.arange(around)
    j = (i + 1) % around
    rows = [k * around + np.stack([i, i + around, j + around, j]) for k in range(across)]
    mesh = skfem.MeshQuad(points, np.hstack(rows)).with_boundaries(
        {"inner": lambda x: np.hypot(*x) < 0.0215, "outer": lambda x: np.hypot(*x) > 0.0215}
    )

    def circle(radius: float):
        return lambda x: x * (radius / np.linalg.norm(x, axis=1))[:, None]

    return QuadraticMesh.of(mesh, {"inner": circle(INNER), "outer": circle(OUTER)})


def hierarchy(mesh: QuadraticMesh, levels: int, pressure: str = "P1d") -> list[QuadraticSpace]:
    spaces = [QuadraticSpace(mesh, pressure)]
    while len(spaces) < levels:
        mesh = mesh.refined()
        spaces.append(QuadraticSpace(mesh, pressure))
    return spaces


def slanted(levels: int, pressure: str) -> list[QuadraticSpace]:
    """Parallelograms: global polynomials are polynomials on the reference cell."""
    square = skfem.MeshQuad.init_tensor(np.linspace(0, 2, 3), np.linspace(0, 1, 3))
    mesh = skfem.MeshQuad(np.array([[1.0, 0.3], [-0.2, 1.0]]) @ square.p, square.t)
    return hierarchy(QuadraticMesh.of(mesh), levels, pressure)


def turning(x: np.ndarray) -> np.ndarray:
    return SPEED / INNER * np.stack([-x[:, 1], x[:, 0]], axis=1)


def couette(space: QuadraticSpace, model, outer=None, mean=None) -> QuasiNewtonianFlow:
    conditions = {"inner": Velocity(turning), "outer": outer or NoSlip()}
    return QuasiNewtonianFlow(space, model, conditions, mean_pressure=mean)


def granular(eps: float) -> ModifiedPoliquen:
    return ModifiedPoliquen(0.15, 0.27, 0.06, 1e-3, 1.0, 1487.0 / 1500.0, eps=eps)


def tangent(flow: QuasiNewtonianFlow, pressure: float = 0.0) -> np.ndarray:
    """Newton matrix at a shear flow that decays through the gap by three orders of magnitude."""
    x = flow.space.mesh.nodes
    r = np.linalg.norm(x, axis=1)
    velocity = turning(x) * np.exp(-1400.0 * (r - INNER))[:, None]
    return flow.jacobian(flow.fields(velocity, pressure * flow.space.unit_pressure))


# -- transfers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pressure", PRESSURES)
def test_prolongation_reproduces_quadratic_velocities_and_linear_pressures(pressure):
    coarse, fine = slanted(2, pressure)

    def interpolant(space: QuadraticSpace) -> np.ndarray:
        x, y = space.mesh.nodes.T
        velocity = np.stack([1.0 + x * y - 2.0 * y**2, x**2 + 3.0 * x - y], axis=1)
        # p = 2 + x - 3 y, whose coefficients follow from its values at the points.
        values = 2.0 + space.points[..., 0] - 3.0 * space.points[..., 1]
        p = [np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(space.pressure_values, values, strict=True)]
        return np.concatenate([velocity.ravel(), np.ravel(p)])

    assert np.allclose(prolongation(coarse, fine) @ interpolant(coarse), interpolant(fine), atol=1e-12)


@pytest.mark.parametrize("pressure", PRESSURES)
def test_constants_stay_constant_on_curved_cells(pressure):
    coarse, fine = hierarchy(ring(), 2, pressure)
    one = [np.concatenate([np.ones(2 * s.N), s.unit_pressure]) for s in (coarse, fine)]
    assert np.allclose(prolongation(coarse, fine) @ one[0], one[1], atol=1e-13)


@pytest.mark.parametrize("pressure", PRESSURES)
def test_coarse_elements_are_the_galerkin_product(pressure):
    coarse, fine = hierarchy(ring(16, 1), 2, pressure)
    elements = np.random.default_rng(0).standard_normal((fine.cells, 21, 21))
    found = np.empty((coarse.cells, 21, 21))
    coarse_elements(elements, velocity_transfer(coarse), pressure_transfer(coarse, fine), found)
    here, above = CellPattern(coarse.cell_unknowns, coarse.size), CellPattern(fine.cell_unknowns, fine.size)
    P = prolongation(coarse, fine)
    x = np.random.default_rng(1).standard_normal((coarse.size, 3))
    wanted = P.T @ (above.matrix(above.assemble(elements)) @ (P @ x))
    assert np.allclose(here.matrix(here.assemble(found)) @ x, wanted, atol=1e-10)


def test_coarse_matrices_with_walls_are_galerkin_products_of_the_constrained_prolongation():
    spaces = hierarchy(ring(16, 1), 2)
    flow = couette(spaces[-1], Newtonian(1.0), FreeSlip())
    grids = grids_of(flow, spaces, precision="double")
    grids.update(tangent(flow))
    A, P = grids.pattern.matrix(grids.data), grids._prolongation(1)
    fixed = flow.on(spaces[0]).fixed
    x = np.random.default_rng(0).standard_normal(spaces[0].size)
    wanted = P.T @ (A @ (P @ x)) + fixed * x
    smoother = grids._levels[0].smoother
    found = -smoother.residual_ordered(x[smoother.order], np.zeros(len(x)))
    assert np.allclose(found, wanted[smoother.order], atol=1e-12)


def test_meshes_that_are_not_nested_are_refused():
    spaces = hierarchy(ring(), 3)
    with pytest.raises(InputError, match="spaces"):
        prolongation(spaces[0], spaces[2])
    with pytest.raises(InputError, match="P1d_mapped"):
        prolongation(spaces[0], QuadraticSpace(spaces[1].mesh, "P1d_mapped"))
    triangles = QuadraticMesh.of(skfem.MeshTri().refined(1))
    with pytest.raises(InputError, match="quadrilaterals"):
        prolongation(QuadraticSpace(triangles, "P1"), QuadraticSpace(triangles.refined(), "P1"))


# -- solver ------------------------------------------------------------------------------------------------------------


def grids_of(flow: QuasiNewtonianFlow, spaces: list[QuadraticSpace], **options) -> GeometricMultigrid:
    return MultigridSolver(flow, spaces, **options).grids


def right_side(flow: QuasiNewtonianFlow, seed: int = 0) -> np.ndarray:
    """A right-hand side in the range of the matrix: random forces, no sources."""
    b = np.random.default_rng(seed).standard_normal(flow.space.size)
    b[2 * flow.space.N :] = 0.0
    b[flow.constraints.fixed] = 0.0
    return b


def test_cycles_alone_contract_by_a_factor_that_does_not_depend_on_the_level():
    for outer in (NoSlip(), FreeSlip()):
        rates = []
        for levels in (2, 3, 4):
            spaces = hierarchy(ring(16, 1), levels)
            flow = couette(spaces[-1], Newtonian(1.0), outer)
            grids = grids_of(flow, spaces, options=CycleOptions("F", 4, 4), precision="double")
            grids.update(tangent(flow))
            found = grids.solve(right_side(flow), 1e-8, 8, krylov=False)
            rates.append(found.residual ** (1.0 / found.iterations))
        assert max(rates) < 0.15, rates


@pytest.mark.parametrize("eps", [1e-2, 1e-3])
def test_two_cycles_gain_an_order_of_magnitude_on_yielding_flows(eps):
    spaces = hierarchy(ring(), 4)
    flow = couette(spaces[-1], granular(eps))
    grids = grids_of(flow, spaces)
    grids.update(tangent(flow))
    for weighted in (True, False):
        assert grids.solve(right_side(flow), 0.1, 5, weighted=weighted).iterations <= 2


@pytest.mark.parametrize("pressure", PRESSURES)
@pytest.mark.parametrize("outer", [NoSlip(), FreeSlip()], ids=["no slip", "rotated"])
def test_solution_is_that_of_the_direct_solver(pressure, outer):
    spaces = hierarchy(ring(), 3, pressure)
    space = spaces[-1]
    flow = couette(space, Poliquen(0.15, 0.27, 0.06, 1e-3, 1.0, eps=1e-2), outer, mean=1.0)
    assert (flow.constraints.rotation is not None) == isinstance(outer, FreeSlip)
    solver = MultigridSolver(flow, spaces, gain=1e-12, max_cycles=60, precision="double")
    solver.update(tangent(flow, 1.0))
    A, b = solver.grids.pattern.matrix(solver.grids.data), right_side(flow)
    # The system bordered by the mean pressure, by elimination.
    free, mean_of = np.zeros(space.size), np.zeros(space.size)
    free[2 * space.N :], mean_of[2 * space.N :] = space.unit_pressure, space.pressure_weights / space.area
    column, row = sp.csr_array(free[:, None]), sp.csr_array(mean_of[None])
    direct = spla.splu(sp.csc_array(sp.block_array([[A, column], [row, None]])))
    for mean in (0.0, 3.0):
        found = solver.solve(b, mean)
        wanted = direct.solve(np.append(b, mean))[:-1]
        assert np.linalg.norm(found - wanted) <= 1e-8 * np.linalg.norm(wanted)
        assert mean_of @ found == pytest.approx(mean, abs=1e-10 * np.abs(found).max())
    assert not found[flow.constraints.fixed].any()


def test_single_precision_cycles_reach_double_precision_solutions():
    spaces = hierarchy(ring(), 3)
    flow = couette(spaces[-1], granular(1e-3))
    grids = grids_of(flow, spaces, precision="single")
    grids.update(tangent(flow))
    found = grids.solve(right_side(flow), 1e-11, 40)
    A, b = grids.pattern.matrix(grids.data), right_side(flow)
    assert np.linalg.norm(A @ found.x - b) <= 1e-9 * np.linalg.norm(b)
    assert found.iterations <= 25


def test_bytes_do_not_depend_on_the_threads(monkeypatch):
    monkeypatch.setattr(vanka, "LARGEST_SERIAL", 64)
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread only")
    spaces = hierarchy(ring(), 3)
    flow = couette(spaces[-1], granular(1e-2))
    elements, found = tangent(flow), []
    before = numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            grids = grids_of(flow, spaces)
            grids.update(elements.copy())
            found.append(grids.solve(right_side(flow), 1e-3, 5).x.tobytes())
    finally:
        numba.set_num_threads(before)
    assert found[0] == found[1]


def test_a_rotation_of_the_unknowns_only_renames_the_solution():
    spaces = hierarchy(ring(16, 1), 3)
    flow = couette(spaces[-1], Newtonian(1.0))
    plain, turned = [], []
    for k, space in enumerate(spaces):
        fixed = flow.on(space).fixed
        angles = np.where(np.arange(space.N) % 3 == 0, 0.4 + k, 0.0)
        blocks = [np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in angles]
        rotation = sp.csr_array(sp.block_diag([*blocks, sp.eye_array(space.P)], format="csr"))
        plain.append(LevelConstraints(fixed, None, True))
        turned.append(LevelConstraints(fixed, rotation, True))
    elements, b = tangent(flow), right_side(flow)
    solved = []
    for constraints in (plain, turned):
        grids = GeometricMultigrid(spaces, constraints)
        grids.update(elements.copy())
        rotation = constraints[-1].rotation
        side = b if rotation is None else rotation.T @ b
        x = grids.solve(side, 1e-11, 40).x
        solved.append(x if rotation is None else rotation @ x)
    assert np.linalg.norm(solved[0] - solved[1]) <= 1e-8 * np.linalg.norm(solved[0])


def test_wrong_spaces_and_options_are_refused():
    spaces = hierarchy(ring(), 2)
    flow = couette(spaces[-1], Newtonian(1.0))
    with pytest.raises(InputError, match="spaces"):
        MultigridSolver(flow, spaces[:1])
    with pytest.raises(InputError, match="gain"):
        MultigridSolver(flow, spaces, gain=1.0)
    with pytest.raises(InputError, match="elements"):
        MultigridSolver(flow, spaces).update(np.zeros((1, 21, 21)))
    free = LevelConstraints(np.zeros(3, bool))
    with pytest.raises(InputError, match="fixed"):
        GeometricMultigrid(spaces, [free, free])
    with pytest.raises(InputError, match="constraints"):
        GeometricMultigrid(spaces, [free])
