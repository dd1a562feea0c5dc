"""Orders of convergence and refined profiles of dense flows (seed A, 6.1.1-6.1.3, Fig. 5 and 7). Slow."""

from __future__ import annotations

import numpy as np
import pytest

from barchan.flows.dense import DenseFlow, Material, NoSlip, RateViscosity, Stress, Velocity, observables
from barchan.spaces.meshes import channel_with_cylinder, rectangle
from barchan.spaces.mixed import MixedSpace

METHOD = "interior_point"
ALONG = Velocity((None, 0.0))
CHANNEL = {"top": NoSlip(), "bottom": NoSlip(), "left": ALONG, "right": ALONG}
PAIRS = [("P2", "P1"), ("P2", "P1d"), ("P3", "P2d"), ("P4", "P1d")]


def poiseuille_errors(bingham, cells, velocity, stress, width=0.5):
    """Errors of the speed, relative to the peak in the max norm and to the gradient in the H1 seminorm."""
    columns = max(round(width * cells / 2), 2)
    space = MixedSpace(rectangle((-width, -1.0), (0.0, 1.0), (columns, cells)), velocity, stress)
    flow = DenseFlow(space, Material.dimensionless(1.0, bingham), CHANNEL, gravity=(1.0, 0.0))
    state = flow.solve(1e-6, METHOD)
    assert state.certificate.residual < 1e-6
    u = state.velocity[::2]
    exact = 0.5 * ((1 - bingham) ** 2 - np.maximum(abs(space.nodes[:, 1]) - bingham, 0.0) ** 2)
    tables = space.tables(*space.element.quadrature(8))
    gradient = np.einsum("epkg,ek->epg", tables.gradients, u[space.cell_nodes])
    y = tables.points[..., 1]
    slope = -np.sign(y) * np.maximum(abs(y) - bingham, 0.0)
    gradient[..., 1] -= slope
    h1 = np.sqrt((tables.weights * (gradient**2).sum(-1)).sum() / (tables.weights * slope**2).sum())
    return abs(u - exact).max() / exact.max(), h1


@pytest.mark.slow
@pytest.mark.parametrize(("velocity", "stress"), PAIRS)
@pytest.mark.parametrize(("bingham", "least"), [(0.5, (1.0, 0.8)), (0.9, (1.5, 1.2))])
def test_bingham_poiseuille_converges(bingham, least, velocity, stress, record_property):
    """Four refinements whose lines never meet the edge of the plug, where the second derivative jumps."""
    cells = np.array([6, 10, 18, 34])
    errors = np.array([poiseuille_errors(bingham, n, velocity, stress, width=0.25) for n in cells])
    orders = -np.polyfit(np.log(cells), np.log(errors), 1)[0]
    record_property("orders", orders.tolist())
    assert (orders > least).all()


@pytest.mark.slow
@pytest.mark.parametrize(("velocity", "stress"), PAIRS[:2])
def test_narrow_shear_layers_are_resolved_to_one_percent(velocity, stress):
    assert poiseuille_errors(0.9, 64, velocity, stress, width=0.1)[0] < 0.01


@pytest.mark.slow
def test_bagnold_profile_at_32_cells():
    mu, angle = 0.5, np.arctan(0.55)
    sine, cosine = np.sin(angle), np.cos(angle)
    c = sine - mu * cosine

    def stress(x):
        depth = 1.0 - x[:, 1]
        sigma = np.empty((len(x), 2, 2))
        sigma[:, 0, 0] = sigma[:, 1, 1] = -depth * cosine
        sigma[:, 0, 1] = sigma[:, 1, 0] = depth * sine
        return sigma

    space = MixedSpace(rectangle((0.0, 0.0), (0.125, 1.0), (4, 32)))
    conditions = {"bottom": NoSlip(), "left": Stress(stress), "right": Stress(stress)}
    material = Material(mu=mu, viscosity=RateViscosity(lambda rate: rate))
    flow = DenseFlow(space, material, conditions, gravity=(sine, -cosine))
    state = flow.solve(1e-6, METHOD)
    assert state.converged
    y = space.nodes[:, 1]
    exact = 2 / 3 * np.sqrt(2 * c) * (1 - (1 - y) ** 1.5)
    assert abs(state.velocity[::2] - exact).max() < 0.01 * exact.max()
    rate = 2.0 * observables.shear_rates(flow, state)
    expected = np.sqrt(2 * c * (1 - space.points[:, 1]))
    assert abs(rate - expected).max() < 0.01 * expected.max()


@pytest.mark.slow
def test_drag_in_volume_form_tends_to_the_surface_integral():
    """Force on a cylinder: reactions of its nodes against the integral of (2 eta D - lambda) n over its surface."""
    gaps = []
    for vertices in (80, 300):
        space = MixedSpace(channel_with_cylinder(1.0, 4.0, 1.5, 2.0, vertices))
        conditions = {"sides": NoSlip(), "cylinder": NoSlip()}
        flow = DenseFlow(space, Material.dimensionless(1.0), conditions, gravity=(1.0, 0.0))
        state = flow.solve(1e-7, METHOD)
        assert state.converged
        basis = space.facet_basis("cylinder", 2)
        facets, cells = space.facets("cylinder"), space.mesh.f2t[0]
        strain = space.strain_rates(state.velocity).reshape(-1, 3, 3).mean(axis=1)
        stress = 2.0 * strain - state.forces.reshape(-1, 3, 3).mean(axis=1)
        a, b, c = stress[cells[facets]].T
        sigma = np.array([[a + b, c], [c, a - b]])
        force = np.einsum("abf,bfq,fq->a", sigma, np.asarray(basis.normals), np.asarray(basis.dx))
        gaps.append(
            np.linalg.norm(-force - observables.drag(flow, state, "cylinder")) / np.linalg.norm(force)
        )
    assert gaps[1] < 0.7 * gaps[0]
    assert gaps[1] < 0.15
