"""The generalised Jacobians of the laws' functions are their derivatives wherever they have one."""

import numpy as np
import pytest

from barchan.cones import Coulomb, DruckerPrager, SecondOrderCone

LAWS = {
    "coulomb": Coulomb(0.7),
    "frictionless": Coulomb(0.0),
    "associated": SecondOrderCone(0.7),
    "drucker-prager": DruckerPrager(0.6, shear_yield=0.8, tensile_yield=0.4, dilatancy=0.2),
    "tresca": DruckerPrager(0.0, shear_yield=0.8),
}


@pytest.mark.parametrize("s", [2, 3, 6])
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("function", ["natural_map", "alart_curnier"])
def test_jacobian_is_the_derivative(function, law, s):
    rng = np.random.default_rng(7)
    n, step = 400, 1e-6
    u, r = rng.normal(size=(2, n, s))
    rho = rng.uniform(0.5, 2.0, n)
    value = getattr(law, function)
    by_u, by_r = getattr(law, function + "_jacobian")(u, r, rho)
    missed = np.zeros(n, bool)
    for k in range(s):
        bump = np.zeros(s)
        bump[k] = step
        moved_u = (value(u + bump, r, rho) - value(u - bump, r, rho)) / (2 * step)
        moved_r = (value(u, r + bump, rho) - value(u, r - bump, rho)) / (2 * step)
        missed |= np.abs(moved_u - by_u[:, :, k]).max(axis=1) > 1e-5
        missed |= np.abs(moved_r - by_r[:, :, k]).max(axis=1) > 1e-5
    # A difference may straddle a kink: that happens to a block in a hundred thousand.
    assert missed.sum() <= 1


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_projection_does_not_expand(law):
    rng = np.random.default_rng(3)
    u, r = rng.normal(size=(2, 300, 3))
    _, by_r = law.natural_map_jacobian(u, r, 1.0)
    singular = np.linalg.svd(np.eye(3) - by_r, compute_uv=False)
    assert singular.max() <= 1.0 + 1e-12
