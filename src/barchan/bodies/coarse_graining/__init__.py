"""From grains to fields (seed C, 3.2.2 and 3.3.1): coarse graining, means over volumes, and a fit of mu(I).

fields = coarse_grain(points, grains, interactions, Lucy(3.0 * diameter))
law = fit_mu_i(inertial_numbers, frictions);  Material(**to_material(law, 2500.0, 0.001, 0.6))
"""

from __future__ import annotations

from barchan.bodies.coarse_graining.fields import Fields, coarse_grain, coarse_grain_on_grid
from barchan.bodies.coarse_graining.images import Mirror, Periodic, mass_outside
from barchan.bodies.coarse_graining.interactions import WALL, Grains, Interactions
from barchan.bodies.coarse_graining.kernels import Gaussian, Heaviside, Kernel, Lucy, share_beyond
from barchan.bodies.coarse_graining.rheology import (
    MuI,
    deviatoric_norm,
    effective_friction,
    fit_mu_i,
    inertial_number,
    to_material,
)
from barchan.bodies.coarse_graining.virial import VolumeMean, volume_mean

__all__ = [
    "Grains", "Interactions", "WALL", "Kernel", "Lucy", "Gaussian", "Heaviside", "share_beyond",
    "Fields", "coarse_grain", "coarse_grain_on_grid", "Periodic", "Mirror", "mass_outside",
    "VolumeMean", "volume_mean", "deviatoric_norm", "effective_friction", "inertial_number",
    "MuI", "fit_mu_i", "to_material",
]  # fmt: skip
