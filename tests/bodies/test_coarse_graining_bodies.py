"""Stresses of rigid discs at rest, coarse-grained from the contact forces of Moreau and Jean's steps, bear the weight above."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.bodies.coarse_graining import Grains, Interactions, Lucy, coarse_grain
from barchan.bodies.moreau import Assembly, AssemblyState, Options
from barchan.bodies.rigid import Body, Fixed, HalfSpace, Sphere

WIDTH, DENSITY, GRAVITY = 8.0, 1.0, 1.0


def settled() -> tuple[Assembly, AssemblyState]:
    """Fifty discs that fell between smooth walls on a rough floor."""
    rng = np.random.default_rng(3)
    walls = [
        Body(HalfSpace(normal, offset), "wall", friction, motion=Fixed())
        for normal, offset, friction in (((0.0, 1.0), 0.0, 0.5), ((1.0, 0.0), 0.0, 0.0), ((-1.0, 0.0), -WIDTH, 0.0))
    ]  # fmt: skip
    discs = []
    for number, radius in enumerate(rng.uniform(0.4, 0.52, 50)):
        row, column = divmod(number, 7)
        place = (0.6 + 1.1 * column + 0.03 * rng.standard_normal(), 0.6 + 1.1 * row)
        discs.append(Body(Sphere(radius, 2), f"disc_{number}", 0.5, DENSITY, position=place))
    assembly = Assembly([*walls, *discs], gravity=GRAVITY, options=Options(tolerance=1e-5))
    state = assembly.started()
    for _ in range(300):
        state, record = assembly.advance(state, 0.05)
        if record.max_speed < 1e-4:
            return assembly, state
    raise AssertionError(f"still moving at {record.max_speed} m/s")


def test_the_stress_in_a_heap_of_rigid_discs_balances_the_weight_above() -> None:
    """sigma_zz(z) is the weight above z within 2 % of the whole weight, and with the floor's force within 0.5 %."""
    assembly, state = settled()
    driven = np.array([body.driven for body in assembly.bodies])
    x = state.bodies.positions
    areas = np.array([body.volume for body in assembly.bodies])[~driven]
    grains = Grains(x[~driven], state.bodies.velocities[~driven], DENSITY * areas, areas)
    first, second = state.pairs.T
    forces = Interactions.of_contacts(
        x, first, second, state.points, state.normals, state.world_forces(), driven
    )
    heights = np.linspace(-3.0, float(np.max(x[~driven, 1])) + 3.0, 1001)
    fields = coarse_grain(heights[:, None], grains, forces, Lucy(2.0), axes=(1,), area=WIDTH)
    step = heights[1] - heights[0]
    above = GRAVITY * step * (np.cumsum(fields.density[::-1])[::-1] - 0.5 * fields.density)
    total = GRAVITY * DENSITY * float(np.sum(areas)) / WIDTH
    assert above[0] == pytest.approx(total, rel=1e-3)
    inside = heights > 2.5
    np.testing.assert_allclose(fields.contact_stress[inside, 1, 1], above[inside], atol=0.02 * total)
    floor = step * (np.cumsum(fields.boundary_force[::-1, 1])[::-1] - 0.5 * fields.boundary_force[:, 1])
    np.testing.assert_allclose(fields.contact_stress[:, 1, 1] + floor, above, atol=0.005 * total)
