"""Coarse-grained fields obey the balances of mass and momentum (seed C, 3.3.1)."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from barchan.bodies.coarse_graining import (
    Fields,
    Gaussian,
    Grains,
    Heaviside,
    Interactions,
    Lucy,
    Mirror,
    Periodic,
    coarse_grain,
    coarse_grain_on_grid,
    mass_outside,
    volume_mean,
)
from barchan.bodies.coarse_graining.kernels import Kernel
from barchan.bodies.soft import Cell, Hookean, SoftSpheres, SoftState, Wall, lattice_packing
from barchan.errors import InputError

KERNELS = (Lucy(0.5), Gaussian(0.6), Heaviside(0.5))


def loose_grains(dimension: int, count: int = 40) -> tuple[Grains, Interactions]:
    """Grains anywhere in a unit box, with any forces between random pairs and some on walls."""
    rng = np.random.default_rng(dimension)
    x = rng.uniform(0.0, 1.0, (count, dimension))
    grains = Grains(
        x, rng.normal(size=(count, dimension)), rng.uniform(1.0, 2.0, count), rng.uniform(0.1, 0.2, count)
    )
    first, second = rng.integers(0, count, 60), rng.integers(0, count, 60)
    kept = first != second
    first, second = first[kept], second[kept]
    branches = x[first] - x[second]
    second = np.where(np.arange(len(first)) % 5 == 0, -1, second)
    branches[second < 0] *= 0.3
    normals = branches / np.linalg.norm(branches, axis=1)[:, None]
    forces = rng.normal(size=branches.shape)
    return grains, Interactions(first, second, forces, branches, normals, x[first] - branches)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("kernel", KERNELS)
def test_the_sums_on_a_grid_are_the_mass_the_momentum_and_the_virial_to_rounding(
    dimension: int, kernel: Kernel
) -> None:
    grains, forces = loose_grains(dimension)
    counts = (16,) * dimension
    fields = coarse_grain_on_grid([-1.0] * dimension, [2.0] * dimension, counts, grains, forces, kernel)
    cell = (3.0 / 16.0) ** dimension
    assert cell * np.sum(fields.density) == pytest.approx(np.sum(grains.masses), rel=1e-12)
    np.testing.assert_allclose(
        cell * fields.momentum.sum(axis=0), grains.masses @ grains.velocities, atol=1e-12
    )
    virial = forces.forces.T @ forces.branches
    np.testing.assert_allclose(cell * fields.contact_stress.sum(axis=0), virial, atol=1e-12)
    mean = volume_mean(grains, forces, 3.0**dimension)
    np.testing.assert_allclose(fields.contact_stress.mean(axis=0), mean.contact_stress, atol=1e-12)
    assert np.mean(fields.volume_fraction) == pytest.approx(mean.volume_fraction, rel=1e-12)


@pytest.mark.parametrize("kernel", KERNELS[:2])
def test_fields_at_points_integrate_to_the_mass_and_the_virial_of_the_grains(kernel: Kernel) -> None:
    """No scaling here: the midpoint rule on a fine grid."""
    grains, forces = loose_grains(2)
    line = -0.8 + 2.6 * (np.arange(260) + 0.5) / 260.0
    points = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    fields = coarse_grain(points, grains, forces, kernel)
    cell = (2.6 / 260.0) ** 2
    assert cell * np.sum(fields.density) == pytest.approx(np.sum(grains.masses), rel=1e-4)
    np.testing.assert_allclose(
        cell * fields.momentum.sum(axis=0), grains.masses @ grains.velocities, atol=2e-3
    )
    virial = forces.forces.T @ forces.branches
    np.testing.assert_allclose(
        cell * fields.contact_stress.sum(axis=0), virial, atol=2e-3 * np.abs(virial).max()
    )
    walls = forces.second < 0
    np.testing.assert_allclose(
        cell * fields.boundary_force.sum(axis=0), forces.forces[walls].sum(axis=0), atol=2e-3
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_divergence_of_the_contact_stress_is_the_force_on_the_grains(dimension: int) -> None:
    """-div(sigma) + F_b = sum_i f_i W(r - r_i), f_i the force of all contacts on grain i: exact at any point."""
    grains, forces = loose_grains(dimension)
    kernel = Lucy(0.5)
    points = np.random.default_rng(9).uniform(0.2, 0.8, (30, dimension))
    step, divergence = 1e-4, np.zeros((30, dimension))
    for axis in range(dimension):
        up, down = (
            coarse_grain(points + s * step * np.eye(dimension)[axis], grains, forces, kernel)
            for s in (1.0, -1.0)
        )
        divergence += (up.contact_stress[:, :, axis] - down.contact_stress[:, :, axis]) / (2.0 * step)
    sums = np.zeros_like(grains.positions)
    np.add.at(sums, forces.first, forces.forces)
    pairs = forces.second >= 0
    np.add.at(sums, forces.second[pairs], -forces.forces[pairs])
    here = coarse_grain(points, grains, forces, kernel)
    moved = Grains(grains.positions, sums, np.ones(len(grains)), np.ones(len(grains)))
    expected = coarse_grain(points, moved, forces, kernel).momentum
    np.testing.assert_allclose(here.boundary_force - divergence, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("kernel", KERNELS[:2])
def test_gradients_of_the_velocity_are_those_of_finite_differences(dimension: int, kernel: Kernel) -> None:
    grains, forces = loose_grains(dimension)
    points = np.random.default_rng(5).uniform(0.2, 0.8, (20, dimension))
    gradient = coarse_grain(points, grains, forces, kernel).velocity_gradient
    step = 1e-6
    for axis in range(dimension):
        up, down = (
            coarse_grain(points + s * step * np.eye(dimension)[axis], grains, forces, kernel).velocity
            for s in (1.0, -1.0)
        )
        np.testing.assert_allclose(gradient[:, :, axis], (up - down) / (2.0 * step), rtol=1e-3, atol=0.02)


def test_mass_is_conserved_in_time_where_grains_move() -> None:
    """d(rho)/dt + div(j) = 0."""
    grains, forces = loose_grains(2)
    points, dt = np.random.default_rng(1).uniform(0.2, 0.8, (20, 2)), 1e-5
    rates = []
    for sign in (1.0, -1.0):
        moved = Grains(
            grains.positions + sign * dt * grains.velocities, grains.velocities, grains.masses, grains.volumes
        )
        rates.append(coarse_grain(points, moved, forces, Lucy(0.5)).density)
    change = (rates[0] - rates[1]) / (2.0 * dt)
    divergence = np.trace(coarse_grain(points, grains, forces, Lucy(0.5)).momentum_gradient, axis1=1, axis2=2)
    np.testing.assert_allclose(change, -divergence, rtol=1e-5, atol=1e-4)


def test_a_gas_in_uniform_motion_has_no_temperature_and_one_that_jitters_has() -> None:
    rng = np.random.default_rng(2)
    x = rng.uniform(0.0, 1.0, (4000, 3))
    none = Interactions(*(np.zeros(0, dtype=np.int64),) * 2, *(np.zeros((0, 3)),) * 4)
    ones = np.ones(4000)
    still = coarse_grain(
        [[0.5, 0.5, 0.5]], Grains(x, np.tile([1.0, 2.0, 3.0], (4000, 1)), ones, ones), none, Lucy(0.4)
    )
    np.testing.assert_allclose(still.velocity, [[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(still.kinetic_stress, 0.0, atol=1e-9 * still.density[0])
    hot = coarse_grain(
        [[0.5, 0.5, 0.5]], Grains(x, rng.normal(0.0, 2.0, x.shape), ones, ones), none, Lucy(0.4)
    )
    assert hot.temperature[0] == pytest.approx(4.0, rel=0.15)
    assert hot.pressure[0] == pytest.approx(hot.density[0] * hot.temperature[0])


def test_a_square_lattice_under_pressure_has_its_stress_fabric_and_coordination() -> None:
    """Discs on a square lattice, each pressed by its four neighbours with force f: sigma = (f / edge) I and Z = 4."""
    edge, f, n = 0.1, 3.0, 40
    numbers = np.arange(n * n).reshape(n, n)
    x = edge * np.stack(np.unravel_index(numbers.ravel(), (n, n)), axis=1)
    grains = Grains(x, np.zeros_like(x), np.full(n * n, 2.0), np.full(n * n, np.pi * 0.25 * edge**2))
    first = np.concatenate([numbers[1:].ravel(), numbers[:, 1:].ravel()])
    second = np.concatenate([numbers[:-1].ravel(), numbers[:, :-1].ravel()])
    branches = x[first] - x[second]
    forces = Interactions(
        first, second, f / edge * branches, branches, branches / edge, 0.5 * (x[first] + x[second])
    )
    fields = coarse_grain([[2.0, 2.0], [1.93, 2.04]], grains, forces, Lucy(1.0))
    np.testing.assert_allclose(
        fields.contact_stress, np.tile(f / edge * np.eye(2), (2, 1, 1)), rtol=1e-3, atol=0.02
    )
    np.testing.assert_allclose(fields.coordination, 4.0, rtol=1e-3)
    np.testing.assert_allclose(fields.volume_fraction, np.pi / 4.0, rtol=1e-3)
    np.testing.assert_allclose(fields.density, 2.0 / edge**2, rtol=1e-3)


@cache
def settled_pile() -> tuple[SoftSpheres, SoftState]:
    """Discs poured between the periodic sides of a box on a floor, at rest."""
    rng = np.random.default_rng(4)
    radii = rng.uniform(0.4, 0.6, 220)
    cell = Cell((12.0, 60.0), (True, False))
    # the deepest contacts bear about 20 grains: the overlaps are 1e-3 of a diameter
    spheres = SoftSpheres(
        radii,
        1.0,
        Hookean.of_restitution(2e4, 0.2, 0.5),
        0.5,
        [Wall((0.0, 1.0), friction=0.5)],
        (0.0, -1.0),
        cell,
    )
    places = lattice_packing(radii, (0.0, 0.0), (12.0, 30.0), seed=2)
    state = spheres.advance(spheres.start(places), spheres.time_step(share=0.05), 100_000)
    assert np.max(np.abs(state.bodies.velocities)) < 1e-3
    return spheres, state


def pile_profile(heights: NDArray[np.float64], reach: float) -> Fields:
    spheres, state = settled_pile()
    grains, forces = spheres.grains(state)
    return coarse_grain(heights[:, None], grains, forces, Lucy(reach), axes=(1,), area=12.0)


def test_the_stress_in_a_pile_at_rest_balances_the_weight_above() -> None:
    """sigma_zz(z) is the weight above z to 2 %, at every height that the floor's kernel does not reach."""
    spheres, state = settled_pile()
    top = float(np.max(state.bodies.positions[:, 1]))
    heights = np.linspace(-3.0, top + 3.0, 1201)
    fields = pile_profile(heights, 2.0)
    step = heights[1] - heights[0]
    above = step * (np.cumsum(fields.density[::-1])[::-1] - 0.5 * fields.density)
    total = np.sum(spheres.masses) / 12.0
    assert above[0] == pytest.approx(total, rel=1e-3)
    inside = heights > 2.5
    np.testing.assert_allclose(fields.stress[inside, 1, 1], above[inside], atol=0.02 * total)
    deep = inside & (heights < 0.7 * top)
    np.testing.assert_allclose(fields.stress[deep, 1, 1], above[deep], rtol=0.02)
    # and with the force of the floor, everywhere: the balance is exact for any kernel
    floor = step * (np.cumsum(fields.boundary_force[::-1, 1])[::-1] - 0.5 * fields.boundary_force[:, 1])
    np.testing.assert_allclose(fields.stress[:, 1, 1] + floor, above, atol=0.005 * total)
    np.testing.assert_allclose(fields.stress[deep, 1, 0], 0.0, atol=0.03 * total)


def test_mirror_images_keep_the_mass_on_the_side_of_the_grains() -> None:
    spheres, state = settled_pile()
    grains, forces = spheres.grains(state)
    mirror = Mirror((0.0, 1.0), 0.0)
    step = 0.005
    heights = np.arange(0.5 * step, 40.0, step)
    total = np.sum(grains.masses) / 12.0
    bare = coarse_grain(heights[:, None], grains, forces, Lucy(2.0), axes=(1,), area=12.0)
    lost = total - step * np.sum(bare.density)
    assert lost > 0.01 * total
    mirrored = coarse_grain(
        heights[:, None], grains, forces, Lucy(2.0), axes=(1,), area=12.0, mirrors=[mirror]
    )
    assert step * np.sum(mirrored.density) == pytest.approx(total, rel=1e-5)
    wall = Interactions(*(np.zeros(0, dtype=np.int64),) * 2, *(np.zeros((0, 2)),) * 4)
    above, below = (
        coarse_grain(
            [[x, y] for x in np.arange(-3.0, 15.0, 0.1) for y in heights_], grains, wall, Lucy(2.0)
        ).density.sum()
        * 0.01
        for heights_ in (np.arange(0.05, 40.0, 0.1), np.arange(-2.95, 0.0, 0.1))
    )
    assert mass_outside(grains, Lucy(2.0), [mirror])[0] == pytest.approx(below, rel=5e-3)
    assert above + below == pytest.approx(np.sum(grains.masses), rel=1e-3)


def test_fields_of_a_periodic_cell_have_no_seam_and_shear_like_it() -> None:
    """Grains anywhere in a slanted cell that moves like a sheared one: the same fields at a point and at its images."""
    rng = np.random.default_rng(8)
    x = rng.uniform(0.0, 1.0, (200, 2)) * [4.0, 3.0]
    periodic = Periodic(np.array([[4.0, 0.0], [1.3, 3.0]]), np.array([[0.0, 0.0], [0.9, 0.0]]))
    grains = Grains(x, np.stack([0.3 * x[:, 1], np.zeros(200)], axis=1), np.ones(200), np.ones(200))
    none = Interactions(*(np.zeros(0, dtype=np.int64),) * 2, *(np.zeros((0, 2)),) * 4)
    points = np.array([[0.1, 0.2], [3.9, 1.4], [2.0, 2.95]])
    fields = [
        coarse_grain(points + shift, grains, none, Lucy(1.0), periodic=periodic)
        for shift in ([0.0, 0.0], [4.0, 0.0], [1.3, 3.0])
    ]
    np.testing.assert_allclose(fields[1].density, fields[0].density, rtol=1e-10)
    np.testing.assert_allclose(fields[2].density, fields[0].density, rtol=1e-10)
    np.testing.assert_allclose(fields[2].velocity[:, 0], fields[0].velocity[:, 0] + 0.9, rtol=1e-9)
    profile = coarse_grain(
        np.linspace(0.0, 3.0, 20)[:, None],
        grains,
        none,
        Gaussian(1.0),
        axes=(1,),
        area=4.0,
        periodic=periodic,
    )
    assert np.mean(profile.density[:-1]) == pytest.approx(200.0 / 12.0, rel=0.02)
    assert np.mean(profile.velocity_gradient[:, 0, 1]) == pytest.approx(0.3, rel=0.1)


def test_contacts_of_bodies_become_interactions_with_walls_second() -> None:
    centres = [[0.0, 0.0], [0.0, 1.0], [0.0, -5.0]]
    made = Interactions.of_contacts(
        centres, [1, 2, 2], [0, 0, 2], [[0.0, 0.5], [0.0, -0.5], [9.0, 9.0]], [[0.0, 1.0], [0.0, -1.0], [1.0, 0.0]],
        [[0.0, 2.0], [0.0, -3.0], [0.0, 0.0]], [False, False, True],
    )  # fmt: skip
    assert made.first.tolist() == [1, 0] and made.second.tolist() == [0, -1]
    np.testing.assert_allclose(made.forces, [[0.0, 2.0], [0.0, 3.0]])
    np.testing.assert_allclose(made.branches, [[0.0, 1.0], [0.0, 0.5]])
    np.testing.assert_allclose(made.normals, [[0.0, 1.0], [0.0, 1.0]])


def test_bad_input_is_named() -> None:
    grains, forces = loose_grains(2)
    heaviside = coarse_grain([[0.5, 0.5]], grains, forces, Heaviside(0.5))
    assert np.all(np.isnan(heaviside.velocity_gradient))
    empty = coarse_grain([[9.0, 9.0]], grains, forces, Lucy(0.5))
    assert empty.density[0] == 0.0 and np.all(np.isnan(empty.velocity))
    for make, field in (
        (lambda: coarse_grain([[0.5]], grains, forces, Lucy(0.5)), "points"),
        (lambda: coarse_grain([[0.5]], grains, forces, Lucy(0.5), axes=(2,)), "axes"),
        (lambda: coarse_grain([[0.5]], grains, forces, Lucy(0.5), axes=(1,), area=0.0), "area"),
        (lambda: coarse_grain_on_grid((0.0, 0.0), (1.0, 1.0), (4, 0), grains, forces, Lucy(0.5)), "counts"),
        (lambda: coarse_grain_on_grid((5.0, 5.0), (6.0, 6.0), (4, 4), grains, forces, Lucy(0.5)), "counts"),
        (
            lambda: Grains(grains.positions, grains.velocities, -grains.masses, grains.volumes),
            "grains.masses",
        ),
        (lambda: Mirror((0.0, 0.0)), "mirror.normal"),
        (lambda: Periodic(np.zeros((1, 2)), np.zeros((1, 2))), "periodic.edges"),
        (lambda: volume_mean(grains, forces, 0.0), "volume"),
    ):
        with pytest.raises(InputError) as caught:
            make()
        assert caught.value.field == field
