"""Second-order cones, symmetric tensors as cone vectors, friction laws and their complementarity functions.

Pure mathematics on small arrays: seed B, chapter 1, sections 4.1.1, 6.3.1 and B.1.1.
The Numba kernels of one block, for solvers, are in `barchan.cones._kernels`.
"""

from barchan.cones.faceted import FacetedCoulomb
from barchan.cones.jordan import (
    arrow_matrix,
    jordan_eigenvalues,
    jordan_hypotenuse,
    jordan_product,
    jordan_square_root,
)
from barchan.cones.laws import Coulomb, DruckerPrager, Law, RoundLaw, SecondOrderCone
from barchan.cones.projection import (
    project_dual_cone,
    project_polar_cone,
    project_second_order_cone,
    project_truncated_cone,
)
from barchan.cones.tensors import (
    angle_from_friction,
    chi,
    chi_inverse,
    friction_from_angle,
    normalised_friction,
    physical_friction,
    strain_tensor,
    tensor_block_size,
)

__all__ = [
    "Coulomb",
    "DruckerPrager",
    "FacetedCoulomb",
    "Law",
    "RoundLaw",
    "SecondOrderCone",
    "angle_from_friction",
    "arrow_matrix",
    "chi",
    "chi_inverse",
    "friction_from_angle",
    "jordan_eigenvalues",
    "jordan_hypotenuse",
    "jordan_product",
    "jordan_square_root",
    "normalised_friction",
    "physical_friction",
    "project_dual_cone",
    "project_polar_cone",
    "project_second_order_cone",
    "project_truncated_cone",
    "strain_tensor",
    "tensor_block_size",
]
